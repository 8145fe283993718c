"""The one table of figures; a new figure is a function with the decorator `measures` and a line here."""

from robot_retarget.scores import bodies, distances, feet, joints, limbs, omniretarget, physics
from robot_retarget.scores.figure import Figure, Measure

MEASURES: tuple[Measure, ...] = (
    limbs.limbs,
    limbs.twist,
    distances.distances,
    distances.contacts,
    bodies.touches,
    bodies.kept,
    joints.self_penetration,
    feet.skate,
    feet.ground,
    joints.limits,
    joints.speed,
    joints.jerk,
    limbs.root_path,
    limbs.body_position,
    omniretarget.penetration,
    omniretarget.skating,
    joints.nmr,
    physics.root,
    feet.flight,
    physics.root_residual,
    physics.torque,
    feet.zmp,
    feet.held,
    joints.extent,
    physics.physics_score,
)
FIGURES: dict[str, Figure] = {figure.name: figure for measure in MEASURES for figure in measure.figures}

"""Ways out of a plan: judged branches that end in a stand, for a playback that is to stop."""

from pathlib import Path

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.judgement import require_judged
from robot_retarget.servo.plan import ServoPlan, goal_plan, parting
from robot_retarget.trajectory import load_trajectory

FOLDER = "stops"
"""Folder next to a trajectory; it has a folder for each branch, named by its moment [s]."""
AHEAD = 0.3
"""A branch has the goals of its trajectory until this long before its moment, or it belongs to another [s]."""


def judged_ways(
    path: str | Path, plan: ServoPlan, servo_map: ServoMap, servos: str, mode: str = "free", loose: bool = False
) -> tuple[list[ServoPlan], list[str]]:
    """Return the branches in `FOLDER` next to a trajectory that passed, and the reasons against the others.

    Args:
        path: file of the trajectory.
        plan: its judged goals.
        servo_map: as for `require_judged`.
        servos: as for `require_judged`.
        mode: as for `require_judged`.
        loose: as for `require_judged`.
    """
    ways, refused = [], []
    for file in sorted(Path(path).parent.glob(f"{FOLDER}/*/trajectory.npz")):
        try:
            branch = load_trajectory(file)
            require_judged(file, branch, servo_map, servos, None, mode, loose)
            way = goal_plan(branch, servo_map)
            lead_in = 0.0 if branch.goals is None else branch.goals.lead_in
            if parting(plan, way) / plan.rate < lead_in + float(file.parent.name) - AHEAD:
                raise ServoError(f"{file} belongs to another trajectory than {path}")
        except (ServoError, ValueError) as error:
            refused.append(str(error))
        else:
            ways.append(way)
    return ways, refused

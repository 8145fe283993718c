"""Score a trajectory: every figure of the table, against a human motion where one is given."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from robot_retarget.base.errors import MatchError, TrajectoryError
from robot_retarget.base.pages import card
from robot_retarget.graph.describe import among_placed
from robot_retarget.human.features import HumanFeatures, features_of
from robot_retarget.human.match import match, read_map
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import as_motion
from robot_retarget.robot import Robot
from robot_retarget.robot.catalog import Retargeted, on_robot
from robot_retarget.scores import physics, pose
from robot_retarget.scores.figure import Figure, Measure, Value
from robot_retarget.scores.pair import body_of, pair_of
from robot_retarget.scores.subject import Subject, soles_of
from robot_retarget.trajectory import Trajectory

# The one table of figures; a new figure is a function with the decorator `measures` and a line here.

MEASURES: tuple[Measure, ...] = (
    pose.limbs,
    pose.twist,
    pose.distances,
    pose.contacts,
    pose.touches,
    pose.kept,
    physics.self_penetration,
    physics.skate,
    physics.ground,
    physics.limits,
    physics.speed,
    physics.jerk,
    pose.root_path,
    pose.body_position,
    physics.penetration,
    physics.skating,
    physics.nmr,
    physics.root,
    physics.flight,
    physics.root_residual,
    physics.torque,
    physics.zmp,
    physics.held,
    physics.extent,
    physics.physics_score,
)
FIGURES: dict[str, Figure] = {figure.name: figure for measure in MEASURES for figure in measure.figures}


class Compared(Retargeted, Protocol):
    """A result of `retarget`, with its human motion."""

    @property
    def source(self) -> Motion | None: ...


@dataclass(frozen=True, eq=False)
class Score:
    """The figures of one trajectory."""

    figures: Mapping[str, Value]
    """By name, with the digits they are worth; None where one does not apply. `FIGURES` has units and meaning."""
    robot: str
    source: str
    frames: int
    fps: float
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<Score {self.source or 'made'} on {self.robot}: {len(self.figures)} figures over {self.frames} frames>"

    def _repr_html_(self) -> str:
        return card(f"{self.source or 'A trajectory'} on {self.robot}", self.lines(), self.notes)

    def lines(self) -> dict[str, str]:
        """Figures that apply, by name, with their units."""
        return {name: f"{v:g} {FIGURES[name].unit}".rstrip() for name, v in self.figures.items() if v is not None}

    def contract(self) -> dict[str, Any]:
        """Plain values for JSON."""
        facts = {"robot": self.robot, "source": self.source, "frames": self.frames, "fps": round(self.fps, 4)}
        return {**facts, "figures": dict(self.figures), "notes": list(self.notes)}


def score(
    trajectory: Compared | Trajectory | str | Path,
    robot: Robot | str | Path | None = None,
    motion: Motion | str | Path | None = None,
    *,
    overrides: str | Path | None = None,
) -> Score:
    """Measure every figure of `FIGURES`.

    Args:
        trajectory: a result of `retarget`, a trajectory, or its file.
        robot: a robot, or a name or model file that `load_robot` loads; by default the trajectory's.
        motion: the human motion that it comes from, or its file; by default that of the result. Without one, figures that
            compare with a human are None, and a note says so.
        overrides: a map file, as `match` takes it. A line of `[robot]` may list several points, whose mean is the keypoint.

    Raises:
        TrajectoryError: the trajectory belongs to another robot.
        MatchError: the motion is not human, or the map names a joint or body that does not exist.
    """
    played, model = on_robot(trajectory, robot)
    if motion is None and not isinstance(trajectory, Trajectory | str | Path):
        motion = trajectory.source
    human = None if motion is None else as_motion(motion, repair=False)
    subject, notes = subject_of(played, model, human, overrides)
    figures = {name: value for measure in MEASURES for name, value in measure.values(subject).items()}
    notes = (*_other_source(played, human), *notes, *pose.notes_of(subject))
    return Score(figures, model.name, played.source, len(played), played.fps, notes)


def _other_source(trajectory: Trajectory, motion: Motion | None) -> list[str]:
    """Return a note on a motion that is not the recorded source of the trajectory."""
    if motion is None or not trajectory.source_sha256:  # files of other tools record no motion
        return []
    try:
        trajectory.require_source(motion.source, motion.source_sha256)
    except TrajectoryError as error:
        return [f"{error}; the figures compare them all the same"]
    return []


def subject_of(
    trajectory: Trajectory, robot: Robot, motion: Motion | None, overrides: str | Path | None = None
) -> tuple[Subject, tuple[str, ...]]:
    """The trajectory with the recognised keypoints and soles, and notes."""
    tables = read_map(Path(overrides)) if overrides else {}
    model = robot.model
    solid = int(((model.geom_contype != 0) | (model.geom_conaffinity != 0)).sum())
    notes = [f"self-penetration: the {solid} collision geoms of {robot.path.name}"]
    try:
        body = body_of(robot, tables.get("robot", {}))
    except MatchError:
        if motion is not None or tables:
            raise
        return Subject(trajectory, robot), (*notes, "no humanoid: figures of feet are left out")
    pair = None if motion is None else pair_of(trajectory, robot, motion, body, tables.get("human", {}))
    around = None if motion is None else _among(trajectory, robot, motion, overrides)
    return Subject(trajectory, robot, soles_of(robot, body.anatomy), pair, body.anatomy, around), tuple(notes)


def _among(trajectory: Trajectory, robot: Robot, motion: Motion, overrides: str | Path | None) -> HumanFeatures | None:
    """Return the human at the frames of a trajectory among its bodies; None without bodies."""
    if trajectory.scene is None:
        return None
    in_step = motion.at_source_time(trajectory.source_time, trajectory.fps)
    placed = among_placed(in_step, robot, trajectory.scene, overrides)
    return features_of(placed, match(placed, robot, overrides))

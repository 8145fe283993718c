"""What kinds read: the human, the robot and the weights, of a clip or of one frame of a stream."""

from dataclasses import dataclass
from functools import cached_property

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.placed_scene import PlacedScene, placed_scene
from robot_retarget.graph.weights import Weights
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot


@dataclass(frozen=True, eq=False)
class RetargetContext:
    """The inputs of a kind's targets."""

    human: HumanFeatures
    match: Match
    robot: Robot
    weights: Weights

    @cached_property
    def scene(self) -> PlacedScene | None:
        """The bodies around, in the robot's world; None without a scene."""
        return placed_scene(self.human, self.match)

    @property
    def leg(self) -> float:
        """Length of the robot's leg [m], the scale of position errors."""
        return self.match.robot_leg


@dataclass(frozen=True, eq=False)
class StreamFrame(RetargetContext):
    """The inputs of a kind's targets at one frame of a stream; `human` has this frame alone."""

    calibration: RetargetContext
    """The frames that calibrated the performer."""
    corners: Floats
    """(F, 4, 3) corners of the robot's soles at the frame before [m]."""
    seconds: float
    """Time since the frame before [s]."""

    @cached_property
    def scene(self) -> PlacedScene | None:
        """The bodies around at this frame, placed as those of the calibration; None without a scene."""
        known, around = self.calibration.scene, self.human.around
        return None if known is None or around is None else known.moved(around.scene)

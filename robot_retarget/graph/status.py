"""Reasons for which a solver stops."""

from enum import Enum


class Status(Enum):
    """Why a solver stopped, at a frame or for a whole graph; the value is the sentence for a person."""

    CONVERGED = "the step fell below the tolerance"
    OUT_OF_ITERATIONS = "the iterations ran out; the pose is usable, not final"
    BLOCKED = "no further step keeps all limits; the pose is usable, not final"
    CALIBRATING = "the performer is being watched; the robot stands meanwhile"
    HELD = "no frame came; the robot comes to rest"
    UNREACHED = "a hard edge cannot be reached; the pose comes as near as it can"
    FAILED = "the solver's back end failed"

"""Which kinds a solver can honour; any other is an error, never a row that is ignored."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from robot_retarget.base.errors import GraphError, known
from robot_retarget.graph.kind import Kind
from robot_retarget.graph.track import CAUSAL_DIFFERENCE, FRAME, SECOND_DIFFERENCE, STEP, Form, Role, Track
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import tangent_names

FARTHEST = 2
"""The stencil of a symbolic cost spans at most this number of frames before and after its own."""


def require_honoured(robot: Robot, tracks: Sequence[Track], lag: int | None) -> None:
    """Raise for the first kind with rows that the solver of a clip, or of a stream, cannot honour.

    Args:
        tracks: all tracks of a graph.
        lag: number of frames by which a stream lags; None for a clip.

    Raises:
        GraphError: the message names the kind, its role and its stencil, and the combinations that the solver honours.
    """
    require_kinds([track.kind for track in tracks], lag)
    for track in tracks:
        if reason := _values_refused(track, robot):
            raise GraphError(f"{_title(track.kind)}: {reason}")


def require_kinds(kinds: Sequence[Kind], lag: int | None) -> None:
    """Raise for the first kind with a role, form and stencil that the solver of a clip, or of a stream, cannot honour.

    Args:
        kinds: all kinds of a graph.
        lag: number of frames by which a stream lags; None for a clip.

    Raises:
        GraphError: as `require_honoured`.
    """
    repeated = [name for name, count in Counter(kind.name for kind in kinds).items() if count > 1]
    if repeated:
        raise GraphError(f"two kinds of edges have the name {repeated[0]!r}")
    for kind in kinds:
        if reason := _stencil_refused(kind, lag):
            raise GraphError(f"{_title(kind)}: {reason}")


def _title(kind: Kind) -> str:
    return f"kind {kind.name!r}, {kind.form.value} {kind.role.value} with the stencil {_written(kind.stencil)}"


def _written(stencil: tuple[int, ...]) -> str:
    return str(stencil).replace("-", "−")


def _stencil_refused(kind: Kind, lag: int | None) -> str:
    """Return why the solver cannot honour the role, form and stencil of a kind; empty if it can."""
    stencil = kind.stencil
    if lag is not None and kind.form is not Form.JOINT and stencil[-1] > 0:
        return "a stream knows no later frames"
    if (kind.role, kind.form) == (Role.COST, Form.SYMBOLIC):
        spans = (
            set(stencil) <= set(range(-FARTHEST, FARTHEST + 1)) and 0 in stencil and len(set(stencil)) == len(stencil)
        )
        return "" if spans else f"a stencil has its own frame 0 and others up to {FARTHEST} frames away"
    honoured = {
        (Role.COST, Form.NUMERIC): (FRAME, STEP),
        (Role.COST, Form.JOINT): _differences(lag),
        (Role.INEQUALITY, Form.SYMBOLIC): (FRAME,),
        (Role.INEQUALITY, Form.NUMERIC): (FRAME,),
        (Role.BOUND, Form.JOINT): (FRAME, STEP),
    }.get((kind.role, kind.form), ())
    if not honoured:
        return "bounds have the joint form, inequalities the symbolic or numeric one"
    listed = " or ".join(_written(each) for each in honoured)
    driver = "a clip" if lag is None else "a stream"
    return "" if stencil in honoured else f"the solver of {driver} honours {listed}"


def _differences(lag: int | None) -> tuple[tuple[int, ...], ...]:
    """Return the stencils of differences of joints that a clip or a stream honours."""
    if lag is None:
        return (SECOND_DIFFERENCE,)
    return (CAUSAL_DIFFERENCE, SECOND_DIFFERENCE) if lag else (CAUSAL_DIFFERENCE,)


def _values_refused(track: Track, robot: Robot) -> str:
    """Return why the solver cannot honour the targets or ends of a track; empty if it can."""
    if track.role is not Role.COST and np.isfinite(track.priority[track.priority > 0]).any():
        return "limits have the priority ∞ where they hold and 0 elsewhere"
    if (track.role, track.kind.form) == (Role.INEQUALITY, Form.NUMERIC) and np.isfinite(track.upper).any():
        return "surfaces have no upper bound"
    if track.kind.form is not Form.JOINT:
        return ""
    names = robot.joint_names if track.role is Role.BOUND else tangent_names(robot)
    ends = Counter(end for end, _ in track.ends)
    for end, count in ends.items():
        if end not in names or count > 1:
            return f"joint {end!r} has two edges" if end in names else f"no joint {end!r}; {known(names)}"
    if track.role is not Role.COST:
        return ""
    if not (np.isinf(track.huber_delta) and track.exact):
        return "differences of joints have one target and squared errors"
    moved = track.stencil == CAUSAL_DIFFERENCE and track.lower.any()
    return "the difference from the two frames before has the target 0" if moved else ""

"""The kinds of edges. A new one is a class here and a line in this table, or an entry point of another package."""

from functools import cache
from importlib.metadata import entry_points

from robot_retarget.base.errors import GraphError
from robot_retarget.graph.kind import Kind
from robot_retarget.graph.kinds.bodies import ClearanceKind, ContactKind
from robot_retarget.graph.kinds.foothold import FootholdKind
from robot_retarget.graph.kinds.joints import (
    CouplingKind,
    InertiaKind,
    JerkKind,
    RangeKind,
    RestKind,
    SmoothnessKind,
    SpeedKind,
)
from robot_retarget.graph.kinds.pose import CompassKind, OrientationKind, PathKind
from robot_retarget.graph.kinds.posture import NearKind, PostureKind, TouchKind
from robot_retarget.graph.kinds.separation import FloorKind, SeparationKind

GROUP = "robot_retarget.kinds"
"""Entry points of this group name further kinds: a `Kind`, or a class of one."""
KINDS: tuple[Kind, ...] = (
    PostureKind(),
    TouchKind(),
    ContactKind(),
    NearKind(),
    CompassKind(),
    OrientationKind(),
    PathKind(),
    RestKind(),
    FootholdKind(),
    SmoothnessKind(),
    JerkKind(),
    CouplingKind(),
    FloorKind(),
    SeparationKind(),
    ClearanceKind(),
    RangeKind(),
    SpeedKind(),
)
"""The kinds of whole clips that ship."""
STREAM_KINDS: tuple[Kind, ...] = (*(kind.for_stream() for kind in KINDS if kind.stencil[-1] <= 0), InertiaKind())
"""The kinds of streams that ship."""


def clip_kinds() -> tuple[Kind, ...]:
    """Return the kinds of whole clips, with those of other packages."""
    return (*KINDS, *registered())


def stream_kinds(lag: int = 0) -> tuple[Kind, ...]:
    """Return the kinds of streams, with those of other packages that join no later frames.

    Args:
        lag: number of frames by which poses are late; a stream that lags is smoothed.
    """
    smooth = (SmoothnessKind(), JerkKind()) if lag else ()
    return (*STREAM_KINDS, *smooth, *(kind for kind in registered() if kind.stencil[-1] <= 0))


@cache
def registered() -> tuple[Kind, ...]:
    """Return the kinds that entry points of other packages name.

    Raises:
        GraphError: an entry point cannot be loaded, or is no kind; the message names it.
    """
    found = []
    for entry in entry_points(group=GROUP):
        try:
            kind = entry.load()
            kind = kind() if isinstance(kind, type) else kind
        except Exception as error:
            raise GraphError(f"entry point {entry.name} = {entry.value!r} of {GROUP}: {error}") from error
        if not isinstance(kind, Kind):
            raise GraphError(f"entry point {entry.name} = {entry.value!r} of {GROUP} is no Kind")
        found.append(kind)
    return tuple(found)

"""The kinds of edges; a new one is a file here and a line in this table."""

from robot_retarget.graph.kinds.compass import CompassKind
from robot_retarget.graph.kinds.coupling import CouplingKind
from robot_retarget.graph.kinds.floor import FloorKind
from robot_retarget.graph.kinds.foothold import FootholdKind
from robot_retarget.graph.kinds.interaction import InteractionKind
from robot_retarget.graph.kinds.joints import RangeKind, SpeedKind
from robot_retarget.graph.kinds.kind import MotionKind
from robot_retarget.graph.kinds.orientation import OrientationKind
from robot_retarget.graph.kinds.pelvis import PathKind
from robot_retarget.graph.kinds.posture import PostureKind
from robot_retarget.graph.kinds.rest import RestKind
from robot_retarget.graph.kinds.separation import SeparationKind
from robot_retarget.graph.kinds.temporal import InertiaKind, SmoothnessKind
from robot_retarget.graph.kinds.touch import TouchKind

KINDS: tuple[MotionKind, ...] = (
    PostureKind(),
    TouchKind(),
    CompassKind(),
    OrientationKind(),
    PathKind(),
    RestKind(),
    FootholdKind(),
    SmoothnessKind(),
    InteractionKind(),
    CouplingKind(),
    FloorKind(),
    SeparationKind(),
    RangeKind(),
    SpeedKind(),
)
"""The kinds of whole clips."""
STREAM_KINDS: tuple[MotionKind, ...] = (*(kind for kind in KINDS if kind.name != SmoothnessKind.name), InertiaKind())
"""The kinds of streams."""

"""The kinds of edges; a new one is a file here and a line in this table."""

from robot_retarget.describe.kinds.compass import Compass
from robot_retarget.describe.kinds.coupling import Coupling
from robot_retarget.describe.kinds.floor import Floor
from robot_retarget.describe.kinds.foothold import Foothold
from robot_retarget.describe.kinds.interaction import Interaction
from robot_retarget.describe.kinds.joints import Range, Speed
from robot_retarget.describe.kinds.kind import MotionKind
from robot_retarget.describe.kinds.orientation import Orientation
from robot_retarget.describe.kinds.pelvis import Path
from robot_retarget.describe.kinds.posture import Posture
from robot_retarget.describe.kinds.rest import Rest
from robot_retarget.describe.kinds.separation import Separation
from robot_retarget.describe.kinds.temporal import Inertia, Smoothness
from robot_retarget.describe.kinds.touch import Touch

KINDS: tuple[MotionKind, ...] = (
    Posture(),
    Touch(),
    Compass(),
    Orientation(),
    Path(),
    Rest(),
    Foothold(),
    Smoothness(),
    Interaction(),
    Coupling(),
    Floor(),
    Separation(),
    Range(),
    Speed(),
)
"""The kinds of whole clips."""
STREAM_KINDS: tuple[MotionKind, ...] = (*(kind for kind in KINDS if kind.name != Smoothness.name), Inertia())
"""The kinds of streams."""

"""The kinds of edges; a new one is a file here and a line in this table."""

from robot_retarget.describe.kinds.compass import Compass
from robot_retarget.describe.kinds.foothold import Foothold
from robot_retarget.describe.kinds.kind import Kind
from robot_retarget.describe.kinds.orientation import Orientation
from robot_retarget.describe.kinds.pelvis import Path
from robot_retarget.describe.kinds.posture import Posture
from robot_retarget.describe.kinds.rest import Rest
from robot_retarget.describe.kinds.touch import Touch

KINDS: tuple[Kind, ...] = (Posture(), Touch(), Compass(), Orientation(), Path(), Rest(), Foothold())
"""What a human motion is described by."""

"""Changes by hand: touch-ups of single frames; cuts and mirror images of trajectories."""

from robot_retarget.edit.cuts import mirrored as mirrored
from robot_retarget.edit.cuts import trimmed as trimmed

"""Changes by hand: touch-ups of single frames; cuts, mirrors, repetitions and joins of trajectories."""

from robot_retarget.edit.cuts import joined as joined
from robot_retarget.edit.cuts import mirrored as mirrored
from robot_retarget.edit.cuts import repeated as repeated
from robot_retarget.edit.cuts import trimmed as trimmed

"""What a person changes by hand: all_targets for a touch-up, and where a trajectory is cut, mirrored, repeated and joined."""

from robot_retarget.edit.cuts import joined as joined
from robot_retarget.edit.cuts import mirrored as mirrored
from robot_retarget.edit.cuts import repeated as repeated
from robot_retarget.edit.cuts import trimmed as trimmed

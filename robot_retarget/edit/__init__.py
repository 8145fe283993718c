"""What a person changes by hand: where a trajectory is cut, mirrored, repeated and joined to others."""

from robot_retarget.edit.cuts import joined as joined
from robot_retarget.edit.cuts import mirrored as mirrored
from robot_retarget.edit.cuts import repeated as repeated
from robot_retarget.edit.cuts import trimmed as trimmed

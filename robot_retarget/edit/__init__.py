"""Manual changes: edits of a trajectory's graph, and cutting, mirroring, repeating and joining of trajectories."""

from robot_retarget.edit.cuts import joined as joined
from robot_retarget.edit.cuts import mirrored as mirrored
from robot_retarget.edit.cuts import repeated as repeated
from robot_retarget.edit.cuts import trimmed as trimmed

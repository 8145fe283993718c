"""Motion files: each becomes a `Motion` in metres, z up, without the defects that can be repaired."""

from robot_retarget.human.motion import Motion as Motion
from robot_retarget.human.skeleton import Skeleton as Skeleton

from .formats.bvh import write_bvh as write_bvh
from .read import as_motion as as_motion
from .read import performers as performers
from .read import read_motion as read_motion

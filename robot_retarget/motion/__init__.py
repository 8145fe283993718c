"""The human side: a motion file becomes a `Motion` in metres, z up, and its joints are recognised."""

from .formats.bvh import write_bvh as write_bvh
from .read import read_motion as read_motion
from .recognise import Mark as Mark
from .recognise import Recognition as Recognition
from .recognise import apply_override as apply_override
from .recognise import recognise as recognise
from .recognise import recognise_with as recognise_with
from .resample import resample as resample
from .skeleton import Motion as Motion
from .skeleton import Skeleton as Skeleton
from .stature import leg_length as leg_length
from .stature import stature as stature

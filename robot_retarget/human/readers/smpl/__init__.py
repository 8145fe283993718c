"""Parameters of the SMPL family."""

from . import motion_x as motion_x
from . import pickled as pickled
from .parameters import matches_format as matches_format
from .parameters import read as read

"""Parameters of the SMPL family."""

from . import pickled as pickled
from .parameters import matches_format as matches_format
from .parameters import read as read

"""Parameters of the SMPL family."""

from . import pickled as pickled
from .parameters import read as read
from .parameters import told as told

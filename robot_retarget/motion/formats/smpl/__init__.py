"""Parameters of the SMPL family."""

from .parameters import read as read
from .parameters import told as told

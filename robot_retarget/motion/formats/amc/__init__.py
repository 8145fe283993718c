"""ASF/AMC: a skeleton, and the angles of its bones."""

from .motion import read as read
from .motion import told as told

"""ASF/AMC: a skeleton, and the angles of its bones."""

from .motion import beside as beside
from .motion import matches_format as matches_format
from .motion import read as read

"""glTF, GLB and VRMA animations."""

from .animation import matches_format as matches_format
from .animation import read as read

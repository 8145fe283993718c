"""glTF, GLB and VRMA animations."""

from .animation import read as read
from .animation import told as told

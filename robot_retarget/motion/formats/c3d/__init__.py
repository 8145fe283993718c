"""C3D files of labelled markers."""

from .file import read as read
from .file import told as told

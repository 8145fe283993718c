"""C3D files of labelled markers."""

from .file import matches_format as matches_format
from .file import read as read

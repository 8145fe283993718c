"""Landmarks of MediaPipe and FreeMoCap."""

from .body import matches_format as matches_format
from .body import read as read

"""Landmarks of MediaPipe and FreeMoCap."""

from .body import read as read
from .body import told as told

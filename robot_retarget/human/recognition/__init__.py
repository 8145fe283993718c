"""Skeleton recognition: which joints of an unknown skeleton are which keypoints."""

from .recognise import Mark as Mark
from .recognise import Recognition as Recognition
from .recognise import apply_override as apply_override
from .recognise import recognise as recognise

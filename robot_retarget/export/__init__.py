"""Trajectories in the formats of others."""

from robot_retarget.export.table import FORMATS as FORMATS
from robot_retarget.export.table import Format as Format
from robot_retarget.export.table import export as export

"""Motions of robots in the formats of others, out and in; one file a format, one table."""

from robot_retarget.formats.io import FORMATS as FORMATS
from robot_retarget.formats.io import export as export
from robot_retarget.formats.io import import_motion as import_motion
from robot_retarget.formats.io import load_trajectory as load_trajectory
from robot_retarget.formats.robot_motion import FormatOptions as FormatOptions
from robot_retarget.formats.source import TrajectoryFormat as TrajectoryFormat

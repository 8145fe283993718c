"""Figures by which retargeters are compared: one file per figure, one table."""

from robot_retarget.stage import make_callable

make_callable(__name__)

"""Figures by which retargeters are compared: one file per figure, one table."""

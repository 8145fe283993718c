"""Readers of scene files and of poses over time."""

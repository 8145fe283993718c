"""Formats that other programs play: scenes, messages, skeletons."""

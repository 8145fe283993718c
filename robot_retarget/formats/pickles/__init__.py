"""Formats that are Python pickles."""

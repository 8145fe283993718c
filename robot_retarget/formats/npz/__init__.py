"""Formats that are NumPy archives."""

"""Formats of bytes at fixed places."""

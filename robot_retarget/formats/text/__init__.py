"""Formats that are tables of text."""

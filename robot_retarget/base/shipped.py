"""Folders of the shipped files: inside the installed package, or next to it in a checkout."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


def _shipped(folder: str) -> Path:
    inside = _PACKAGE / folder
    return inside if inside.is_dir() else _PACKAGE.parent / folder


MODELS = _shipped("models")
SAMPLES = _shipped("samples")

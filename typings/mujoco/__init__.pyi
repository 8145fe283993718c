"""MuJoCo's compiled modules come without stubs: every name is taken as it is."""

from typing import Any

def __getattr__(name: str) -> Any: ...

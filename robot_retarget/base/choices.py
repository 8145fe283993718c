"""Words that options take, in Python and in the shell."""

from collections.abc import Callable, Mapping
from typing import Any, Literal

Legs = Literal["auto", "follow", "stand"]
"""Task of the legs with balance."""
Balance = Literal["auto", "static", "dynamic", "off"]
"""What holds the robot upright."""
Preset = Literal["directions", "balanced", "distances"]
"""Preference of the weights: directions of limbs, distances between parts, a smooth reference for a policy, or a blend."""
Terrain = Literal["flat", "auto"]
"""The ground: level, or boxes where the human stands and sits."""
Stand = Literal["auto", "pinned", "free"]
"""How a simulated robot is held: by its pelvis, or by its feet on a floor."""


def require_keywords(function: Callable[..., Any], given: Mapping[str, Any], known: type) -> None:
    """Require that keywords are among the keys of a typed dictionary.

    Raises:
        TypeError: one is not, as Python says it of a function without `**`.
    """
    for name in given:
        if name not in known.__annotations__:
            raise TypeError(f"{function.__name__}() got an unexpected keyword argument {name!r}")

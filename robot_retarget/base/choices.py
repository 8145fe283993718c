"""Words that options take, in Python and in the shell."""

from typing import Literal

Legs = Literal["auto", "follow", "stand"]
"""Task of the legs with balance."""
Balance = Literal["auto", "static", "dynamic", "off"]
"""What holds the robot upright."""
Preset = Literal["directions", "balanced", "distances"]
"""Preference of the weights: directions of limbs, distances between parts, or a blend."""
Terrain = Literal["flat", "auto"]
"""The ground: level, or boxes where the human stands and sits."""
Stand = Literal["auto", "pinned", "free"]
"""How a simulated robot is held: by its pelvis, or by its feet on a floor."""

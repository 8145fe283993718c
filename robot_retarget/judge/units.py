"""Figures of reports in the units that people read."""

UNITS = {"rad": (57.29578, "°"), "m": (1000.0, "mm"), "of all": (100.0, "%")}
"""What figures are shown in: a factor and a unit for each unit of the report."""


def shown(value: float | str, unit: str) -> str:
    """Return a figure in a common unit: 0.2 rad as 11.5°. Texts are returned unchanged."""
    if isinstance(value, str):
        return value
    factor, name = UNITS.get(unit, (1.0, "°" if unit == "deg" else unit))
    return f"{factor * value + 0.0:.3g}{'' if name == '°' or not name else ' '}{name}"

"""Cards of values for notebooks, and data frames for pandas."""

import html
from collections.abc import Mapping
from typing import Any

from robot_retarget.arrays import Floats
from robot_retarget.errors import UsageError

_BOX = "display:inline-block;border:1px solid #cbd2d9;border-radius:8px;padding:8px 14px;font:14px/1.5 system-ui,sans-serif"
_NAME = "color:#616e7c;padding:0 14px 0 0;text-align:left"


def card(title: str, facts: Mapping[str, str], said: tuple[str, ...] = ()) -> str:
    """A box with a title, facts by name, and sentences under them, as HTML."""
    rows = "".join(
        f'<tr style="background:none"><td style="{_NAME}">{html.escape(name)}</td>'
        f'<td style="text-align:left">{html.escape(value)}</td></tr>'
        for name, value in facts.items()
    )
    sentences = "".join(f"<div>{html.escape(sentence)}</div>" for sentence in said)
    return f'<div style="{_BOX}"><b>{html.escape(title)}</b><table style="margin:4px 0">{rows}</table>{sentences}</div>'


def frame(columns: Mapping[Any, Floats], times: Floats) -> Any:
    """A pandas DataFrame with one row a time [s]; names of two parts make two levels.

    Raises:
        UsageError: pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise UsageError("a data frame needs pandas: pip install pandas") from None
    return pandas.DataFrame(dict(columns), index=pandas.Index(times, name="time [s]"))

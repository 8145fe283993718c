"""Pages from templates, where text is escaped unless it is marked as HTML; cards of values for notebooks; data frames."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError


def rendered(template: Path, **facts: Any) -> str:
    """Return the page of a Jinja template with its facts; a fact that is missing is an error."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    loader = FileSystemLoader(template.parent)
    pages = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return pages.get_template(template.name).render(facts)


CARD = Path(__file__).with_name("card.html")


def card(title: str, facts: Mapping[str, str], remarks: tuple[str, ...] = ()) -> str:
    """Return a box with a title, facts by name, and sentences under them, as HTML."""
    return rendered(CARD, title=title, facts=facts, remarks=remarks)


def data_frame(columns: Mapping[Any, Floats], times: Floats) -> Any:
    """Return a pandas DataFrame with one row a time [s]; names of two parts make two levels.

    Raises:
        UsageError: pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise UsageError("a data frame needs pandas: pip install pandas") from None
    return pandas.DataFrame(dict(columns), index=pandas.Index(times, name="time [s]"))

"""Pages from templates: text is escaped unless it is marked as HTML."""

from pathlib import Path
from typing import Any


def rendered(template: Path, **facts: Any) -> str:
    """Return the page of a Jinja template with its facts; a fact that is missing is an error."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    loader = FileSystemLoader(template.parent)
    pages = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return pages.get_template(template.name).render(facts)

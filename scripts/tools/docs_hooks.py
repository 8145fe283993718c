"""MkDocs hooks: write the command-line reference from the commands themselves.

MkDocs calls `on_page_markdown` for every page. The line `<!-- commands -->` of a page becomes a section for each command.
"""

from collections.abc import Iterator
from typing import Any

import typer.main

from robot_retarget.cli import app

MARKER = "<!-- commands -->"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace the marker of a page by the help of every command."""
    if MARKER not in markdown:
        return markdown
    return markdown.replace(MARKER, "\n".join(section(name, command) for name, command in commands()))


def commands() -> Iterator[tuple[str, Any]]:
    """Yield every command with its full name, sub-commands after their group."""
    yield from _below(typer.main.get_command(app), "robot-retarget")


def _below(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    children = getattr(command, "commands", None)
    if children is None:
        yield name, command
        return
    for child in children.values():
        yield from _below(child, f"{name} {child.name}")


def section(name: str, command: Any) -> str:
    """Return the Markdown of one command: a heading and its help."""
    context = command.make_context(name, [], resilient_parsing=True, max_content_width=100, terminal_width=100)
    return f"## {name}\n\n```text\n{command.get_help(context).strip()}\n```\n"

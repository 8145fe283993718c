"""MkDocs hooks: one page for each command and for each public name, written from the code itself.

MkDocs calls `on_files` once and `on_page_markdown` for every page. The lines `<!-- commands -->` and `<!-- names -->` of a page
become lists of links to these pages, `<!-- figures -->` and `<!-- formats -->` tables.
"""

from collections.abc import Iterator
from typing import Any

import typer.main

import robot_retarget
from robot_retarget.formats import FORMATS
from robot_retarget.scores.score import FIGURES
from robot_retarget.tools.cli import app

GROUPS = {
    "Read": ("read_motion", "Motion", "Skeleton", "write_bvh", "read_scene", "Scene", "load_robot", "Robot"),
    "Describe": ("describe", "RobotGraph", "Graph", "match", "Match"),
    "Solve": (
        "retarget",
        "solve",
        "Result",
        "Solution",
        "stream",
        "Stream",
        "sequence",
        "splice",
        "interaction_distance",
    ),
    "Judge and look": ("simulate", "Report", "score", "Score", "view"),
    "Files and errors": ("Trajectory", "load_trajectory", "export", "RobotRetargetError"),
}
"""Public names by stage; names that are not listed form a group of their own."""
OPTIONS = {
    "Weights": "graph.weights.Weights",
    "SolveOptions": "solver.options.SolveOptions",
    "Search": "solver.options.Search",
    "BalanceOptions": "solver.balance.balanced_ik.BalanceOptions",
    "Playback": "judge.playback.Playback",
    "PlaybackOptions": "servo.outcome.PlaybackOptions",
}
"""Option classes and their modules."""


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages."""
    from mkdocs.structure.files import File

    for name, command in commands():
        files.append(File.generated(config, f"reference/cli/{slug(name)}.md", content=command_page(name, command)))
    for label, path in names():
        files.append(File.generated(config, f"reference/api/{label}.md", content=name_page(label, path)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace the markers of a page by lists of links."""
    for marker, made in (
        ("commands", command_list),
        ("names", name_list),
        ("figures", figure_list),
        ("formats", format_list),
    ):
        markdown = markdown.replace(f"<!-- {marker} -->", made()) if f"<!-- {marker} -->" in markdown else markdown
    return markdown


def format_list() -> str:
    """Return a table of the formats of robot motion."""
    rows = [
        f"| `{one.name}` | {one.suffix or 'folder'} | {one.description} | {one.readers} |" for one in FORMATS.values()
    ]
    return "\n".join(["| format | file | holds | read by |", "|---|---|---|---|", *rows])


def figure_list() -> str:
    """Return a table of the figures of a score."""
    rows = [f"| `{one.name}` | {one.unit or '1'} | {one.better} | {one.what} |" for one in FIGURES.values()]
    return "\n".join(["| figure | unit | better | meaning |", "|---|---|---|---|", *rows])


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


def slug(name: str) -> str:
    """Return the file name of a command's page: `servos-scan` of `robot-retarget servos scan`."""
    return name.removeprefix("robot-retarget ").replace(" ", "-")


def command_page(name: str, command: Any) -> str:
    """Return the Markdown of one command: its whole help."""
    context = command.make_context(name, [], resilient_parsing=True, max_content_width=100, terminal_width=100)
    return f"# {name}\n\n```text\n{command.get_help(context).strip()}\n```\n"


def command_list() -> str:
    """Return a table of all commands with the first sentence of their help."""
    rows = [
        f"| [{name.removeprefix('robot-retarget ')}](cli/{slug(name)}.md) | {(command.help or '').split(chr(10))[0]} |"
        for name, command in commands()
    ]
    return "\n".join(["| command | use |", "|---|---|", *rows])


def groups() -> dict[str, list[str]]:
    """Return the public names by group, each exactly once."""
    placed = {name for group in GROUPS.values() for name in group}
    rest = [name for name in dir(robot_retarget) if name not in placed]
    return {**{title: list(group) for title, group in GROUPS.items()}, **({"More": rest} if rest else {})}


def names() -> Iterator[tuple[str, str]]:
    """Yield what a user types, and the full name of the object."""
    for group in groups().values():
        for name in group:
            value = getattr(robot_retarget, name)
            yield name, f"{value.__module__}.{value.__qualname__}"
    for name, path in OPTIONS.items():
        yield name, f"robot_retarget.{path}"


def name_page(label: str, path: str) -> str:
    """Return the Markdown of one public name under the name that users type."""
    typed = label if label in OPTIONS else f"rr.{label}"
    return f"# {typed}\n\n::: {path}\n    options:\n      heading: {typed}\n      heading_level: 2\n      toc_label: {typed}\n"


def name_list() -> str:
    """Return lists of links to the pages of names, by group."""
    linked = {title: [f"[`rr.{name}`](api/{name}.md)" for name in group] for title, group in groups().items()}
    options = [f"[`{path}`](api/{name}.md)" for name, path in OPTIONS.items()]
    rows = [f"| {title} | {' · '.join(links)} |" for title, links in {**linked, "Options": options}.items()]
    return "\n".join(["| stage | names |", "|---|---|", *rows])

"""The documentation runs: its commands parse, its Python works, its links and its API page are complete."""

import contextlib
import importlib
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
import typer.main
from forked import run
from shared_files import ROOT

import robot_retarget
from robot_retarget.formats import FORMATS
from robot_retarget.judge.verdict import TEXTS
from robot_retarget.tools.cli import app

DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.rglob("*.md"), ROOT / "README.md"])
RUN = ("tutorials/own-mocap.md", "tutorials/own-robot.md", "explanation/graph.md", "how-to/touch-up.md")
"""Pages whose blocks run from top to bottom; each takes seconds."""
FENCE = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s#]+)(?:#[^)]*)?\)")


def blocks(page: Path, *languages: str) -> list[tuple[str, str]]:
    return [(found[1], found[2]) for found in FENCE.finditer(page.read_text(encoding="utf-8")) if found[1] in languages]


def command_lines(text: str) -> list[list[str]]:
    """The words of every robot-retarget command of a block; here-documents, pipes and comments are left out."""
    text = re.sub(r"<<'END'.*?^END$", "", text, flags=re.MULTILINE | re.DOTALL).replace("\\\n", " ")
    lines = []
    for line in text.splitlines():
        if "…" in line:
            continue
        words = shlex.split(line, comments=True)
        starts = [k for k, word in enumerate(words) if Path(word).name == "robot-retarget" and word != "-v"]
        for start in starts:
            stop = next(
                (k for k in range(start, len(words)) if words[k] in ("|", "&", "&&", "||", ";", ">")), len(words)
            )
            lines.append(words[start + 1 : stop])
    return lines


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


COMMANDS = [
    pytest.param(words, id=f"{named(page)}: {' '.join(words)[:60]}")
    for page in PAGES
    for _, text in blocks(page, "sh", "bash")
    for words in command_lines(text)
]


@pytest.mark.parametrize("words", COMMANDS)
def test_every_command_of_the_docs_parses(words: list[str]) -> None:
    command: Any = typer.main.get_command(app)
    context = command.make_context("robot-retarget", [words[0] if words else "--help"], resilient_parsing=True)
    while getattr(command, "commands", None) is not None and words:
        assert words[0] in command.commands, f"no command {words[0]!r}"
        command, words = command.commands[words[0]], words[1:]
    with contextlib.suppress(typer.Exit):  # --list and --help end the command
        command.make_context(command.name, list(words), parent=context)


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_python_of_the_docs_names_what_there_is(page: Path) -> None:
    for _, text in blocks(page, "python"):
        compile(text, named(page), "exec")
        for name in set(re.findall(r"\brr\.(\w+)", text)):
            assert name in dir(robot_retarget), f"{named(page)}: rr.{name}"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_lead_to_files(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if not re.match(r"[a-z]+:", target):
            assert (page.parent / target).exists(), f"{named(page)}: {target}"


def test_every_public_name_has_a_page_and_is_listed_once() -> None:
    hooks = runpy.run_path(str(ROOT / "scripts" / "tools" / "docs_hooks.py"))
    listed = [name for group in hooks["groups"]().values() for name in group]
    assert sorted(listed) == sorted(dir(robot_retarget))
    assert {label for label, _ in hooks["names"]()} >= set(listed)
    for _, path in hooks["names"]():
        module, _, name = path.rpartition(".")
        assert hasattr(importlib.import_module(module), name), path


@pytest.mark.parametrize("page", RUN)
def test_blocks_of_a_page_run_from_top_to_bottom(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROOT / "samples", tmp_path / "samples")
    monkeypatch.chdir(tmp_path)
    for language, text in blocks(DOCS / page, "sh", "python"):
        if language == "python":
            exec(compile(text, page, "exec"), {})
            continue
        for part in re.split(r"^(robot-retarget .*\n)", text, flags=re.MULTILINE):
            if not part.startswith("robot-retarget"):
                subprocess.run(["bash", "-e", "-c", part], check=True, timeout=60)
            elif not part.startswith("robot-retarget view"):
                ran = run(*shlex.split(part)[1:], cwd=tmp_path)
                assert ran.returncode == 0, f"{part}\n{ran.stdout}\n{ran.stderr}"


def test_the_table_of_tested_robots_is_the_recorded_one() -> None:
    script = [sys.executable, str(ROOT / "scripts" / "tools" / "readme_table.py"), "--check"]
    checked = subprocess.run(script, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout


def test_every_verdict_is_counted_in_the_table_of_tested_robots() -> None:
    script = runpy.run_path(str(ROOT / "scripts/tools/readme_table.py"))
    for _, parts, *_ in script["HEADS"].values():
        cell = script["verdict_cell"](parts, [f"{text} (free)" for text in (*TEXTS.values(), "fail")])
        assert [int(count) for count in re.findall(r"\d+", cell)] == [2, 1, 1, 2, 6]
        with pytest.raises(ValueError, match="'passes'"):
            script["verdict_cell"](parts, ["passes"])


def test_counts_of_the_readmes_are_those_of_the_lists() -> None:
    robots = len((ROOT / "scripts/figures/robots.csv").read_text("utf-8").splitlines()) - 1
    for page, humanoids, formats in (
        ("README.md", "[{} humanoids", "{} [formats]"),
        ("README.zh.md", "[已试过 {} 个", "{} 种[格式]"),
    ):
        text = (ROOT / page).read_text("utf-8")
        assert humanoids.format(robots) in text and formats.format(len(FORMATS)) in text, page


def test_both_readmes_have_the_same_sections_commands_and_figures() -> None:
    english, chinese = (ROOT / name for name in ("README.md", "README.zh.md"))
    for pattern in (r"^## ", r"^!\[", r"^\d\. \*\*"):
        assert len(re.findall(pattern, english.read_text("utf-8"), re.M)) == len(
            re.findall(pattern, chinese.read_text("utf-8"), re.M)
        )
    assert blocks(english, "sh", "python", "text") == blocks(chinese, "sh", "python", "text")
    numbers = [sorted(re.findall(r"\d+\.\d+", page.read_text("utf-8"))) for page in (english, chinese)]
    assert numbers[0] == numbers[1]


def test_a_release_in_the_changelog_has_at_most_600_words() -> None:
    """Git merges the file as a union, which keeps lines that the other side deleted."""
    _, *releases = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")[1:]
    assert not {release.split("\n")[0]: len(release.split()) for release in releases if len(release.split()) > 600}

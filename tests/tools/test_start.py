"""The first commands of README work on a machine that has Python, make and a clone."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from shared_files import ROOT

from robot_retarget.base.errors import extra_requirements, install_line

EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
README = (ROOT / "README.md").read_text()
PAGES = [ROOT / "README.md", ROOT / "README.zh.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(text: str) -> list[str]:
    """The shell blocks of a page."""
    return re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL)


def test_the_second_block_enters_the_environment_that_the_first_makes() -> None:
    first, second, *_ = blocks(README)
    made, *used = first.splitlines()
    assert made == "make demo" and all(line.startswith(".venv/bin/robot-retarget ") for line in used)
    assert second.startswith(". .venv/bin/activate\n")
    assert "VENV := .venv\n" in (ROOT / "Makefile").read_text()


def test_the_demo_installs_nothing_of_developers(tmp_path: Path) -> None:
    planned = subprocess.run(["make", "-n", "demo"], cwd=copied(tmp_path), capture_output=True, text=True).stdout
    (wanted,) = re.findall(r"install --editable '\.\[(.*?)\]'", planned)
    assert set(wanted.split(",")) <= {"plots", "video", "view"}


def test_an_older_python_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    clone, old = copied(tmp_path), tmp_path / "python3"
    old.write_text('#!/bin/sh\n[ "$1" = --version ] && echo "Python 3.10.12" && exit\nexit 1\n')
    old.chmod(0o755)
    done = subprocess.run(["make", "demo", f"PYTHON={old}"], cwd=clone, capture_output=True, text=True)
    assert done.returncode == 2 and "Python 3.10.12" in done.stdout and "make demo PYTHON=python3.11" in done.stdout
    assert not (clone / ".venv").exists()


def copied(folder: Path) -> Path:
    """A folder with the Makefile alone."""
    clone = folder / "clone"
    clone.mkdir()
    for name in ("Makefile", "pyproject.toml"):
        (clone / name).write_bytes((ROOT / name).read_bytes())
    return clone


@pytest.mark.parametrize("extra", sorted({*EXTRAS} - {"dev"}))
def test_the_command_for_a_missing_extra_names_the_packages_that_it_consists_of(extra: str) -> None:
    names = {re.split(r"[^\w-]", line)[0].replace("_", "-").lower() for line in EXTRAS[extra]}
    assert {re.split(r"[^\w-]", line)[0].replace("_", "-").lower() for line in extra_requirements(extra)} == names
    line = install_line(extra)
    assert line.startswith(f"{sys.executable} -m pip install ") and "humanoid-retarget" not in line


def test_no_page_installs_a_name_that_is_not_on_the_index() -> None:
    for page in PAGES:
        assert not re.search(r"pip install[^\n]*humanoid-retarget", page.read_text()), page


@pytest.mark.parametrize("plugin", sorted((ROOT / "plugins").iterdir()), ids=lambda path: path.name)
def test_a_plugin_depends_on_this_clone(plugin: Path) -> None:
    from hatchling.metadata.core import ProjectMetadata
    from hatchling.plugin.manager import PluginManager

    metadata = ProjectMetadata(str(plugin), PluginManager())
    own = next(line for line in metadata.core.dependencies if line.startswith("humanoid-retarget"))
    assert own.partition("@")[2].strip() == ROOT.as_uri()

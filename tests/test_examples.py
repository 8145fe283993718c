"""The examples run as described, and docs/papers.md shows them unchanged."""

import json
import re
import runpy
from typing import Any

import numpy as np
import pytest
from shared_files import ROOT

from robot_retarget.papers import distances, formation_rigidity, stress

EXAMPLES = ROOT / "examples"


def ran(name: str) -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))


def test_a_crowd_keeps_apart_and_goes_where_it_went() -> None:
    found = ran("crowd")
    before, after = found["walkers"], found["crowd"].positions
    assert distances(found["apart"], before).min() < 0.2
    apart = np.linalg.norm(after[:, :, None] - after[:, None], axis=-1)[:, *np.triu_indices(10, 1)]
    assert apart.min() > 0.5 - 1e-3
    assert np.linalg.norm(after[[0, -1]] - before[[0, -1]], axis=-1).max() < 0.5


def test_longer_arms_clap_without_running_into_each_other() -> None:
    found = ran("posture")
    left, right = found["hands"]
    near = {
        name: np.linalg.norm(x[:, left] - x[:, right], axis=1).min()
        for name, x in (
            ("human", found["motion"].positions),
            ("turned", found["turned"]),
            ("clap", found["clap"].positions),
        )
    }
    assert near["turned"] < 0.01 < 0.03 < near["clap"] < 1.2 * near["human"]
    assert found["clap"].stress < 0.1 * stress(found["graph"], found["motion"].positions)


def test_a_formation_stays_rigid_past_an_obstacle() -> None:
    found = ran("formation")
    assert formation_rigidity(found["team"], found["x"]).min() < 1e-4
    assert formation_rigidity(found["team"], found["rigid"].positions).min() > 0.0045
    rock, robots = found["x"][:, 6:], found["rigid"].positions[:, :6]
    assert np.linalg.norm(robots - rock, axis=-1).min() > 0.149
    np.testing.assert_array_equal(found["rigid"].positions[:, 6:], rock)


FIRST_STEPS = sorted(path.stem for path in EXAMPLES.glob("[0-9]*_*.py"))


@pytest.mark.parametrize("name", FIRST_STEPS)
def test_first_steps_run_and_are_short(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith('"""') and lines[0].endswith('."""') and len(lines) <= 60
    found = ran(name)
    assert capsys.readouterr().out.strip()
    assert (
        name != "03_add_an_edge" or abs(found["distances"]["after"] - 0.2) < 0.02 < found["distances"]["before"] - 0.2
    )


def test_the_notebook_runs_from_top_to_bottom() -> None:
    notebook = json.loads((EXAMPLES / "first_steps.ipynb").read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    names: dict[str, Any] = {}
    for cell in cells:
        exec(compile(cell, "first_steps.ipynb", "exec"), names)
    assert names["report"].verdict == "pass" and not any(c.get("outputs") for c in notebook["cells"])


def test_first_steps_are_numbered_without_a_gap() -> None:
    assert [int(name[:2]) for name in FIRST_STEPS] == list(range(1, 11))


@pytest.mark.parametrize("name", ["crowd", "posture", "formation"])
def test_the_page_shows_the_three_lines_of_every_example(name: str) -> None:
    page = (ROOT / "docs/papers.md").read_text(encoding="utf-8")
    blocks = [block.strip().splitlines() for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL)]
    code = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8").splitlines()
    assert any(
        block[0] == f"# examples/{name}.py" and len(block) == 4 and set(block[1:]) <= set(code) for block in blocks
    )

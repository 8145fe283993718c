"""However a robot is written down, the same robot is recognised: every law of `scripts/bench/robot_variants.py`.

The shipped robot has every law, and every law three of the shared robots; `check_robots.py` takes all laws with all robots.
"""

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_files import ROOT, SHARED, needs_shared

from robot_retarget.robot import load_robot, recognise

SCRIPTS = ROOT / "scripts" / "bench"
OP3 = load_robot("op3").path
SHARED_ROBOTS = sorted((SHARED / "robots").glob("*/*.xml"))


LYING = "lying in the reference pose"
"""Legs without a body over them may stand either way up: that is said."""


@pytest.fixture(scope="module")
def checks() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(SCRIPTS))
        yield runpy.run_path(str(SCRIPTS / "check_robots.py"))


def violations(checks: Any, path: Path, law: str, folder: Path) -> tuple[int, list[str]]:
    robot = load_robot(path)
    case = checks["Case"](robot, recognise(robot), np.random.default_rng(0))
    found = [checks["check"](case, law, variant, folder) for variant in checks["LAWS"][law](case)]
    wrong = [f for f in found if f.wrong and not (law == LYING and f.said)]
    return len(found), [f"{f.detail}: {'; '.join(f.wrong)}" for f in wrong]


LAWS = [
    "joint anchors moved along their axes",
    "body frames moved along their axes",
    "joint angles counted from elsewhere",
    "names changed",
    "the model turned about z",
    "another keyframe",
    "no head, arms, waist",
    "no sites, actuators",
    "no root joint",
    LYING,
    "elbows as ball joints",
    "hands as frames",
]


@pytest.mark.parametrize("law", LAWS)
def test_the_shipped_robot_is_recognised_however_it_is_written(checks: Any, law: str, tmp_path: Path) -> None:
    count, wrong = violations(checks, OP3, law, tmp_path)
    assert count and not wrong


@needs_shared
@pytest.mark.parametrize(
    ("number", "path"), [pytest.param(k, path, id=path.stem) for k, path in enumerate(SHARED_ROBOTS)]
)
def test_shared_robots_are_recognised_however_they_are_written(
    checks: Any, number: int, path: Path, tmp_path: Path
) -> None:
    assert list(checks["LAWS"]) == LAWS
    assert [w for law in LAWS[number % 3 :: 3] for w in violations(checks, path, law, tmp_path)[1]] == []

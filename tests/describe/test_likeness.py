"""What likeness says of motions whose unlikeness is known."""

from typing import Any

import numpy as np
import pytest
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.describe.likeness import likeness_of
from robot_retarget.describe.path import pelvis_path
from robot_retarget.simulate.report import unlikeness
from robot_retarget.simulate.thresholds import Thresholds


@pytest.fixture(scope="module")
def walk() -> rr.Graph:
    return rr.describe(rr.read_motion(ROOT / "samples/walk.bvh"), rr.load_robot("op3"))


def placed(graph: rr.Graph, share: float) -> np.ndarray:
    """(T, nq) a stiff robot that is pushed along a share of the human's path."""
    qpos = np.tile(graph.robot.standing(), (len(graph), 1))
    root = graph.robot.root_address
    qpos[:, root : root + 2] = share * pelvis_path(graph.human, graph.match)[:, :2]
    return qpos


@pytest.mark.parametrize("share", [1.0, 0.5, 0.0, -1.0])
def test_the_path_is_off_by_what_was_left_out_of_it(walk: rr.Graph, share: float) -> None:
    path = pelvis_path(walk.human, walk.match)[:, :2]
    way = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    expected = abs(1 - share) * np.linalg.norm(path - path[0], axis=1).mean() / way
    assert likeness_of(walk, placed(walk, share)).path == pytest.approx(expected, abs=1e-9)


def test_feet_that_stand_are_asked_for_no_steps_and_no_path(walk: rr.Graph) -> None:
    figures = likeness_of(walk, placed(walk, 0.0), legs="stand").figures()
    assert figures["path_off"] is None and figures["steps_shortened"] is None


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"stride": 0.3}, "steps shorter than the human's, scaled, by: 70 %, more than 60 %"),
        ({"unfinished": 0.4}, "frames that were not solved to the end: 40 %, more than 25 %"),
        ({"slowdown": 3.0}, "it takes 3.0 times as long as the human"),
    ],
)
def test_each_bound_has_a_sentence(walk: rr.Graph, given: dict[str, Any], told: str) -> None:
    figures = likeness_of(walk, placed(walk, 1.0), **given).figures()
    assert told in unlikeness(figures, Thresholds())
    assert told not in unlikeness(likeness_of(walk, placed(walk, 1.0)).figures(), Thresholds())

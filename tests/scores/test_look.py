"""After solving, a look: a robot that faces, stands or bends the other way is told from one that follows."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.arrays import unit
from robot_retarget.base.errors import MatchError
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph import describe as graph_module
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.scores.plausibility import _elbows, mismatch, plausibility_checks
from robot_retarget.solver.pipeline import Result, retarget


@cache
def solved(clip: str) -> Result:
    return retarget(read_motion(SAMPLES / f"{clip}.bvh").resample(10), load_robot("op3"), balance="off")


def wrong(result: Result, qpos: np.ndarray) -> set[str]:
    return {g.what for g in plausibility_checks(result.graph.human, result.robot, qpos) if g.wrong}


@pytest.mark.parametrize("clip", ["walk", "wave", "clap", "squat", "hips_and_bow"])
def test_what_follows_is_not_doubted(clip: str) -> None:
    result = solved(clip)
    assert not result.doubt and not any(
        g.against > 0.1 for g in plausibility_checks(result.graph.human, result.robot, result.trajectory.qpos)
    )


@pytest.mark.parametrize(
    ("axis", "seen"),
    [
        ("z", {"its pelvis faces the other way", "its chest faces the other way"}),
        ("y", {"its head is where the human's feet are"}),
    ],
)
def test_a_robot_that_is_turned_round_or_upside_down_is_seen(axis: str, seen: set[str]) -> None:
    result = solved("squat")
    turned = np.array(result.trajectory.qpos)
    own = Rotation.from_quat(turned[:, 3:7], scalar_first=True)
    turned[:, 3:7] = (Rotation.from_euler(axis, np.pi) * own).as_quat(scalar_first=True)
    assert seen <= wrong(result, turned)
    assert "map file" in mismatch(result.graph.human, result.robot, turned, "") or axis == "y"


def test_knees_that_bend_the_other_way_are_seen() -> None:
    result = solved("squat")
    bent = np.array(result.trajectory.qpos)
    knees = [result.robot.qpos_index[result.robot.joint_names.index(f"{side}_knee")] for side in "lr"]
    bent[:, knees] *= -1
    assert {f"its {side} knee does not bend that way" for side in ("left", "right")} <= wrong(result, bent)


def test_arms_that_have_changed_places_are_seen() -> None:
    result = solved("squat")
    match, human = result.match, result.match.human_positions(result.motion)
    swapped = human.copy()
    for part in ("shoulder", "elbow", "hand"):
        left, right = match.index(f"l_{part}"), match.index(f"r_{part}")
        if part != "shoulder":
            swapped[:, [left, right]] = human[:, [right, left]]
    own = {k: human[:, i] for i, k in enumerate(match.keypoints)}
    there = {k: swapped[:, i] for i, k in enumerate(match.keypoints)}
    line = unit(own["l_shoulder"] - own["r_shoulder"])
    assert _elbows(there, own, line, line, "").wrong
    assert not _elbows(own, own, line, line, "").wrong


def test_a_robot_that_cannot_cross_its_arms_is_not_doubted() -> None:
    result = solved("squat")
    human = result.match.human_positions(result.motion)
    own = {k: human[:, i] for i, k in enumerate(result.match.keypoints)}
    crossed = own | {"l_hand": own["r_hand"], "r_hand": own["l_hand"]}
    line = unit(own["l_shoulder"] - own["r_shoulder"])
    assert not _elbows(crossed, own, line, line, "").wrong


ROBOTS = {
    "op3": Path("op3"),
    "g1": SHARED / "robots/unitree_g1/unitree_g1.xml",
}


@needs_shared
@pytest.mark.parametrize(("name", "clip"), [("op3", "walk"), ("g1", "squat")])
def test_a_robot_taken_back_to_front_is_refused_unless_the_map_insists(
    name: str, clip: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its knees come to their stops: it can neither walk nor squat facing away."""
    robot, motion = load_robot(ROBOTS[name]), read_motion(SAMPLES / f"{clip}.bvh").resample(10).frames(0, 50)
    turned = tmp_path / "map.toml"
    turned.write_text("[robot]\nforward = [-1, 0, 0]\n")
    result = retarget(motion, robot, overrides=turned, balance="off")
    assert "knee does not bend that way" in result.notes[0] and "forward = [x, y, z]" in result.notes[0]
    monkeypatch.setattr(graph_module, "match", lambda *_: result.match)
    with pytest.raises(MatchError, match=r"does not do what .* shows"):
        retarget(motion, robot, balance="off")

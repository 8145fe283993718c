"""The scripts that measure the solver run, and their figures are what they say."""

import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.robot import world_points
from robot_retarget.solver.solve import solve_graph
from robot_retarget.solver.starts import place_root

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts" / "bench"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Loads a script of the folder by its name."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    return lambda name: runpy.run_path(str(SCRIPTS / f"{name}.py"))


def clip(frames: int = 12) -> rr.Motion:
    return rr.read_motion(SAMPLES / "clap.bvh").frames(40, 40 + frames)


def test_the_bench_measures_clips_and_where_their_time_goes(script: Any) -> None:
    bench = script("bench_solve")
    case = bench["prepare"](clip(), rr.load_robot("op3"))
    rows = bench["speeds"](case, 1, False)
    assert [row.split(" | ")[1] for row in rows] == ["whole clip"]
    assert all(float(row.split(" | ")[2]) > 0 for row in rows)
    shares = [float(row.strip("| ").split("|")[-1]) for row in bench["shares"](case) if "of all that" not in row]
    assert sum(shares) == pytest.approx(100, abs=len(shares))  # rounded


@pytest.mark.parametrize("mode", ["whole clip", "stream"])
def test_every_part_of_a_profile_is_met(script: Any, mode: str) -> None:
    """A function that the solver no longer calls would leave its time to another part."""
    bench, robot = script("bench_solve"), rr.load_robot("op3")
    parts = script("bench_stream")["PARTS"] if mode == "stream" else bench["PARTS"]
    with bench["clocked"](parts) as spent:
        if mode == "stream":
            list(rr.stream(robot, clip()))
        else:
            solve_graph(bench["prepare"](clip(), robot))
    assert {part for part, used in spent.items() if not used.calls} <= {"closed chains, gears"}


def test_clocks_leave_the_solver_as_it_was(script: Any) -> None:
    bench = script("bench_solve")
    before = [getattr(owner, name) for places in bench["PARTS"].values() for owner, name in places]
    with bench["clocked"]():
        pass
    assert before == [getattr(owner, name) for places in bench["PARTS"].values() for owner, name in places]


def test_the_peer_brings_the_keypoints_to_the_rebuilt_posture(script: Any) -> None:
    pytest.importorskip("mink")
    bench, robot = script("bench_solve"), rr.load_robot("op3")
    case = bench["prepare"](clip(4), robot)
    run, start = bench["inverse_kinematics"](case), robot.standing()
    (placed,) = place_root(case, start, [0])
    reached, standing = (world_points(robot, case.match.points, q) for q in (run.qpos, placed[None]))
    away, before = (np.linalg.norm(x - bench["rebuilt"](case), axis=2).mean() for x in (reached, standing))
    assert away < before / 2
    assert 1 <= run.steps <= bench["FIRST_STEPS"]


def test_a_rebuilt_posture_has_the_robots_bones_and_the_humans_directions(script: Any) -> None:
    bench = script("bench_solve")
    case = bench["prepare"](clip(3), rr.load_robot("op3"))
    points, human, matched = bench["rebuilt"](case), case.match.human_positions(case.motion), case.match
    children = np.flatnonzero(matched.parents >= 0)
    parents = matched.parents[children]
    bones, theirs = points[:, children] - points[:, parents], human[:, children] - human[:, parents]
    assert np.allclose(np.linalg.norm(bones, axis=2), matched.robot_bones[children], atol=1e-9)
    lengths = np.linalg.norm(bones, axis=2) * np.linalg.norm(theirs, axis=2)
    assert np.allclose((bones * theirs).sum(2), lengths, atol=1e-9)


def test_every_kind_left_out_fills_a_row(script: Any) -> None:
    ablation = script("ablation")
    lines = ablation["rows"]([clip(8)], rr.load_robot("op3"), ["everything", "no compass"])
    assert [line.count("|") for line in lines] == [11, 11]
    assert lines[0].startswith("| everything | ") and lines[1].startswith("| no compass | ")


def test_without_separation_hands_go_through_each_other_and_the_table_says_so(script: Any) -> None:
    ablation = script("ablation")
    through = ablation["measure"](clip(30), rr.load_robot("op3"), ablation["VARIANTS"]["no separation"])
    assert through.overlap_pct > 10 and through.depth_cm > 1


def test_a_robot_compared_with_itself_has_no_error(script: Any) -> None:
    judge = script("retarget_figures")["figures"]
    robot = rr.load_robot("op3")
    result = rr.retarget(clip(6), robot, balance="off")
    matched, qpos = result.match, result.trajectory.qpos
    itself = world_points(robot, matched.points, qpos) * matched.human_leg / matched.robot_leg
    found = judge(robot, matched, itself, qpos, 30.0)
    assert found.limb_deg < 1e-3  # arccos near 1 loses half the digits
    still = judge(robot, matched, itself, np.repeat(qpos[:1], 6, axis=0), 30.0)
    assert still.jerk == still.step_rad == 0.0 and not still.skate_cm_s > 0.0  # NaN where no foot of the human stands


def test_the_pages_pictures_are_there_and_small() -> None:
    page = SCRIPTS.parents[1] / "docs/retargeting.md"
    pictures = [page.parent / name for name in re.findall(r"!\[.*?\]\((.*?)\)", page.read_text(encoding="utf-8"))]
    assert len(pictures) == len(set(pictures)) == 3
    assert sum(picture.stat().st_size for picture in pictures) < 1_200_000


def test_the_stream_bench_measures_every_way_and_where_its_time_goes(script: Any) -> None:
    bench, robot, motion = script("bench_stream"), rr.load_robot("op3"), clip()
    rows = bench["rows"](robot, motion, 30.0, 1, False)
    assert [row.split(" | ")[1] for row in rows] == ["stream", "stream", "lag of 3"]
    assert all(float(row.split(" | ")[3]) > 0 for row in rows)
    shares = [float(row.strip("| ").split("|")[-1]) for row in bench["shares"](robot, motion, 30.0)]
    assert sum(shares) == pytest.approx(100, abs=len(shares))

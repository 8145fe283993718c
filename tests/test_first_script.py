"""The first lines that a script has: look, save, cut, print."""

from inspect import signature
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from made_trajectories import wander
from typer.main import get_command

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.graph import EdgeError
from robot_retarget.tools.cli import options
from robot_retarget.tools.cli.command import app

OP3 = rr.load_robot("op3")


def test_a_trajectory_and_its_file_are_looked_at_as_a_result_is(tmp_path: Path) -> None:
    result = rr.retarget(rr.read_motion(SAMPLES / "wave.bvh").frames(0, 8), OP3, balance="off")
    path = result.save(tmp_path / "wave.npz")
    takes = rr.view(path, result.trajectory, result, str(path)).takes
    assert len(takes) == 4 and all(np.array_equal(one.trajectory.qpos, result.trajectory.qpos) for one in takes)
    assert rr.load_trajectory(path).qpos.tobytes() == result.trajectory.qpos.tobytes()


def test_a_trajectory_of_an_unknown_robot_names_the_way_out() -> None:
    from dataclasses import replace

    with pytest.raises(rr.RobotRetargetError, match="nobody"):
        rr.view(replace(wander(OP3), robot="nobody"))
    assert rr.view(replace(wander(OP3), robot="nobody"), robot=OP3).takes[0].robot is OP3


@pytest.mark.parametrize(("start", "stop"), [(0.5, 1.5), (0.0, 1.0), (1.0, None)])
def test_a_part_by_times_is_the_part_by_frames(start: float, stop: float | None) -> None:
    motion = rr.read_motion(SAMPLES / "wave.bvh")
    first, last = round(start * motion.fps), len(motion) if stop is None else round(stop * motion.fps)
    np.testing.assert_array_equal(motion.frames(start, stop).positions, motion.positions[first:last])


def test_an_edge_that_costs_most_is_printed_in_one_short_line() -> None:
    edge = EdgeError(
        "l_hand – head", 12, np.float64(0.123456789), np.float64(0.2), np.float64(0.7654321), np.float64(4)
    )
    assert len(repr(edge)) < 100 and "l_hand – head" in repr(edge) and "0.123" in repr(edge) and "np." not in repr(edge)


def test_the_shell_offers_the_words_that_python_takes() -> None:
    shell = get_type_hints(options.GraphOptions) | get_type_hints(options.FollowOptions)
    python = get_type_hints(rr.retarget)
    for name in ("legs", "balance", "preset", "terrain"):
        assert shell[name] == python[name] and len(get_args(shell[name])) > 1
    other = {"motion", "robot", "weights", "kinds", "frames"}
    assert set(options.GraphOptions().arguments()) == signature(rr.describe).parameters.keys() - other


@pytest.mark.parametrize("function", [rr.describe, rr.solve, rr.retarget, rr.transfer, rr.sequence, rr.splice])
def test_a_function_shows_its_keywords_and_their_defaults(function: Any) -> None:
    given = signature(function).parameters.values()
    assert not [one.name for one in given if one.kind is one.VAR_KEYWORD]
    assert all(one.default is not one.empty for one in given if one.kind is one.KEYWORD_ONLY)
    assert all(one.name in str(function.__doc__) for one in given)


def test_retarget_has_the_defaults_of_the_functions_that_it_calls() -> None:
    whole = signature(rr.retarget).parameters
    for part in (rr.describe, rr.solve):
        for name, one in signature(part).parameters.items():
            assert name in ("kinds", "graph") or whole[name] == one


SHELL = {
    "batch": rr.retarget,
    "graph": rr.describe,
    "simulate": rr.simulate,
    "solve": rr.retarget,
    "stream": rr.Stream,
    "transfer": rr.transfer,
    "edit join": rr.sequence,
    "edit splice": rr.splice,
}
"""The function of a command."""
APART = {("batch", "balance")}
"""Data sets follow the human frame by frame (docs/balance.md)."""


@pytest.mark.parametrize("command", SHELL)
def test_an_option_has_the_default_of_the_keyword(command: str) -> None:
    found: Any = get_command(app)
    for word in command.split():
        found = found.commands[word]
    shell, python = {each.name: each.default for each in found.params}, signature(SHELL[command]).parameters
    both = {n: one.default for n, one in python.items() if n in shell and one.kind is one.KEYWORD_ONLY}
    assert both
    for name in both.keys() - {"robot"}:
        agree = (shell[name] or None) == (both[name] or None) or (shell[name], both[name]) == ("human", None)
        assert agree is ((command, name) not in APART), name


@pytest.mark.parametrize("frames", [(30, 40), (1.0, 1.0 + 1 / 3), "30:40", "1s:1.34s"])
def test_retarget_takes_a_part_of_a_motion_as_the_shell_does(frames: Any) -> None:
    motion = rr.read_motion(SAMPLES / "wave.bvh")
    graph = rr.describe(motion, OP3, frames=frames)
    assert motion.fps == 30 and len(graph) == 10
    np.testing.assert_array_equal(graph.motion.positions, motion.positions[30:40])


@pytest.mark.parametrize("function", [rr.describe, rr.retarget])
def test_an_unknown_keyword_is_refused_by_name(function: Any) -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'presett'"):
        function(SAMPLES / "wave.bvh", OP3, presett="balanced")


def test_a_trajectory_is_saved_under_its_own_suffix_only(tmp_path: Path) -> None:
    with pytest.raises(rr.RobotRetargetError, match=r"its name has to end in \.npz; `export` writes"):
        wander(OP3).save(tmp_path / "x.csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("take", [rr.view, rr.simulate, rr.load_trajectory, rr.score])
def test_a_motion_in_place_of_a_trajectory_is_called_so(take: Any) -> None:
    with pytest.raises(rr.RobotRetargetError, match=r"wave\.bvh: not a trajectory \(\.npz\); `retarget` makes one"):
        take(SAMPLES / "wave.bvh")

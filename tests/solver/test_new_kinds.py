"""A new kind is one class: each role, form and stencil is honoured frame by frame in clip, stream and balance, or refused."""

import os
import re
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import mujoco
import numpy as np
import pytest
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import GraphError
from robot_retarget.base.files import SAMPLES
from robot_retarget.edit.touchup import apply_edit
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.edits import Edit
from robot_retarget.graph.kind import Form, Kind, MeasureRows, RetargetContext, Role, RowState, Track, exact
from robot_retarget.graph.kinds import clip_kinds, stream_kinds
from robot_retarget.graph.kinds.joints import SmoothnessKind
from robot_retarget.graph.kinds.separation import SeparationKind
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import limit
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot, world_points
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.problem import build_problem
from robot_retarget.solver.solution import Solution
from robot_retarget.solver.solve import solve_graph


def clip() -> Motion:
    """A hand rises and waves."""
    return read_motion(SAMPLES / "wave.bvh").frames(12, 42)


def lowered() -> Motion:
    """The hand comes down again, to the trunk."""
    motion = read_motion(SAMPLES / "wave.bvh")
    return motion.frames(len(motion) - 42, len(motion) - 12).resample(10)


def described(*new: Kind, motion: Motion | None = None) -> RobotGraph:
    return rr.describe(motion or clip(), load_robot("op3"), kinds=(*clip_kinds(), *new))


@cache
def plain() -> Solution:
    return solve_graph(described())


def streamed(*new: Kind, motion: Motion | None = None) -> Floats:
    """(T, nq) by the public stream."""
    motion = motion or clip()
    live = rr.Stream(
        load_robot("op3"), motion.skeleton, calibration=motion, kinds=(*stream_kinds(), *new), native=False
    )
    turns = motion.rotations
    assert turns is not None
    return np.array([live.push(x, turns[t], time=t / motion.fps).qpos for t, x in enumerate(motion.positions)])


def raised(context: RetargetContext) -> Floats:
    """(T, 1) how far the human's hand is raised, from 0 to about 1; of all frames of a clip or of one of a stream."""
    hand = context.match.leg_ratio * context.human.positions[:, context.match.index("r_hand"), 2]
    return (hand[:, None] - 0.22) / 0.18


def hand(qpos: Floats) -> Floats:
    """(T, 1) height of the hand by MuJoCo [m]."""
    graph = plain().graph
    return world_points(graph.robot, graph.match.points, qpos)[:, [graph.match.index("r_hand")], 2]


def elbow(qpos: Floats) -> Floats:
    """(…, 1) angle of the elbow [rad]."""
    robot = plain().graph.robot
    return qpos[..., [robot.qpos_index[robot.joint_names.index("r_el")]]]


def change(value: Floats) -> Floats:
    """(T, 1) from the frame before."""
    return np.diff(value, axis=0, prepend=value[:1])


@dataclass(frozen=True)
class Below(Kind):
    """The hand stays below a height that rises with the human's hand, but less: loose at first, tight later."""

    name: str = "below"
    role = Role.INEQUALITY

    def targets(self, context: RetargetContext) -> Track:
        top = 0.18 + 0.14 * raised(context)
        return limit(self, [("r_hand", "floor")], -np.inf, np.inf, len(top)).bounded(-np.inf, top)

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        return body.keypoint("r_hand")[2]

    def value(self, qpos: Floats, fps: float) -> Floats:
        return hand(qpos)


@dataclass(frozen=True)
class Low(Below):
    """The same as a cost."""

    name: str = "low"
    role = Role.COST

    def targets(self, context: RetargetContext) -> Track:
        return exact(self, [("r_hand", "floor")], 0.18 + 0.14 * raised(context), 1e3, context.leg)


@dataclass(frozen=True)
class Elbow(Kind):
    """A cost that CasADi does not see: the elbow bends as the human's hand rises."""

    name: str = "elbow"
    form = Form.NUMERIC

    def targets(self, context: RetargetContext) -> Track:
        return exact(self, [("r_el", "zero")], 0.7 * raised(context), 100.0)

    def rows(self, track: Track, state: RowState) -> MeasureRows | None:
        slope = np.zeros((1, state.robot.model.nv))
        slope[0, state.robot.dof_index[state.robot.joint_names.index("r_el")]] = 1.0
        return MeasureRows(elbow(state.qpos), slope, [0])

    def value(self, qpos: Floats, fps: float) -> Floats:
        return elbow(qpos)


@dataclass(frozen=True)
class Bent(Elbow):
    """A numeric inequality, relaxed by the slack of separation: the elbow is bent at first, and more later."""

    name: str = "bent"
    role = Role.INEQUALITY

    def targets(self, context: RetargetContext) -> Track:
        return limit(self, [("r_el", "zero")], -np.inf, np.inf, len(context.human)).bounded(
            0.5 + 0.7 * raised(context), np.inf
        )


@dataclass(frozen=True)
class Narrow(Bent):
    """The same as a bound."""

    name: str = "narrow"
    role = Role.BOUND
    form = Form.JOINT


@dataclass(frozen=True)
class Slow(Narrow):
    """A bound on the speed that falls as the hand rises."""

    name: str = "slow"
    stencil = (-1, 0)

    def targets(self, context: RetargetContext) -> Track:
        most = 3.0 - 1.5 * raised(context)
        return limit(self, [("r_el", "a frame before")], -np.inf, np.inf, len(most)).bounded(-most, most)

    def value(self, qpos: Floats, fps: float) -> Floats:
        return fps * change(elbow(qpos))


class Renamed(SmoothnessKind):
    """A second kind of second differences."""

    name = "renamed"


COSTS = (Low(), Elbow())
LIMITS = (Below(), Bent(), Narrow(), Slow())


def named(kind: Kind) -> str:
    return kind.name


def misses(graph: RobotGraph, kind: Any, qpos: Floats) -> Floats:
    """(T,) by how much the edge of a kind misses its interval, where its priority is at its highest."""
    track, value = graph.kinds[kind.name], kind.value(qpos, graph.fps)
    whole = track.present & (track.priority >= track.priority.max())
    return (np.abs(value - np.clip(value, track.lower, track.upper)) * whole)[:, 0]


@cache
def plain_stream() -> Floats:
    return streamed()


@pytest.mark.parametrize("kind", COSTS, ids=named)
def test_a_cost_follows_its_own_targets_in_clip_and_stream(kind: Kind) -> None:
    graph = described(kind)
    found = solve_graph(graph, smoothing=Smoothing(steps=8))
    off, plainly = (misses(graph, kind, each.trajectory.qpos) for each in (found, plain()))
    assert off.max() < 0.03 < 0.1 < plainly.max()
    assert np.allclose(found.cost, sum(found.stress.values())) and found.stress[kind.name].sum() > 0
    assert misses(graph, kind, streamed(kind)).max() < 0.03 < misses(graph, kind, plain_stream()).max()


@pytest.mark.parametrize("kind", LIMITS, ids=named)
def test_a_limit_holds_at_every_frame_by_its_own_interval_in_clip_and_stream(kind: Kind) -> None:
    graph = described(kind)
    assert misses(graph, kind, plain().trajectory.qpos).max() > 0.1
    found = solve_graph(graph, smoothing=Smoothing(steps=8))
    assert misses(graph, kind, found.trajectory.qpos).max() < 1e-3 and not found.unmet
    assert misses(graph, kind, streamed(kind)).max() < 1e-3


def test_a_limit_is_absent_where_its_priority_is_zero() -> None:
    """But for the rounding of sums with more terms, which the steps of a clip amplify."""
    graph = described(Below(), Narrow(), Slow(), Bent())
    graph = replace(
        graph, tracks=tuple(t if t.name not in map(named, LIMITS) else t.weighed(0.0) for t in graph.tracks)
    )
    assert np.abs(solve_graph(graph).trajectory.qpos - plain().trajectory.qpos).max() < 1e-6


def test_every_role_and_form_works_in_balance_and_touch_up() -> None:
    kinds = (Below(), Elbow(), Slow())
    graph = described(*kinds)
    result = rr.solve(graph, balance="static", legs="stand")
    for kind in kinds:
        assert kind.name in result.solution.stress or kind.role is not Role.COST
    off = {kind.name: misses(result.graph, kind, result.trajectory.qpos).max() for kind in kinds}
    assert off["below"] < 1e-3 and off["slow"] < 1e-3 and off["elbow"] < 0.05
    edit = Edit("edge", {"a": "l_hand", "b": "head", "at": 0.2, "frames": [12, 14]})
    done = apply_edit(graph, solve_graph(graph).trajectory, edit)
    assert misses(graph, Slow(), done.trajectory.qpos).max() < 1e-3


PAIR = ("body_link", "r_el_link")


@dataclass(frozen=True)
class Wide(SeparationKind):
    """A second kind of surfaces: the margin of forearm and trunk grows as the hand comes down, to less than they have in the stand."""

    name: str = "wide"
    follows_human = True

    def targets(self, context: RetargetContext) -> Track:
        margin = np.maximum(0.0465 - 0.04 * raised(context), 0.0)
        return limit(self, [PAIR], -np.inf, np.inf, len(margin)).bounded(margin, np.inf)


def apart(qpos: Floats) -> Floats:
    """(T,) distance of the forearm to the trunk [m]."""
    model = plain().graph.robot.model
    data, links = mujoco.MjData(model), [model.body(name).id for name in PAIR]
    trunk, arm = ([g for g in range(model.ngeom) if model.geom_bodyid[g] == b and model.geom_contype[g]] for b in links)
    found = []
    for q in qpos:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        found.append(min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a in trunk for b in arm))
    return np.array(found)


def test_margins_of_surfaces_are_those_of_every_frame_and_kind() -> None:
    plainly, wide = described(motion=lowered()), described(Wide(), motion=lowered())
    margin = wide.kinds["wide"].lower[:, 0]
    own = plainly.kinds["separation"]
    wider = own.bounded(margin[:, None], np.inf, own.joins(*PAIR))
    bounded = replace(plainly, tracks=tuple(wider if track is own else track for track in plainly.tracks))
    close = solve_graph(plainly).trajectory.qpos
    assert (margin - apart(close)).max() > 0.01 and (margin - apart(close))[0] < 0
    for graph in (wide, bounded):
        found = solve_graph(graph, smoothing=Smoothing(steps=4), start=close)
        assert (margin - apart(found.trajectory.qpos)).max() < 2e-3
        assert set(graph.kinds) - {"separation"} <= {*found.stress, "floor", "range", "speed"}
    assert (margin - apart(streamed(Wide(), motion=lowered()))).max() < 2e-3


def test_the_weight_of_smoothness_may_differ_from_frame_to_frame() -> None:
    graph = described()
    half = np.where(np.arange(len(graph)) < len(graph) // 2, 0.01, 10.0)[:, None]
    tracks = tuple(track.weighed(half) if track.name == "smoothness" else track for track in graph.tracks)
    bends = [
        np.abs(np.diff(solve_graph(each).trajectory.qpos[:, 7:], 2, axis=0)).sum(axis=1)
        for each in (graph, replace(graph, tracks=tracks))
    ]
    first, last = (slice(None, 12), slice(-12, None))
    assert bends[1][first].sum() > 1.05 * bends[0][first].sum() and bends[1][last].sum() < 0.9 * bends[0][last].sum()


def test_second_differences_follow_their_targets() -> None:
    graph, pan = described(), "head_pan"
    own, nod = graph.kinds["smoothness"], 0.01 * np.sin(np.arange(len(graph)) * np.pi / 6)
    moved = own.lower + nod[:, None] * (np.array([end for end, _ in own.ends]) == pan)
    tracks = tuple(replace(track, lower=moved, upper=moved) if track is own else track for track in graph.tracks)
    column = graph.robot.qpos_index[graph.robot.joint_names.index(pan)]
    bends = [
        np.diff(solve_graph(each).trajectory.qpos[:, column], 2) for each in (graph, replace(graph, tracks=tracks))
    ]
    assert (bends[1] - bends[0]) @ nod[1:-1] > 0.1 * nod @ nod


STENCILS = ((0,), (-1, 0), (-1, 0, 1), (-2, -1, 0), (0, 3), (-1, 1))
HONOURED = {
    (Role.COST, Form.SYMBOLIC): {(0,)},
    (Role.COST, Form.NUMERIC): {(0,)},
    (Role.COST, Form.JOINT): {(-1, 0, 1)},
    (Role.INEQUALITY, Form.SYMBOLIC): {(0,)},
    (Role.INEQUALITY, Form.NUMERIC): {(0,)},
    (Role.BOUND, Form.JOINT): {(0,), (-1, 0)},
}
"""The table of docs/how-to/extend.md."""


@pytest.mark.parametrize("stencil", STENCILS, ids=str)
@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("role", Role)
def test_rows_that_the_solver_cannot_honour_are_refused_by_name_role_and_stencil(
    role: Role, form: Form, stencil: tuple[int, ...]
) -> None:
    kind = Below("odd")
    for name, value in (("role", role), ("form", form), ("stencil", stencil)):
        object.__setattr__(kind, name, value)
    graph = plain().graph
    ends = [(graph.robot.joint_names[0], "odd")] if form is Form.JOINT else [("r_hand", "floor")]
    values = exact(kind, ends, np.zeros((len(graph), 1)), 1.0)
    track = values if role is Role.COST else limit(kind, ends, 0.0, np.inf, len(graph))
    skeleton, causal = clip().skeleton, HONOURED.get((role, form), set())
    causal = {(-2, -1, 0)} if (role, form) == (Role.COST, Form.JOINT) else {each for each in causal if each[-1] <= 0}
    written = str(stencil).replace("-", "−")
    message = re.escape(f"kind 'odd', {form.value} {role.value} with the stencil {written}: ")
    if stencil in HONOURED.get((role, form), ()):
        build_problem(graph.robot, graph.match, (*graph.tracks, track))
    else:
        with pytest.raises(GraphError, match=message):
            build_problem(graph.robot, graph.match, (*graph.tracks, track))
    if stencil in causal:
        rr.Stream(graph.robot, skeleton, kinds=(*stream_kinds(), kind))
    else:
        with pytest.raises(GraphError, match=message):
            rr.Stream(graph.robot, skeleton, kinds=(*stream_kinds(), kind))


def test_targets_that_the_solver_cannot_honour_are_refused() -> None:
    graph, frames = plain().graph, len(plain().graph)
    joint, none = [(graph.robot.joint_names[0], "zero")], [("elbow of the left wing", "zero")]
    below, narrow = limit(Below(), [("r_hand", "floor")], 0.0, 1.0, frames), Narrow()
    bend = graph.kinds["smoothness"]
    cases = {
        "priority ∞": replace(below, priority=np.full((frames, 1), 7.0)),
        "no joint 'elbow of the left wing'": limit(narrow, none, 0.0, 1.0, frames),
        "has two edges": limit(narrow, joint * 2, 0.0, 1.0, frames),
        "no upper bound": limit(Bent(), joint, 0.0, 1.0, frames),
        "squared errors": replace(bend, kind=Renamed(), upper=bend.upper + 0.1),
        "two kinds of edges have the name 'floor'": limit(Below("floor"), [("r_hand", "floor")], 0.0, 1.0, frames),
    }
    for reason, track in cases.items():
        with pytest.raises(GraphError, match=reason):
            build_problem(graph.robot, graph.match, (*graph.tracks, track))


def documented() -> Kind:
    """The kind of docs/how-to/extend.md, by its own code."""
    text = (ROOT / "docs/how-to/extend.md").read_text(encoding="utf-8")
    code = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)[0]
    names: dict[str, Any] = {}
    exec(code, names)
    return names["Nod"]()


def test_the_documented_kind_follows_every_frame_in_clip_and_stream() -> None:
    nod, squat = documented(), read_motion(SAMPLES / "squat.bvh").frames(20, 110)
    robot = load_robot("op3")
    graph = rr.describe(squat, robot, kinds=(*clip_kinds(), nod))
    wanted = graph.kinds["nod"].lower[:, 0]
    assert np.ptp(wanted) > 0.1
    for qpos in (solve_graph(graph).trajectory.qpos, streamed(nod, motion=squat)):
        heads = world_points(robot, graph.match.points, qpos)[:, graph.match.index("head"), 2]
        assert np.corrcoef(heads, wanted)[0, 1] > 0.99 and np.abs(heads - wanted).mean() < 0.015


PLUGIN = """
from robot_retarget.graph.kind import Kind, exact
class Nod(Kind):
    name = 'nod'
    def targets(self, context):
        return exact(self, [('head', 'floor')], context.human.positions[:, [0], 2], 1.0)
    def measure(self, track, body):
        return body.keypoint('head')[2]
"""
PRINT = """
import sys
from robot_retarget.graph.kinds import clip_kinds, registered, stream_kinds
for folder in sys.argv[1:]:
    sys.path.insert(0, folder)
    registered.cache_clear()
    try:
        print([kind.name for kinds in (clip_kinds(), stream_kinds()) for kind in kinds if kind.name == 'nod'])
    except Exception as error:
        print(error)
    sys.path.remove(folder)
"""


def test_a_kind_of_another_package_is_part_of_every_graph(tmp_path: Path) -> None:
    """Packages beside ours, as pip installs them."""
    (tmp_path / "nodding.py").write_text(PLUGIN)
    folders = []
    for k, entry in enumerate(("nodding:Nod", "nodding:Nid", "nodding:exact")):
        info = tmp_path / f"{k}" / "nodding-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: nodding\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[robot_retarget.kinds]\nnod = {entry}\n")
        folders.append(str(info.parent))
    env = {**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    done = subprocess.run([sys.executable, "-c", PRINT, *folders], capture_output=True, text=True, env=env, check=True)
    good, unknown, wrong = done.stdout.splitlines()
    assert good == "['nod', 'nod']" and "nodding:Nid" in unknown and "nodding:exact" in wrong

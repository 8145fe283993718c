"""The graph lists its edges, ends and targets, can be edited, and names the culprit of an error."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_retarget.base.errors import GraphError
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.added import FADE
from robot_retarget.graph.describe import RobotGraph, describe
from robot_retarget.graph.kinds import KINDS
from robot_retarget.graph.track import HARD
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.robot.geoms import allowed, solid_geoms

FRAMES = 60
HAND_TO_HEAD = ("l_hand", "head")


@cache
def clap() -> RobotGraph:
    return describe(read_motion(SAMPLES / "clap.bvh"), load_robot("op3"), fps=30).frames(0, FRAMES)


def test_every_kind_and_every_limit_of_the_bodies_is_there_in_its_number() -> None:
    """17 keypoints, 16 bones: what no bone joins has a distance; all but hip bones and clavicles, and two lines, a direction."""
    graph, robot = clap(), load_robot("op3")
    keypoints, hinges = len(graph.match.keypoints), len(robot.joint_names)
    pairs = keypoints * (keypoints - 1) // 2
    absent = ("interaction", "coupling", "contact", "near", "clearance")  # off, no gears, no scene
    assert list(graph.kinds) == [kind.name for kind in KINDS if kind.name not in absent]
    count = {name: len(track) for name, track in graph.kinds.items()}
    bones = int((graph.match.parents >= 0).sum())
    assert (keypoints, bones, count["posture"]) == (18, 17, pairs - bones)
    assert count["compass"] == 3 * (bones - 4 + 2)
    assert count["orientation"] == 2 * 3 * len(graph.human.segments)
    assert (count["path"], count["rest"], count["foothold"]) == (3, hinges, 2 * 4 * 3)
    assert count["floor"] == sum(len(sole) for sole in graph.match.anatomy.soles.values())
    lying = len(solid_geoms(robot)) - len(graph.match.anatomy.soles)
    assert (count["separation"], count["range"], count["speed"]) == (len(allowed(robot)) + lying, hinges, hinges)
    assert len(graph) == FRAMES and graph.fps == 30


def test_bounds_that_never_change_take_one_row_in_memory_and_cannot_be_written() -> None:
    ranges = clap().kinds["range"]
    for column in (ranges.lower, ranges.upper, ranges.priority):
        assert column.shape == (FRAMES, len(ranges)) and column.strides[0] == 0 and not column.flags.writeable
    assert clap().kinds["posture"].lower.strides[0] > 0


def test_its_repr_says_the_robot_the_frames_and_every_kind() -> None:
    said = repr(clap())
    for word in ("op3 × 60 frames at 30/s", *(f"{len(track)} {name}" for name, track in clap().kinds.items())):
        assert word in said


def test_between_two_ends_there_is_what_joins_them_in_either_order() -> None:
    graph = clap()
    for pair in (HAND_TO_HEAD, HAND_TO_HEAD[::-1]):
        found = graph.between(*pair)
        assert list(found) == ["posture", "touch"]
        assert all(set(ends) == set(pair) for track in found.values() for ends in track.ends)
    bone = graph.between("l_elbow", "l_hand")["compass"]
    assert bone.axes == ("x", "y", "z")
    whole = graph.kinds["compass"]
    assert np.array_equal(bone.lower, whole.lower[:, whole.joins("l_elbow", "l_hand")])
    assert graph.between("l_hand", "r_knee").keys() == {"posture", "touch"}
    assert graph.between("r_hand", "standing pose") == {}


def test_the_table_is_the_tracks_expanded_frame_by_frame() -> None:
    graph = clap()
    rows = graph.table([3, 40])
    assert rows.dtype.names == ("kind", "a", "b", "axis", "frame", "lower", "upper", "priority", "hard")
    for name, track in graph.kinds.items():
        own = rows[rows["kind"] == name]
        at = [(t, e) for t in (3, 40) for e in range(len(track)) if track.priority[t, e] > 0]
        assert [tuple(row) for row in own] == [
            (
                name,
                *track.ends[e],
                track.axes[e] if track.axes else "",
                t,
                track.lower[t, e],
                track.upper[t, e],
                track.priority[t, e],
                track.priority[t, e] >= HARD,
            )
            for t, e in at
        ]
    assert np.array_equal(graph.table(3), rows[rows["frame"] == 3])
    assert set(graph.table()["frame"]) == set(range(FRAMES))
    assert rows["hard"][np.isin(rows["kind"], ("floor", "separation", "range", "speed"))].all()


def test_frames_are_cut_out_of_everything() -> None:
    graph = clap().with_edge(*HAND_TO_HEAD, 0.05, frames=(20, 30))
    part = graph.frames(10, 40)
    assert len(part) == len(part.motion) == len(part.human) == len(part.pelvis) == 30
    whole, cut = graph.table(np.arange(10, 40)), part.table()
    cut["frame"] += 10
    assert np.array_equal(np.sort(whole), np.sort(cut))


@settings(max_examples=40)
@given(st.integers(0, FRAMES - 1), st.integers(0, FRAMES - 1), st.floats(0.1, 500.0))
def test_an_added_edge_comes_on_before_its_frames_and_goes_after_them(one: int, other: int, priority: float) -> None:
    first, last = sorted((one, other))
    track = clap().with_edge(*HAND_TO_HEAD, (0.02, 0.05), frames=(first, last), priority=priority).kinds["own"]
    asked, edge = track.priority[:, 0], np.arange(FRAMES)
    away = np.maximum(np.maximum(first - edge, edge - last), 0) / 30
    assert np.allclose(asked[first : last + 1], priority) and (asked[away > FADE] == 0).all()
    assert ((asked > 0) == (away <= FADE + 1e-9)).all()
    assert (np.diff(asked[: first + 1]) >= 0).all() and (np.diff(asked[last:]) <= 0).all()
    assert np.abs(np.diff(asked)).max(initial=0.0) < 0.3 * priority
    assert (track.lower == 0.02).all() and (track.upper == 0.05).all() and not (asked >= HARD).any()


def test_edges_may_be_added_one_after_the_other_to_keypoints_bodies_and_places() -> None:
    graph = (
        clap()
        .with_edge("l_hand", "head", 0.05, hard=True, frames=(10, 20))
        .with_edge(("l_el_link", np.array([0, 0.1, 0])), "r_hand", (0.01, np.inf), priority=7)
        .with_edge("r_hand", np.array([0.2, 0, 0.5]), at=0)
    )
    own = graph.kinds["own"]
    assert own.ends == (
        ("l_hand", "head"),
        ("l_el_link@(0, 0.1, 0)", "r_hand"),
        ("r_hand", "(0.2, 0, 0.5)"),
    )
    assert own.priority[15].tolist() == [HARD, 7.0, 100.0] and own.upper[0].tolist() == [0.05, np.inf, 0.0]
    assert graph.table(15)["hard"][graph.table(15)["kind"] == "own"].tolist() == [True, False, False]
    assert list(graph.between("l_hand", "head")) == ["posture", "touch", "own"]
    left = graph.without(("l_hand", "head")).kinds["own"]
    assert left.ends == own.ends[1:] and len(left.kind.ends) == 2  # type: ignore[attr-defined]
    assert "own" not in clap().kinds  # a graph never changes


def test_a_kind_or_a_pair_is_weighed_and_nothing_else() -> None:
    graph = clap()
    for what in ("posture", HAND_TO_HEAD):
        weighed = graph.with_priority(what, 2.5)
        for name, track in graph.kinds.items():
            chosen = track.joins(*what) if what is HAND_TO_HEAD else np.full(len(track), name == what)
            chosen &= name in {t.name for t in graph.tracks}
            factor = np.where(chosen, 2.5, 1.0)
            assert np.allclose(weighed.kinds[name].priority, track.priority * factor)


def test_without_a_kind_or_a_pair_the_rest_stays() -> None:
    graph = clap()
    bare = graph.without("touch")
    assert bare.kinds.keys() == graph.kinds.keys() - {"touch"}
    parted = graph.without(HAND_TO_HEAD)
    assert parted.between(*HAND_TO_HEAD) == {}
    assert sum(map(len, graph.kinds.values())) - sum(map(len, parted.kinds.values())) == 2
    only = graph.without(("l_hip", "r_hip")).kinds["compass"]
    assert len(only) == len(graph.kinds["compass"]) - 3


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda g: g.between("l_paw", "head"), r"nothing in the graph is called 'l_paw'.*l_hand"),
        (lambda g: g.without("paws"), r"no kind 'paws'.*posture, touch, compass"),
        (lambda g: g.without("range"), r"range protects the robot; narrow it with `with_bounds`"),
        (lambda g: g.with_priority("floor", 2), r"floor is a limit, which has no priority"),
        (lambda g: g.with_bounds("posture", 0.1), r"the targets of posture follow the human's motion"),
        (lambda g: g.with_bounds("speed", factor=2), r"speed: bounds can be narrowed only"),
        (lambda g: g.with_bounds("range", lower=9.0), r"range: the bounds leave no interval"),
        (lambda g: g.without(("l_hand", "paw")), r"'paw'.*l_hand"),
        (lambda g: g.with_priority("paws", 2.0), r"no kind 'paws'.*posture"),
        (lambda g: g.with_priority("posture", -1.0), r"factor of 0 or more, got -1"),
        (lambda g: g.with_priority("posture", np.nan), r"factor of 0 or more, got nan"),
        (lambda g: g.with_edge("l_paw", "head", 0.1), r"no keypoint 'l_paw'.*l_hand"),
        (lambda g: g.with_edge(("l_el", (0, 0, 0)), "head", 0.1), r"op3 has no body 'l_el'.*l_el_link"),
        (lambda g: g.with_edge("l_hand", (0.1, 0.2), 0.1), r"three finite coordinates"),
        (lambda g: g.with_edge("l_hand", (0.1, 0.2, np.nan), 0.1), r"three finite coordinates"),
        (lambda g: g.with_edge("l_hand", "head", (0.3, 0.1)), r"l_hand – head has the interval 0.3 … 0.1 m"),
        (lambda g: g.with_edge("l_hand", "head", -0.1), r"l_hand – head has the interval -0.1"),
        (lambda g: g.with_edge("l_hand", "head", np.nan), r"l_hand – head has the interval nan"),
        (lambda g: g.with_edge("l_hand", "head", np.inf), r"l_hand – head"),
        (lambda g: g.with_edge("l_hand", "head", 0.1, priority=-3.0), r"l_hand – head.*-3"),
        (lambda g: g.with_edge("l_hand", "head", 0.1, priority=np.nan), r"l_hand – head.*nan"),
        (lambda g: g.with_edge("head", "head", 0.1), r"head – head"),
        (lambda g: g.with_edge("l_hand", "head", 0.1, frames=(5, 60)), r"l_hand – head: frames 5 … 60.*0 … 59"),
        (lambda g: g.with_edge("l_hand", "head", 0.1, frames=(9, 5)), r"l_hand – head: frames 9 … 5"),
        (lambda g: g.with_edge("l_hand", "head", 0.1, hard=True, priority=5.0), r"l_hand – head: a hard edge has no"),
        (
            lambda g: g.with_edge("l_hand", "head", 0.1, hard=True, frames=(0, 30)).with_edge(
                "head", "l_hand", (0.2, 0.3), hard=True, frames=(30, 50)
            ),
            r"l_hand – head contradict each other: 0.1 … 0.1 m and 0.2 … 0.3 m",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(edit, said: str) -> None:
    with pytest.raises(GraphError, match=said):
        edit(clap())


def test_hard_edges_that_agree_or_do_not_meet_in_time_are_taken() -> None:
    once = clap().with_edge("l_hand", "head", (0.1, 0.2), hard=True, frames=(0, 20))
    assert len(once.with_edge("l_hand", "head", (0.15, 0.3), hard=True).kinds["own"]) == 2
    assert len(once.with_edge("l_hand", "head", 0.4, hard=True, frames=(40, 50)).kinds["own"]) == 2
    assert len(once.with_edge("l_hand", "head", 0.4).kinds["own"]) == 2  # a soft one may ask for anything


@pytest.mark.parametrize(
    ("clip", "touching"),
    [
        ("walk", set()),  # hands that swing past hips touch nothing
        ("clap", {("l_hand", "r_hand")}),
        ("hips_and_bow", {("l_hand", "l_hip"), ("r_hand", "r_hip")}),
    ],
)
def test_what_touches_in_a_sample_clip_and_nothing_else_counts_as_a_touch(
    clip: str, touching: set[tuple[str, str]]
) -> None:
    track = describe(read_motion(SAMPLES / f"{clip}.bvh"), load_robot("op3")).kinds["touch"]
    assert {track.ends[e] for e in np.flatnonzero(track.priority.max(axis=0) > 0)} == touching

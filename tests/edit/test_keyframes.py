"""Keyframes: the way between poses, by finite differences; the feet, by MuJoCo; files, by the C struct of action pages."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from action_structs import Page, pages_of, write_pages
from forked import run

from robot_retarget.actuators.map import load_map
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.edit.keyframe_files import KeyframeFile, keyframe_file
from robot_retarget.edit.keyframes import Keyframe, dragged, motion_through, trajectory_through
from robot_retarget.robot import load_robot, recognise
from robot_retarget.trajectory import load_trajectory

OP3, SERVOS = load_robot("op3"), load_map("op3")
STAND = OP3.standing()[OP3.qpos_index]


def pose(**angles: float) -> np.ndarray:
    made = STAND.copy()
    for joint, angle in angles.items():
        made[OP3.joint_names.index(joint)] = angle
    return made


def drawn(seed: int, count: int = 6) -> list[Keyframe]:
    random = np.random.default_rng(seed)
    poses = random.uniform(OP3.lower, OP3.upper, (count, len(STAND))) * 0.5
    times, pauses = random.uniform(0.0, 1.5, count), random.choice([0.0, 0.0, 0.3], count)
    return [Keyframe(*each) for each in zip(poses, times, pauses, strict=True)]


def test_between_two_keyframes_is_the_minimum_jerk_of_flash_and_hogan_and_a_pause_holds_the_pose() -> None:
    end = pose(l_sho_roll=-0.5)
    motion = motion_through([Keyframe(STAND, pause=0.5), Keyframe(end, 2.0)], OP3)
    u = np.linspace(0, 1, 50)[:, None]
    way = STAND + (end - STAND) * (10 * u**3 - 15 * u**4 + 6 * u**5)
    np.testing.assert_allclose(motion.at(0.5 + 2.0 * u[:, 0]), way, atol=1e-12)
    np.testing.assert_array_equal(motion.at(np.array([0.0, 0.3, 0.5])), np.tile(STAND, (3, 1)))
    assert motion.duration == 2.5 and not motion.notes


@pytest.mark.parametrize("seed", range(4))
def test_joints_pass_every_pose_at_its_time_turn_back_nowhere_else_and_keep_their_speed(seed: int) -> None:
    keys = drawn(seed)
    motion, rate = motion_through(keys, OP3), 1000.0
    times = np.arange(0.0, motion.duration, 1 / rate)
    velocity = np.diff(motion.at(times), axis=0) * rate
    assert (np.abs(velocity) <= 1.0011 * OP3.max_speed).all()
    assert np.abs(np.diff(velocity, axis=0)).max() * rate < 300.0, "a jump of the velocity"
    for k, key in enumerate(keys):
        for time in (motion.times[k], motion.times[k] + key.pause):
            np.testing.assert_allclose(motion.at(np.array([time]))[0], key.angles, atol=1e-9)
    for k, (key, following) in enumerate(pairwise(keys)):
        between = (times[:-1] > motion.times[k] + key.pause) & (times[1:] < motion.times[k + 1])
        assert (velocity[between] * np.sign(following.angles - key.angles) >= -1e-9).all()
        asked, took = following.seconds, motion.times[k + 1] - motion.times[k] - key.pause
        fastest = (np.abs(velocity[between]) / OP3.max_speed).max()
        assert took == pytest.approx(asked, abs=0.021) or fastest > 0.98, "a way is longer than it need be"


def test_the_standing_foot_is_flat_on_the_floor_and_stays_and_the_other_takes_over_when_it_is_set_down() -> None:
    squat = pose(l_hip_pitch=STAND[10] - 0.3, l_knee=STAND[11] + 0.6, l_ank_pitch=STAND[12] + 0.3,
                 r_hip_pitch=STAND[16] + 0.3, r_knee=STAND[17] - 0.6, r_ank_pitch=STAND[18] - 0.3)  # fmt: skip
    lifted = pose(l_hip_pitch=STAND[10] - 0.4, l_knee=STAND[11] + 0.8, l_ank_pitch=STAND[12] + 0.4)
    other = pose(r_hip_pitch=STAND[16] + 0.4, r_knee=STAND[17] - 0.8, r_ank_pitch=STAND[18] - 0.4)
    made, motion = trajectory_through([Keyframe(q) for q in (STAND, squat, STAND, lifted, STAND, other)], OP3)
    data, anatomy, places = mujoco.MjData(OP3.model), recognise(OP3), dict[str, list[list[np.ndarray]]](l=[], r=[])
    for q in made.qpos:
        data.qpos[:] = q
        mujoco.mj_kinematics(OP3.model, data)
        for side, tread in anatomy.treads.items():
            frames = zip(tread.bodies, tread.offsets, strict=True)
            places[side].append([data.xpos[b] + data.xmat[b].reshape(3, 3) @ offset for b, offset in frames])
    left, right = (np.array(places[side]) for side in "lr")
    lowest = np.minimum(left[..., 2].min(axis=1), right[..., 2].min(axis=1))
    assert np.abs(lowest).max() < 1.5e-3
    at = [round(time * made.fps) for time in motion.times]
    assert made.qpos[at[1], 2] < made.qpos[0, 2] - 0.01
    for foot, t in ((left, at[1]), (right, at[1]), (right, at[3]), (left, at[5])):
        assert np.abs(foot[t] - foot[0]).max() < 2e-3
    assert left[at[3], :, 2].min() > 0.01 and right[at[5], :, 2].min() > 0.01


def test_a_dragged_hand_is_where_it_was_dropped_and_the_legs_stay() -> None:
    tip, data = recognise(OP3).sites["l_hand"], mujoco.MjData(OP3.model)

    def hand(qpos: np.ndarray) -> np.ndarray:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(OP3.model, data)
        return data.xpos[tip.body] + data.xmat[tip.body].reshape(3, 3) @ tip.offset

    start = OP3.standing()
    place = hand(start) + np.array([0.05, 0.03, 0.1])
    angles, reached = dragged(start, OP3, "l_hand", place)
    moved = start.copy()
    moved[OP3.qpos_index] = angles
    assert np.linalg.norm(hand(moved) - place) < 1e-3 and "0.0 cm apart" in reached
    assert not np.abs(angles - STAND)[[k for k, name in enumerate(OP3.joint_names) if not name.startswith("l_")]].any()


IDS = [servo.id for servo in SERVOS.servos]


def theirs(path: Path) -> list[Page]:
    """Pages as others write them: two of one motion at speed 48, servos left out, numbers of absent servos, a page beside."""
    random = np.random.default_rng(0)
    pages = [Page() for _ in range(256)]
    for number, steps, following in ((38, 7, 39), (39, 4, 0), (2, 3, 0)):
        page = pages[number]
        page.header.name, page.header.schedule, page.header.repeat, page.header.exit = f"bye{number}".encode(), 10, 1, 9
        page.header.stepnum, page.header.speed, page.header.accel, page.header.next = steps, 48, 32, following
        for step in page.step[:steps]:
            step.time, step.pause = int(random.integers(20, 200)), int(random.choice([0, 0, 50]))
            for k in range(31):
                ticks = SERVOS.servos[IDS.index(k)].ticks(float(random.uniform(-0.4, 0.4))) if k in IDS else 60000 + k
                step.position[k] = ticks | (0x4000 if random.random() < 0.2 else 0)
    write_pages(pages[1:], path)
    path.write_bytes(bytes(512) + path.read_bytes())  # no sum of page 0 is ever read
    return pages_of(path)


@pytest.fixture
def opened(tmp_path: Path) -> KeyframeFile:
    theirs(tmp_path / "motion.bin")
    return keyframe_file(f"{tmp_path / 'motion.bin'}#38", OP3)


def order(pages: list[Page], first: int) -> list[tuple[int, int]]:
    """(page, step) as the player goes."""
    found, page = [], first
    while page:
        found += [(page, step) for step in range(pages[page].header.stepnum)]
        page = pages[page].header.next
    return found


def test_pages_that_nobody_edits_are_saved_byte_for_byte(opened: KeyframeFile) -> None:
    before = opened.path.read_bytes()
    assert len(opened.keyframes) == 11
    opened.holding(opened.keyframes).save()
    assert opened.path.read_bytes() == before


def test_an_edited_joint_changes_its_own_position_and_the_sum_of_its_page(opened: KeyframeFile) -> None:
    keys, joint = list(opened.keyframes), "l_el"
    angles = keys[2].angles.copy()
    angles[OP3.joint_names.index(joint)] = 0.75
    keys[2] = replace(keys[2], angles=angles)
    was, now = pages_of(opened.path), pages_of(opened.holding(keys).save())
    assert now[38].step[2].position[SERVOS[joint].id] == SERVOS[joint].ticks(0.75)
    now[38].step[2].position[SERVOS[joint].id] = was[38].step[2].position[SERVOS[joint].id]
    now[38].header.checksum = was[38].header.checksum
    held = was[38].step[3].position[SERVOS[joint].id] & 0x4000  # the next pose stays as it was
    if held:
        now[38].step[3].position[SERVOS[joint].id] = was[38].step[3].position[SERVOS[joint].id]
    assert [*map(bytes, now)] == [*map(bytes, was)]


def test_new_poses_go_on_a_free_page_and_the_player_finds_all_in_order(opened: KeyframeFile) -> None:
    keys = list(opened.keyframes)
    more = [Keyframe(pose(l_sho_roll=-0.2 * k, r_el=0.1 * k), 0.4, 0.08) for k in range(1, 5)]
    made = opened.holding([*keys[:2], *more, *keys[2:]])
    pages = pages_of(made.save())
    assert all(sum(bytes(page)) % 256 == 255 for page in pages[1:])
    assert len(order(pages, 38)) == 15 and bytes(pages[2]) == bytes(theirs(opened.path)[2])
    for key, (page, step) in zip([*keys[:2], *more, *keys[2:]], order(pages, 38), strict=True):
        row, speed = pages[page].step[step], pages[page].header.speed
        assert ((row.time * speed >> 5) + 3) * 0.008 == pytest.approx(key.seconds, abs=0.0081)
        assert (row.pause * 32 // speed) * 0.008 == pytest.approx(key.pause, abs=0.0041)
        for joint, angle in zip(OP3.joint_names, key.angles, strict=True):
            ticks = row.position[SERVOS[joint].id]
            assert ticks & 0x4000 or ticks == SERVOS[joint].ticks(float(angle))
    back = replace(opened, content=made.content).keyframes
    assert max(np.abs(a.angles - b.angles).max() for a, b in zip(back[2:6], more, strict=True)) < 0.0008  # half a tick


def test_fewer_poses_leave_their_pages_empty(opened: KeyframeFile) -> None:
    pages = pages_of(opened.holding(opened.keyframes[8:]).save())
    assert order(pages, 38) == [(38, 0), (38, 1), (38, 2)] and not pages[39].header.stepnum
    assert pages[38].header.name == b"bye38" and pages[38].header.speed == 48


def test_pages_from_nothing_are_as_the_editor_makes_them(tmp_path: Path) -> None:
    made = keyframe_file(tmp_path / "wave.bin", OP3).holding([Keyframe(STAND), Keyframe(pose(l_sho_roll=-1.0), 0.8)])
    pages = pages_of(made.save())
    assert (pages[1].header.name, pages[1].header.schedule, pages[1].header.stepnum) == (b"wave", 10, 2)
    with pytest.raises(UsageError, match=r"a time of 3 s: a step of page 1 takes 0.024 to 2.06 s"):
        made.holding([Keyframe(STAND, 3.0)])


def test_animations_of_the_bit_bots_keep_what_is_not_edited(tmp_path: Path) -> None:
    rows = [
        {"duration": 0.01, "goals": {"l_el": -50.51, "head_pan": 1.84}, "name": "start", "pause": 0.2, "torque": {"l_el": 1}},
        {"duration": 1.5, "goals": {"head_pan": 10.0}, "name": "look", "pause": 0.0, "torque": {}},
    ]  # fmt: skip
    (tmp_path / "a.json").write_text(json.dumps({"author": "we", "keyframes": rows, "name": "a"}))
    file = keyframe_file(tmp_path / "a.json", OP3)
    first, second = file.keyframes
    assert second.angles[OP3.joint_names.index("l_el")] == pytest.approx(np.radians(-50.51))
    angles = second.angles.copy()
    angles[OP3.joint_names.index("r_el")] = np.radians(30)
    saved = file.holding([first, replace(second, angles=angles, seconds=2.0), Keyframe(STAND)]).save()
    after = json.loads(saved.read_text())
    assert after["author"] == "we" and after["keyframes"][0] == rows[0]
    assert after["keyframes"][1] == rows[1] | {"duration": 2.0, "goals": {"head_pan": 10.0, "r_el": 30.0}}
    assert len(after["keyframes"][2]["goals"]) == 20


def test_the_command_makes_the_trajectory_of_a_file_and_other_files_of_it(tmp_path: Path) -> None:
    keys = [Keyframe(STAND), Keyframe(pose(l_sho_roll=-1.2), 0.2)]
    keyframe_file(tmp_path / "wave.json", OP3).holding(keys).save()
    done = run("edit", "keyframes", tmp_path / "wave.json", "--robot", "op3", "-o", tmp_path / "wave.npz")
    assert done.returncode == 0 and "takes 1.17 s instead of 0.20 s: l_sho_roll turns at most 4 rad/s" in done.stdout
    made, _ = trajectory_through(keyframe_file(tmp_path / "wave.json", OP3).keyframes, OP3, source="wave.json")
    assert (tmp_path / "wave.npz").read_bytes() == made.serialised()
    assert run("edit", "keyframes", tmp_path / "wave.json", "--robot", "op3", "-o", tmp_path / "b.bin").returncode == 0
    back = keyframe_file(tmp_path / "b.bin", OP3).keyframes
    assert max(np.abs(a.angles - b.angles).max() for a, b in zip(keys, back, strict=True)) < 0.0008
    assert load_trajectory(tmp_path / "wave.npz").duration == pytest.approx(1.18, abs=0.01)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.json", '{"keyframes": [{"goals": {"tail": 1}}]}', "joint 'tail' is not one of 'op3'"),
        ("a.json", '{"keyframes": [{"goals": {"l_el": "x"}}]}', "could not convert string to float: 'x'"),
        ("a.json", '{"keyframes": [{"duration": -1}]}', "seconds of a keyframe must be 0 to 3600, got -1"),
        ("a.json", "[]", "no list `keyframes` of tables"),
        ("a.bin", "short", "5 bytes; 256 pages have 131072"),
        ("a.bin#300", "", "pages are 1 to 255, got '300'"),
        ("a.csv", "x", "not a file of keyframes by its suffix; known: .json, .bin"),
    ],
)
def test_what_is_no_file_of_keyframes_is_refused_with_its_reason(
    name: str, text: str, said: str, tmp_path: Path
) -> None:
    if text:
        (tmp_path / name).write_text(text)
    with pytest.raises((TrajectoryError, UsageError)) as refused:
        keyframe_file(tmp_path / name, OP3).keyframes  # noqa: B018
    assert said in str(refused.value)

"""Pictures show both bodies at the same time and size, for any path and any renderer."""

import sys
from dataclasses import replace

import imageio_ffmpeg
import numpy as np
import pytest
from made_trajectories import RAIL, hold, robot_of, wander
from PIL import Image

from robot_retarget.base.errors import OutputError, TrajectoryError, UsageError
from robot_retarget.base.files import SAMPLES
from robot_retarget.human.match import match_bodies
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot, recognise
from robot_retarget.tools.view.draw import Sketch
from robot_retarget.tools.view.film import STRIP_GAP, Film, strip, video
from robot_retarget.tools.view.picture import Picture, Unavailable
from robot_retarget.tools.view.render import TILE, open_context, open_stage
from robot_retarget.tools.view.staging import FIGURE, arrange, geom_corners, height_of, stick_figure, visible
from robot_retarget.trajectory import Trajectory

OP3 = load_robot("op3")
BONES = np.array([(0, 1), (1, 2), (2, 3), (2, 4), (0, 5), (0, 6)])


def stick_man(frames: int = 20, stature: float = 1.7, travel: float = 0.0) -> np.ndarray:
    """Pelvis, chest, head, left and right hand, left and right foot of someone who faces +x (T, 7, 3)."""
    shape = np.array([[0, 0, 0.55], [0, 0, 0.8], [0, 0, 1], [0, 0.25, 0.5], [0, -0.25, 0.5], [0, 0.1, 0], [0, -0.1, 0]])
    points = np.tile(shape * stature, (frames, 1, 1))
    points[:, 3, 2] += 0.3 * np.sin(np.linspace(0, 3, frames))
    points[..., 0] += travel * np.linspace(0, 1, frames)[:, None]
    return points


def orange(pixels: np.ndarray) -> np.ndarray:
    """Where the human is seen: its hue, in light or shade."""
    red, green, blue = (pixels[..., c].astype(float) for c in range(3))
    wanted = np.array(FIGURE[:3]) / FIGURE[0]
    return (red > 90) & (abs(green / (red + 1) - wanted[1]) < 0.12) & (abs(blue / (red + 1) - wanted[2]) < 0.12)


@pytest.fixture
def pencil(monkeypatch):
    """A machine without OpenGL."""
    monkeypatch.setenv("MUJOCO_GL", "disable")


def rendering() -> None:
    """Skip a test where nothing can be rendered."""
    context = open_context(16, 16)
    if isinstance(context, Unavailable):
        pytest.skip(context.reason)
    context.free()


def test_the_human_stands_beside_the_robot_at_its_height():
    staging = arrange(OP3, hold(OP3), stick_man(), BONES, np.array([0.0, 0.5]))
    body = geom_corners(OP3, staging.qpos).reshape(2, -1, 3)
    assert (staging.human @ staging.right).max() < (body @ staging.right).min()
    assert np.ptp(staging.human[..., 2]) == pytest.approx(np.ptp(body[..., 2]), rel=0.1)
    assert staging.human[..., 2].min() == pytest.approx(0, abs=0.05 * staging.height)


@pytest.mark.parametrize("stature", [0.9, 1.7, 170.0])
def test_the_size_of_the_human_does_not_matter(stature):
    plain, other = (arrange(OP3, hold(OP3), stick_man(stature=s), BONES, np.zeros(1)) for s in (1.7, stature))
    np.testing.assert_allclose(other.human, plain.human, atol=0.02)


def test_the_head_of_who_lies_on_the_back_is_the_head_and_no_raised_hand() -> None:
    arms_on_the_chest = np.array([(0, 1), (1, 2), (1, 3), (1, 4), (0, 5), (0, 6)])
    lying = stick_man()[..., [2, 1, 0]] * [-1, 1, 1] + [0, 0, 0.1]
    lying[:, 3, 2] += 1.0  # a hand is stretched up
    staging = arrange(OP3, hold(OP3), lying, arms_on_the_chest, np.array([0.0, 0.5]))
    assert stick_figure(staging).limbs[-1].tolist() == [2, 2]


def test_a_robot_without_a_head_leaves_the_human_its_own():
    motion, whole = read_motion(SAMPLES / "wave.bvh"), recognise(OP3)
    headless = replace(whole, sites={k: site for k, site in whole.sites.items() if k not in ("neck", "head")})
    matched = match_bodies(motion, OP3, motion.recognition, headless)
    staging = arrange(OP3, hold(OP3), *matched.figure(motion), np.linspace(0, 1, 3))
    head = matched.recognition.keypoints.index("head")
    assert stick_figure(staging).limbs[-1].tolist() == [head, head]


def test_who_walks_away_stays_in_the_picture():
    qpos = hold(OP3, 4.0).qpos.copy()
    qpos[:, 0] += np.linspace(0, 3, len(qpos))
    walk = Trajectory(qpos, 50, OP3.joint_names, "op3")
    staging = arrange(OP3, walk, stick_man(200, travel=9.0), BONES, np.linspace(0, 4, 9))
    reach = staging.height * staging.aspect
    for body in (staging.human, geom_corners(OP3, staging.qpos).reshape(9, -1, 3)):
        assert np.abs((body - staging.targets[:, None]) @ staging.right).max() < reach


@pytest.mark.parametrize("lying", [False, True])
def test_both_bodies_are_inside_the_picture_also_when_they_lie(lying: bool) -> None:
    qpos, man = OP3.standing(), stick_man()
    if lying:
        qpos[3:7] = [np.sqrt(0.5), 0, np.sqrt(0.5), 0]
        qpos[2] -= geom_corners(OP3, qpos[None])[..., 2].min()
        man = man[..., [2, 1, 0]] * [-1, 1, 1] + [0, 0, 0.1]
    staging = arrange(OP3, hold(OP3, qpos=qpos), man, BONES, np.array([0.4]))
    spread = np.linalg.norm(staging.human[0][:, None] - staging.human[0], axis=-1).max()
    assert spread == pytest.approx(staging.height, rel=0.15)
    width, height = round(300 * staging.aspect), 300
    sketch = Sketch(staging, width, height)
    for body in (staging.human[0], geom_corners(OP3, staging.qpos)[0].reshape(-1, 3)):
        pixels, _ = sketch._project(body, 0)
        assert (pixels >= 0).all() and (pixels <= [2 * width, 2 * height]).all()


@pytest.mark.parametrize("feet", [False, True])
def test_a_robot_without_geoms_or_with_those_of_its_feet_alone_is_shown_by_its_links(feet, tmp_path, monkeypatch):
    spec = OP3.spec()
    kept = [geom for geom in spec.geoms if feet and "ank_roll" in geom.parent.name and not geom.meshname]
    lost = [geom for geom in spec.geoms if geom not in kept]
    for element in [*lost, *spec.meshes, *spec.sensors, *spec.keys, *spec.excludes]:
        spec.delete(element)
    robot = robot_of(spec.to_xml(), tmp_path / "bare.xml")
    assert (visible(robot.model).size > 0) == feet
    assert height_of(robot) == pytest.approx(height_of(OP3), rel=0.2)
    turned = robot.standing()
    turned[robot.qpos_index] += 0.8
    moving = Trajectory(np.stack([robot.standing(), turned]), 1.0, robot.joint_names, robot.name)
    for opengl in ("egl", "disable"):
        monkeypatch.setenv("MUJOCO_GL", opengl)
        shown = strip(robot, moving, count=2, height=160)
        assert isinstance(shown, Picture)
        width = (shown.pixels.shape[1] - STRIP_GAP) // 2
        one, other = shown.pixels[20:, :width].astype(int), shown.pixels[20:, -width:].astype(int)  # below the labels
        assert (np.abs(one - other).max(axis=2) > 25).mean() > 0.005  # the links move with the joints


def test_robot_and_human_are_shown_at_the_same_time():
    trajectory = wander(OP3, frames=101)
    moment = np.array([0.5])
    staging = arrange(OP3, trajectory, stick_man(41), BONES, moment)
    np.testing.assert_allclose(staging.qpos[0, 7:], trajectory.qpos[25, 7:], atol=1e-9)
    shape = stick_man(41)[10]
    hand, foot = (staging.human[0, k, 2] for k in (3, 5))
    scale = (staging.human[0, 2, 2] - foot) / (shape[2, 2] - shape[5, 2])
    assert hand - foot == pytest.approx(scale * (shape[3, 2] - shape[5, 2]), rel=1e-6)


def test_the_camera_looks_at_the_robots_face_whichever_way_it_turns():
    for turn in (0.0, 90.0, -135.0):
        qpos = OP3.standing()
        qpos[3:7] = [np.cos(np.radians(turn) / 2), 0, 0, np.sin(np.radians(turn) / 2)]
        staging = arrange(OP3, hold(OP3, qpos=qpos), None, None, np.zeros(1))
        assert np.cos(np.radians(staging.azimuth - turn)) < -0.8


def test_rendered_and_drawn_humans_are_in_the_same_place():
    rendering()
    staging = arrange(OP3, hold(OP3), stick_man(), BONES, np.array([0.4]))
    stage = open_stage(staging, 360, 300)
    assert not isinstance(stage, Unavailable)
    try:
        rendered = orange(stage.frame(0))
    finally:
        stage.close()
    drawn = orange(Sketch(staging, 360, 300).frame(0))
    left = slice(0, 170)  # the robot on the right has orange of its own
    both = (rendered & drawn)[:, left].sum()
    assert both > 0.8 * drawn[:, left].sum() and both > 0.8 * rendered[:, left].sum()


def test_the_picture_is_the_same_however_far_away_it_is_taken():
    """Shadows too: they are as sharp nine metres on as at the origin, which is a whole number of the floor's periods."""
    rendering()
    pictures, tile = [], TILE * arrange(OP3, hold(OP3), None, None, np.zeros(1)).height
    for away in (0.0, 36 * tile):
        qpos = OP3.standing()
        qpos[0] += away
        taken = strip(OP3, hold(OP3, qpos=qpos), count=1, height=240)
        assert isinstance(taken, Picture)
        pictures.append(taken.pixels.astype(int))
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 25).mean() < 0.002


def test_a_body_without_visible_geoms_is_drawn_by_its_collision_shapes(tmp_path):
    hidden = RAIL.replace('<geom type="capsule"', '<geom name="felt" group="3" rgba="0 0 0 0" type="capsule"')
    robot = robot_of(hidden, tmp_path / "hidden.xml")
    assert {robot.model.geom(g).name for g in visible(robot.model)} >= {"felt"}
    rendering()
    staging = arrange(robot, hold(robot), None, None, np.zeros(1))
    pictures = []
    for opacity in (1.0, 0.0):
        stage = open_stage(staging, 120, 120)
        assert not isinstance(stage, Unavailable)
        stage._model.geom_rgba[stage._model.geom("felt").id, 3] *= opacity
        pictures.append(stage.frame(0).astype(int))
        stage.close()
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 5).mean() > 0.005


def test_a_strip_has_its_moments_side_by_side_and_is_written_as_png(tmp_path):
    rendering()
    picture = strip(OP3, wander(OP3), stick_man(), BONES, count=3, height=120)
    assert isinstance(picture, Picture) and picture.note == ""
    height, width, _ = picture.pixels.shape
    assert height == 120 and width > 3 * 60
    first, last = picture.pixels[:, : width // 3], picture.pixels[:, -(width // 3) :]
    assert (np.abs(first.astype(int) - last) > 30).mean() > 0.01
    np.testing.assert_array_equal(np.asarray(Image.open(picture.save(tmp_path / "strip.png"))), picture.pixels)


def test_without_opengl_a_strip_is_drawn_and_says_so(pencil):
    picture = strip(OP3, wander(OP3), stick_man(), BONES, count=2, height=120)
    assert isinstance(picture, Picture)
    assert "MUJOCO_GL=disable" in picture.note and "drawn instead" in picture.note
    assert orange(picture.pixels).mean() > 0.01


def test_a_drawn_robot_moves_with_its_joints(pencil):
    still = Sketch(arrange(OP3, hold(OP3), None, None, np.array([0.0, 0.6])), 160, 160)
    moving = Sketch(arrange(OP3, wander(OP3), None, None, np.array([0.0, 0.6])), 160, 160)
    assert (still.frame(0) == still.frame(1)).all()
    assert (moving.frame(0) != moving.frame(1)).any(axis=2).mean() > 0.05


def test_a_robot_without_a_free_root_or_a_humanoid_shape_is_shown(tmp_path, pencil):
    rail = robot_of(RAIL, tmp_path / "rail.xml")
    assert isinstance(strip(rail, hold(rail), count=1, height=100), Picture)


def test_a_film_lasts_as_long_as_its_trajectory(tmp_path, pencil):
    done = []
    film = video(
        OP3, wander(OP3, frames=76), tmp_path / "v.mp4", stick_man(), BONES,
        fps=20, height=96, progress=lambda k, n: done.append((k, n)),
    )  # fmt: skip
    assert isinstance(film, Film) and film.frames == 31
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(film.path))
    assert (frames, seconds) == (31, pytest.approx(1.55, abs=0.1))
    assert done == [(k, 31) for k in range(1, 32)]
    loop = video(OP3, wander(OP3, frames=76), tmp_path / "v.gif", fps=10, height=64)
    with Image.open(tmp_path / "v.gif") as pictures:
        assert isinstance(loop, Film) and loop.frames == pictures.n_frames == 16 and pictures.info["duration"] == 100  # type: ignore[attr-defined]


@pytest.mark.parametrize(("module", "extra"), [("imageio_ffmpeg", "ffmpeg"), ("PIL.ImageDraw", "Pillow")])
def test_what_is_not_installed_is_said_and_nothing_is_written(tmp_path, monkeypatch, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    answer = video(OP3, hold(OP3), tmp_path / "v.mp4")
    assert isinstance(answer, Unavailable)
    assert extra in answer.reason and "-m pip install" in answer.reason
    assert not list(tmp_path.iterdir())


def test_bad_input_is_refused(tmp_path):
    with pytest.raises(UsageError, match="at least one moment, got 0"):
        strip(OP3, hold(OP3), count=0)
    with pytest.raises(UsageError, match=r"must be \(T, J, 3\), got \(7, 3\)"):
        strip(OP3, hold(OP3), stick_man()[0], BONES)
    with pytest.raises(UsageError, match="bones join points 0 … 6, got 0 … 9"):
        strip(OP3, hold(OP3), stick_man(), np.array([(0, 9)]))
    with pytest.raises(UsageError, match=r"\.mp4 or \.gif"):
        video(OP3, hold(OP3), tmp_path / "v.avi")
    with pytest.raises(UsageError, match="got 0"):
        video(OP3, hold(OP3), tmp_path / "v.mp4", fps=0)
    with pytest.raises(TrajectoryError, match="not of 'op3'"):
        strip(OP3, Trajectory(hold(OP3).qpos, 50, ("tail", *OP3.joint_names[1:]), "lizard"))
    with pytest.raises(OutputError, match="missing"):
        video(OP3, hold(OP3), tmp_path / "missing" / "v.mp4")

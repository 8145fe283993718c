"""Written files read back unchanged; the reader recognises a format or asks for it."""

import numpy as np
import pytest
from format_moves import THERE, motion_of, robot_called
from made_trajectories import robot_of

from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.formats import FORMATS, FormatOptions, export, import_motion
from robot_retarget.formats.io import recognised
from robot_retarget.formats.source import TrajectorySource, sidecar_path
from robot_retarget.trajectory import Trajectory

ROUNDED = 2e-6
"""Of formats that store single precision, degrees with decimals or ticks of a file's own [m, rad]."""
TICK = 2 * np.pi / 4096
"""Of a Dynamixel servo [rad]."""
TICKS = {"servo-ticks", "op3-action"}
ROWS = {"unitree", "kimodo", "protomotions-csv"}


def written(format: str, name: str, folder, **options):
    kind, robot = FORMATS[format], robot_called(name)
    motion = motion_of(name, kind.fps or 50.0)
    return motion, export(motion, robot, format, folder / f"m{kind.suffix}", FormatOptions(**options))


def tolerance(format: str) -> float:
    return 1e-9 if FORMATS[format].exact else TICK / 2 if format in TICKS else ROUNDED


def mapped(format: str, name: str) -> None:
    if format in TICKS and name != "op3":
        pytest.skip("no servo map ships for this robot")


def held(trajectory, format: str):
    """The coordinates that a format holds; a skeleton does not tell whole turns of a hinge."""
    qpos = trajectory.qpos.copy()
    if format == "bvh":
        qpos[:, 7:] -= 2 * np.pi * np.floor(qpos[:, 7:] / (2 * np.pi) + 1e-6)
    return qpos[:, 0 if FORMATS[format].root else 7 :]


@pytest.mark.parametrize("name", THERE)
@pytest.mark.parametrize("format", FORMATS)
def test_export_then_import_gives_the_same_configurations(format: str, name: str, tmp_path) -> None:
    mapped(format, name)
    motion, path = written(format, name, tmp_path)
    back = import_motion(path, robot_called(name), format)
    assert back.fps == pytest.approx(motion.fps) and back.joint_names == motion.joint_names
    np.testing.assert_allclose(held(back, format), held(motion, format), rtol=0, atol=tolerance(format))


@pytest.mark.parametrize("format", FORMATS)
def test_a_file_is_known_by_itself_and_what_stands_beside_it(format: str, tmp_path) -> None:
    _, path = written(format, "op3", tmp_path)
    assert recognised(TrajectorySource(path, robot_called("op3"))).name == format


@pytest.mark.parametrize("name", THERE)
@pytest.mark.parametrize("format", FORMATS)
def test_a_file_alone_is_known_or_the_reader_asks_naming_what_it_may_be(format: str, name: str, tmp_path) -> None:
    mapped(format, name)
    _, path = written(format, name, tmp_path)
    sidecar_path(path).unlink(missing_ok=True)
    source = TrajectorySource(path, robot_called(name))
    if format in ROWS:
        with pytest.raises(UsageError, match=r"unitree or kimodo or protomotions-csv.*--format"):
            recognised(source)
    else:
        assert recognised(source).name == format
        assert [kind.name for kind in FORMATS.values() if kind.claims(source)] == [format]


@pytest.mark.parametrize("format", [name for name, kind in FORMATS.items() if not kind.complete])
def test_a_file_changed_since_is_not_what_the_json_beside_it_says(format: str, tmp_path) -> None:
    _, path = written(format, "op3", tmp_path)
    assert TrajectorySource(path, robot_called("op3")).sidecar
    path.write_bytes(path.read_bytes() + b"\n")
    with pytest.raises(TrajectoryError, match=rf"{path.name} is not the file that {path.name}.json describes"):
        import_motion(path, robot_called("op3"), format)


@pytest.mark.parametrize("format", [name for name, kind in FORMATS.items() if kind.ordered])
def test_joints_in_another_order_come_back_to_their_places(format: str, tmp_path) -> None:
    names = tuple(reversed(robot_called("op3").joint_names))
    motion, path = written(format, "op3", tmp_path, joints=names)
    back = import_motion(path, robot_called("op3"), format)
    np.testing.assert_allclose(held(back, format), held(motion, format), atol=tolerance(format))
    sidecar_path(path).unlink(missing_ok=True)
    told = import_motion(path, robot_called("op3"), format, FormatOptions(joints=names))
    np.testing.assert_allclose(told.qpos, back.qpos, atol=1e-12)


@pytest.mark.parametrize("format", [name for name, kind in FORMATS.items() if not kind.ordered])
def test_an_order_means_nothing_to_formats_that_have_their_own(format: str, tmp_path) -> None:
    with pytest.raises(UsageError, match="--joints"):
        written(format, "op3", tmp_path, joints=("head_pan",))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("fps", [25.0, 100.0])
def test_another_rate_keeps_the_time_of_the_motion(format: str, fps: float, tmp_path) -> None:
    if format == "op3-action" and fps == 100:
        pytest.skip("a keyframe takes whole cycles of 8 ms")
    motion, path = written(format, "op3", tmp_path, fps=fps)
    back = import_motion(path, robot_called("op3"), format, FormatOptions(source_fps=fps))
    assert back.fps == fps
    assert 0 <= motion.duration - back.duration < 1 / fps
    np.testing.assert_allclose(held(back, format)[0], held(motion, format)[0], atol=max(ROUNDED, tolerance(format)))


def test_a_hinge_whose_range_lies_beyond_half_a_turn_comes_back_from_a_skeleton_within_it(tmp_path) -> None:
    """A skeleton holds no whole turns: of all that fit, the one in the middle of the range is meant."""
    text = """<mujoco><compiler angle="radian"/><worldbody><body name="trunk"><freejoint/><geom type="box" size=".1 .1 .1"/>
    <body name="arm" pos="0 .2 0"><joint name="far" axis="0 1 0" range="3.3 6.1"/><geom type="capsule" size=".03 .1"/>
    <body name="hand" pos="0 0 .2"><joint name="near" axis="1 0 0" range="-7 -5"/><geom type="capsule" size=".02 .05"/></body></body>
    </body></worldbody></mujoco>"""
    robot, qpos = robot_of(text, tmp_path / "turned.xml"), np.zeros((20, 9))
    qpos[:, 3], qpos[:, 7], qpos[:, 8] = 1.0, np.linspace(3.4, 6.0, 20), np.linspace(-5.1, -6.9, 20)
    moves = Trajectory(qpos, 30.0, robot.joint_names, robot.name)
    back = import_motion(export(moves, robot, "bvh", tmp_path / "moves.bvh"), robot, "bvh")
    np.testing.assert_allclose(back.qpos[:, 7:], qpos[:, 7:], atol=1e-5)

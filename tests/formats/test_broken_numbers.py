"""Numbers that are not finite, cut or of an impossible size are refused with a sentence; nothing is read in silence."""

import contextlib
import io
import json
import pickle
import time
import zipfile

import numpy as np
import pytest
from format_moves import motion_of, robot_called

from robot_retarget.base.errors import RobotRetargetError, TrajectoryError
from robot_retarget.formats import FORMATS, export, import_motion
from robot_retarget.formats.source import sidecar_path

READ = {
    "omniretarget-training": {"joint_pos"},
    "protomotions-pyroki": {"base_frame_pos", "base_frame_wxyz", "joint_angles"},
}
"""Arrays that a reader needs, where they are not the usual ones."""


@pytest.fixture(scope="module")
def op3():
    return robot_called("op3")


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("format", ["unitree", "kimodo", "protomotions-csv", "soma", "csv", "servo-ticks"])
@pytest.mark.parametrize("column", [1, 4, -1])
def test_a_number_that_is_not_finite_is_refused(format: str, bad: str, column: int, op3, tmp_path) -> None:
    path = export(motion_of("op3", FORMATS[format].fps or 50.0), op3, format, tmp_path / "a.csv")
    lines = path.read_text(encoding="utf-8").splitlines()
    fields = lines[5].split(",")
    fields[column] = bad
    lines[5] = ",".join(fields)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    sidecar_path(path).unlink(missing_ok=True)
    with pytest.raises(TrajectoryError, match=r"a.csv.*not finite"):
        import_motion(path, op3, format)


@pytest.mark.parametrize("format", [name for name, kind in FORMATS.items() if kind.suffix == ".npz"])
@pytest.mark.parametrize("kind", ["text", "a lie about its size", "no frames", "nan"])
def test_arrays_of_text_of_impossible_size_or_of_no_frames_are_refused(format: str, kind: str, op3, tmp_path) -> None:
    path = export(motion_of("op3", FORMATS[format].fps or 50.0), op3, format, tmp_path / "a.npz")
    sidecar_path(path).unlink(missing_ok=True)
    with np.load(path) as arrays:
        table = {key: arrays[key] for key in arrays.files}
    for key in [key for key, value in table.items() if value.ndim >= 2 and len(value) == 14]:
        spoilt(path, table, key, kind)
        if key in READ.get(format, {"qpos", "joint_pos", "body_pos_w", "body_quat_w"}):
            with pytest.raises(RobotRetargetError):
                import_motion(path, op3, format)
        else:
            import_or_refuse(path, op3, format)


def import_or_refuse(path, robot, format: str) -> None:
    """Velocities and the like are not read; what is wrong with them may pass, but never as a crash."""
    with contextlib.suppress(RobotRetargetError):
        import_motion(path, robot, format)


def spoilt(path, table: dict, key: str, kind: str) -> None:
    value = table[key]
    if kind == "a lie about its size":
        stream = io.BytesIO()
        np.save(stream, value)
        shape = str(value.shape).encode()
        false = f"({2**38}, 9)".encode()
        data = stream.getvalue().replace(shape, false, 1)
        np.savez(path, **{name: array for name, array in table.items() if name != key})
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr(f"{key}.npy", data)
        return
    wrong = {"text": value.astype(str), "no frames": value[:0], "nan": np.full_like(value, np.nan)}[kind]
    np.savez(path, **{**table, key: wrong})


def test_a_table_cut_inside_its_last_number_is_refused_by_the_hash_beside_it(op3, tmp_path) -> None:
    path = export(motion_of("op3", 30.0), op3, "unitree", tmp_path / "a.csv")
    whole = path.read_bytes()
    path.write_bytes(whole[:-4])
    with pytest.raises(TrajectoryError, match=r"a.csv is not the file that a.csv.json describes"):
        import_motion(path, op3, "unitree")
    path.write_bytes(whole)
    assert len(import_motion(path, op3)) == 14
    other = json.loads(sidecar_path(path).read_text())
    del other["sha256"]
    sidecar_path(path).write_text(json.dumps(other))  # of another program: says nothing
    path.write_bytes(whole[:-4])
    assert len(import_motion(path, op3, "unitree")) == 14


def test_a_small_file_that_unpacks_to_gigabytes_is_told_by_its_keys_alone(op3, tmp_path) -> None:
    """Refused without unpacking: in a second, whatever it holds."""
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("noise.npy", "w") as member:
        stream = io.BytesIO()
        np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (1 << 26,)})
        member.write(stream.getvalue())
        block = bytes(1 << 22)
        for _ in range((1 << 29) // len(block)):
            member.write(block)
    began = time.process_time()
    with pytest.raises(TrajectoryError, match="no known format"):
        import_motion(path, op3)
    assert time.process_time() - began < 1.0


@pytest.mark.parametrize("name", ["a.pt", "a.pkl", "a.motion"])
def test_a_zip_that_is_no_pickle_is_refused(name: str, op3, tmp_path) -> None:
    with zipfile.ZipFile(tmp_path / name, "w") as archive:
        archive.writestr("readme.txt", "nothing here")
    with pytest.raises(TrajectoryError, match=name):
        import_motion(tmp_path / name, op3)


def test_quaternions_of_zeros_and_joint_kinds_of_another_shape_are_refused(op3, tmp_path) -> None:
    path = export(motion_of("op3"), op3, "locomujoco", tmp_path / "a.npz")
    with np.load(path) as arrays:
        np.savez(path, **{**arrays, "jnt_type": arrays["jnt_type"][..., None]})
    with pytest.raises(TrajectoryError, match="jnt_type must"):
        import_motion(path, op3)
    table = {"fps": 30, "root_pos": np.zeros((3, 3)), "root_rot": np.zeros((3, 4)), "dof_pos": np.zeros((3, 20))}
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(table))
    with pytest.raises(TrajectoryError, match="quaternion has the norm 0"):
        import_motion(tmp_path / "a.pkl", op3)


def test_a_pickle_cut_inside_a_number_is_refused(op3, tmp_path) -> None:
    path = export(motion_of("op3"), op3, "mimickit", tmp_path / "a.pkl")
    sidecar_path(path).unlink()
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(TrajectoryError, match="pickle"):
        import_motion(path, op3, "mimickit")

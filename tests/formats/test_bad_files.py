"""Broken, foreign and hostile files are refused with a sentence that names them, and leave nothing behind."""

import collections
import gzip
import os
import pickle
import zipfile
from typing import Any

import joblib
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from format_moves import motion_of, robot_called
from restated_readers import READERS, viser_player

from robot_retarget.base.errors import FileError, OutputError, TrajectoryError, UsageError
from robot_retarget.base.untrusted.pickles import dump_pickle, load_pickle
from robot_retarget.formats import FORMATS, FormatOptions, export, import_motion


@pytest.fixture(scope="module")
def op3():
    return robot_called("op3")


def gmr_table(op3, frames: int = 3) -> dict:
    return {
        "fps": 30,
        "root_pos": np.zeros((frames, 3)),
        "root_rot": np.tile([0.0, 0, 0, 1], (frames, 1)),
        "dof_pos": np.zeros((frames, len(op3.joint_names))),
    }


def saved(path, value):
    path.write_bytes(pickle.dumps(value))
    return path


def test_an_unknown_format_is_refused_with_the_known_ones(op3, tmp_path) -> None:
    path = saved(tmp_path / "a.pkl", gmr_table(op3))
    with pytest.raises(UsageError, match="'fbx'; known: native, csv, unitree"):
        import_motion(path, op3, "fbx")
    with pytest.raises(UsageError, match="'fbx'; known: native, csv, unitree"):
        export(motion_of("op3"), op3, "fbx", tmp_path / "b")


def test_a_file_of_no_format_is_refused_with_the_known_ones(op3, tmp_path) -> None:
    for name, data in (("a.txt", b"once upon a time"), ("b.bin", bytes(range(256))), ("c.csv", b""), ("d", b"1,2\n")):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(TrajectoryError, match=rf"{name}: no known format of robot motion .*known: native"):
            import_motion(tmp_path / name, op3)
    with pytest.raises(TrajectoryError, match="absent"):
        import_motion(tmp_path / "absent.npz", op3)


def packed(value, path, compress: Any) -> None:
    """What joblib writes; its annotations know no names of compressors."""
    joblib.dump(value, path, compress=compress)


class Runs:
    """An object whose pickle runs a command when it is read."""

    def __init__(self, mark) -> None:
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


@pytest.mark.parametrize("pack", ["pickle", "joblib", "joblib-lz4", "gzip"])
def test_a_pickle_that_wants_to_run_code_is_refused_and_does_not(op3, tmp_path, pack: str) -> None:
    value, path, mark = gmr_table(op3) | {"fps": Runs(tmp_path / "ran")}, tmp_path / "a.pkl", tmp_path / "ran"
    if pack == "joblib-lz4":
        packed(value, path, "lz4")
    elif pack == "joblib":
        joblib.dump(value, path)
    else:
        data = pickle.dumps(value)
        path.write_bytes(gzip.compress(data) if pack == "gzip" else data)
    with pytest.raises(TrajectoryError, match=r"a.pkl.*wants to make (posix|nt).mkdir, which could run code"):
        import_motion(path, op3)
    assert not mark.exists()


@pytest.mark.parametrize("program", [
    b"\x80\x04cbuiltins\neval\n(S'1'\ntR.", b"\x80\x04cos\nsystem\n(S'true'\ntR.", b"\x80\x04cnumpy\nload\n(S'x'\ntR.",
    b"\x80\x04cbuiltins\ngetattr\n(S'x'\nS'y'\ntR.", b"\x80\x04cjoblib.numpy_pickle\nNumpyUnpickler\n(S'x'\ntR.",
    b"\x80\x04cnumpy\nndarray\n}S'__doc__'\nS'x'\nsb.", b"\x80\x04cbuiltins\nbytearray\n(I99999999999\ntR.",
])  # fmt: skip
def test_no_pickle_makes_or_changes_anything_but_data(tmp_path, program: bytes) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(program)
    with pytest.raises(FileError, match=r"a.pkl"):
        load_pickle(path)


def test_pickles_of_old_and_new_numpy_joblib_and_lists_are_read_alike(op3, tmp_path) -> None:
    table = gmr_table(op3) | {
        "more": [1, 2.5, "text", None, True, (1, 2), {"a": np.float32(3)}],
        "empty": np.zeros((3, 0)),
    }
    path = tmp_path / "a.pkl"
    for protocol in range(6):
        for old in (False, True):
            data = pickle.dumps(table, protocol)
            path.write_bytes(data.replace(b"numpy._core", b"numpy.core") if old and protocol < 2 else data)
            same(load_pickle(path), table)
    for compress in (False, True, "lz4", ("gzip", 3)):
        packed(table | {"fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3))}, path, compress)
        read = load_pickle(path)
        np.testing.assert_array_equal(read.pop("fortran"), np.arange(6.0).reshape(2, 3))
        same(read, table)
    path.write_bytes(pickle.dumps(collections.OrderedDict(table)))
    same(load_pickle(path), table)


def same(read: dict, table: dict) -> None:
    assert list(read) == list(table)
    for key, value in table.items():
        if isinstance(value, np.ndarray):
            assert read[key].dtype == value.dtype
            np.testing.assert_array_equal(read[key], value)
        else:
            assert read[key] == value


def test_plain_pickles_name_only_what_every_numpy_has() -> None:
    data = dump_pickle({"a": np.arange(6.0).reshape(2, 3)})
    assert b"_core" not in data and b"multiarray" not in data
    read = pickle.loads(data)["a"]
    np.testing.assert_array_equal(read, np.arange(6.0).reshape(2, 3))
    read[0, 0] = 5  # torch wants arrays that can be written


def test_a_zip_bomb_is_refused_before_it_unpacks(op3, tmp_path) -> None:
    np.savez_compressed(tmp_path / "a.npz", qpos=np.zeros((1 << 17, 64)), fps=30)
    assert (tmp_path / "a.npz").stat().st_size < 1 << 17
    with pytest.raises(TrajectoryError, match=r"a.npz: .* takes more than \d+ bytes"):
        import_motion(tmp_path / "a.npz", op3)
    for name, compress in (("b.pkl", "lz4"), ("c.pkl", "gzip"), ("d.pkl", "zlib")):
        packed(np.zeros(1 << 23), tmp_path / name, (compress, 3))
        with pytest.raises(TrajectoryError, match=f"{name}: unpacks to more than"):
            import_motion(tmp_path / name, op3)


def test_a_size_that_lies_is_refused(op3, tmp_path) -> None:
    header = (
        b"\x93NUMPY\x01\x00v\x00"
        + b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 9)}".ljust(117)
        + b"\n"
    )
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("qpos.npy", header)
        archive.writestr("fps.npy", header)
    with pytest.raises(TrajectoryError, match=r"a.npz"):
        import_motion(tmp_path / "a.npz", op3)


@pytest.mark.parametrize("format", FORMATS)
def test_a_file_cut_short_is_refused(format: str, op3, tmp_path) -> None:
    kind = FORMATS[format]
    if not kind.suffix or not kind.exact:
        pytest.skip("cut text may still be a shorter motion")
    path = export(motion_of("op3", kind.fps or 50.0), op3, format, tmp_path / f"a{kind.suffix}")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2 + 3])
    with pytest.raises(TrajectoryError, match=r"a\."):
        import_motion(path, op3, format)


def test_names_that_are_not_the_robots_are_named_with_those_that_are(op3, tmp_path) -> None:
    path = saved(tmp_path / "a.pkl", gmr_table(op3))
    wrong = ("tail", *op3.joint_names[1:])
    with pytest.raises(TrajectoryError, match=r"a.pkl.*'tail' is not one of 'op3'; known: head_pan"):
        import_motion(path, op3, options=FormatOptions(joints=wrong))
    with pytest.raises(TrajectoryError, match="'head_tilt' stands twice"):
        import_motion(path, op3, options=FormatOptions(joints=(op3.joint_names[1], *op3.joint_names[1:])))


def test_columns_without_names_and_of_another_width_ask_for_names(op3, tmp_path) -> None:
    table = gmr_table(op3) | {"dof_pos": np.full((3, 2), 0.25)}
    path = saved(tmp_path / "a.pkl", table)
    with pytest.raises(TrajectoryError, match=r"2 joint columns without names, and 'op3' has 20.*--joints"):
        import_motion(path, op3)
    with pytest.raises(UsageError, match="3 joint names for 2 joint columns"):
        import_motion(path, op3, options=FormatOptions(joints=op3.joint_names[:3]))
    read = import_motion(path, op3, options=FormatOptions(joints=("_", "head_tilt")))
    place = int(op3.qpos_index[op3.joint_names.index("head_tilt")])
    np.testing.assert_array_equal(read.qpos[:, place], 0.25)
    assert "head_pan" in " ".join(read.notes)
    held = np.delete(read.qpos, [place, *range(7)], axis=1)
    np.testing.assert_array_equal(held, np.delete(np.tile(op3.standing(), (3, 1)), [place, *range(7)], axis=1))


def test_wrong_shapes_say_which(op3, tmp_path) -> None:
    for key, value in (("root_pos", np.zeros((3, 2))), ("root_rot", np.zeros((2, 4))), ("dof_pos", np.zeros(3))):
        path = saved(tmp_path / "a.pkl", gmr_table(op3) | {key: value})
        with pytest.raises(TrajectoryError, match=rf"a.pkl.*{key} must"):
            import_motion(path, op3)
    path = saved(tmp_path / "a.pkl", gmr_table(op3) | {"root_rot": np.full((3, 4), 0.7)})
    with pytest.raises(TrajectoryError, match=r"frame 0: the root's quaternion has the norm 1.4"):
        import_motion(path, op3)
    path = saved(tmp_path / "a.pkl", gmr_table(op3) | {"dof_pos": np.full((3, 20), np.nan)})
    with pytest.raises(TrajectoryError, match=r"a.pkl.*not finite at frame 0"):
        import_motion(path, op3)


def test_a_quaternion_that_is_nearly_unit_is_normalised_and_said(op3, tmp_path) -> None:
    table = gmr_table(op3)
    turns = np.array(table["root_rot"])
    turns[1] *= 0.9895
    read = import_motion(saved(tmp_path / "a.pkl", table | {"root_rot": turns}), op3)
    np.testing.assert_allclose(np.linalg.norm(read.qpos[:, 3:7], axis=1), 1.0, atol=1e-12)
    assert any("0.9895" in note and "1 frames" in note for note in read.notes)


@pytest.mark.parametrize(("content", "sentence"), [
    ({"action_traj": np.zeros((3, 30)), "time": np.zeros(3)}, "motor positions only"),
    ({"keyframes": [], "timed_sequence": []}, "keyframes of ToddlerBot"),
])  # fmt: skip
def test_known_files_that_are_not_read_say_what_they_are(content, sentence: str, op3, tmp_path) -> None:
    with pytest.raises(TrajectoryError, match=sentence):
        import_motion(saved(tmp_path / "a.pkl", content), op3)


def test_a_file_without_a_rate_asks_for_it(op3, tmp_path) -> None:
    table = gmr_table(op3)
    del table["fps"]
    path = saved(tmp_path / "a.pkl", table)
    with pytest.raises(UsageError, match="--source-fps"):
        import_motion(path, op3)
    assert import_motion(path, op3, options=FormatOptions(source_fps=24)).fps == 24


@pytest.mark.parametrize("key", ["motion_fps", "framerate", "mocap_frame_rate", "frequency"])
def test_every_name_of_the_frame_rate_is_read(key: str, op3, tmp_path) -> None:
    table = gmr_table(op3)
    table[key] = table.pop("fps")
    assert import_motion(saved(tmp_path / "a.pkl", table), op3).fps == 30
    path = export(motion_of("op3"), op3, "protomotions-pyroki", tmp_path / "a.npz", FormatOptions(fps=44))
    with np.load(path) as arrays:
        other = dict(arrays)
    np.savez(path, **{key: other.pop("fps")}, **other)
    assert import_motion(path, op3).fps == 44


@pytest.mark.parametrize("rate", [np.full(3, 30.0), "30"])
def test_a_rate_that_is_not_one_number_is_refused_and_no_default_is_taken(rate, op3, tmp_path) -> None:
    with pytest.raises(TrajectoryError, match="fps must be one positive number"):
        import_motion(saved(tmp_path / "a.pkl", gmr_table(op3) | {"fps": rate}), op3)
    path = export(motion_of("op3"), op3, "mjlab", tmp_path / "a.npz")
    with np.load(path) as arrays:
        np.savez(path, **{**arrays, "fps": rate})
    with pytest.raises(TrajectoryError, match="fps must be one positive number"):
        import_motion(path, op3)


def test_joints_in_the_other_trackers_order_are_refused_by_where_the_bodies_are(op3, tmp_path) -> None:
    for format, other in (("mjlab", "beyondmimic"), ("beyondmimic", "mjlab")):
        path = export(motion_of("op3"), op3, format, tmp_path / "a.npz")
        with np.load(path) as arrays:
            bare = {key: arrays[key] for key in arrays.files if not key.endswith("_names")}
        np.savez(path, **bare)
        assert import_motion(path, op3).qpos == pytest.approx(motion_of("op3").qpos, abs=1e-9)
        with pytest.raises(TrajectoryError, match=f"say --format {format}"):
            import_motion(path, op3, other)


def test_both_orders_of_omniretarget_are_told_by_their_norms(op3, tmp_path) -> None:
    motion = motion_of("op3")
    turned = motion.qpos[:, [3, 4, 5, 6, 0, 1, 2, *range(7, 27)]]
    thing = np.tile([1.0, 2, 3, 1, 0, 0, 0], (len(turned), 1))
    for name, qpos in (("a", turned), ("b", np.hstack([turned, thing])), ("c", np.hstack([motion.qpos, thing]))):
        np.savez(tmp_path / f"{name}.npz", qpos=qpos, fps=50)
        np.testing.assert_array_equal(import_motion(tmp_path / f"{name}.npz", op3).qpos, motion.qpos)
    both = motion.qpos.copy()
    both[:, :7] = [0.6, 0, 0, 0.8, 0, 0.6, 0]
    np.savez(tmp_path / "d.npz", qpos=both, fps=50)
    with pytest.raises(TrajectoryError, match="both columns 0–3 and 3–6 are unit quaternions"):
        import_motion(tmp_path / "d.npz", op3)
    np.savez(tmp_path / "e.npz", qpos=motion.qpos[:, :-1], fps=50)
    with pytest.raises(TrajectoryError, match="26 columns of qpos; 7 of a root and 20 joints are 27"):
        import_motion(tmp_path / "e.npz", op3)


@pytest.mark.parametrize(("stored", "expected"), [(50, 50.0), (1 / 50, 50.0), (None, 30.0), (30, 30.0)])
def test_both_meanings_of_omniretargets_fps_are_read(stored, expected: float, op3, tmp_path) -> None:
    rate = {} if stored is None else {"fps": stored}
    np.savez(tmp_path / "a.npz", qpos=motion_of("op3").qpos, **rate)
    assert import_motion(tmp_path / "a.npz", op3).fps == pytest.approx(expected)


def test_holosomas_readers_agree_on_the_rate_of_what_is_written(op3, tmp_path) -> None:
    path = export(motion_of("op3", 50.0), op3, "omniretarget", tmp_path / "a.npz")
    assert viser_player(path) == 30
    assert READERS["omniretarget"](path, op3.model).fps == pytest.approx(30)
    assert import_motion(path, op3).fps == 30


def test_an_object_in_a_training_archive_is_left_out_with_a_note(op3, tmp_path) -> None:
    path = export(motion_of("op3"), op3, "omniretarget-training", tmp_path / "a.npz")
    assert not import_motion(path, op3).notes
    with np.load(path) as arrays:
        np.savez(path, **arrays, object_pos_w=np.zeros((14, 3)), object_quat_w=np.tile([1.0, 0, 0, 0], (14, 1)))
    assert any("object's pose is left out" in note for note in import_motion(path, op3).notes)


@pytest.mark.parametrize("format", FORMATS)
def test_a_place_that_cannot_be_written_leaves_nothing(format: str, op3, tmp_path) -> None:
    with pytest.raises(OutputError, match="missing"):
        export(motion_of("op3"), op3, format, tmp_path / "missing" / "a.npz")
    taken = tmp_path / "taken"
    (taken / "kept").mkdir(parents=True)
    with pytest.raises(OutputError, match="taken"):
        export(motion_of("op3"), op3, format, taken)
    assert [path.name for path in tmp_path.rglob("*")] == ["taken", "kept"]


@pytest.mark.parametrize("format", FORMATS)
def test_a_writer_that_fails_leaves_the_old_file_as_it_was(format: str, op3, tmp_path, monkeypatch) -> None:
    kind, target = FORMATS[format], tmp_path / "a"
    target.write_text("old")

    def broken(motion, path):
        kind.write(motion, path)
        raise UsageError("no")

    monkeypatch.setitem(FORMATS, format, type(kind)(**{**kind.__dict__, "write": broken}))
    with pytest.raises(UsageError, match="no"):
        export(motion_of("op3"), op3, format, target)
    assert [path.name for path in tmp_path.iterdir()] == ["a"] and target.read_text() == "old"


def test_a_quaternion_in_the_other_order_is_doubted_and_can_be_told(op3, tmp_path) -> None:
    turn = np.linspace(0.2, 1.2, 3)
    standing = np.stack([np.cos(turn / 2), 0.02 * np.ones(3), 0 * turn, np.sin(turn / 2)], axis=1)
    standing /= np.linalg.norm(standing, axis=1, keepdims=True)
    path = saved(tmp_path / "a.pkl", gmr_table(op3) | {"root_rot": standing})  # w x y z, as some scripts write it
    read = import_motion(path, op3)
    assert any("say --quaternion wxyz" in note for note in read.notes)
    told = import_motion(path, op3, options=FormatOptions(quaternion="wxyz"))
    np.testing.assert_allclose(told.qpos[:, 3:7], standing, atol=1e-12)
    assert not any("--quaternion" in note for note in told.notes)
    right = saved(tmp_path / "b.pkl", gmr_table(op3) | {"root_rot": standing[:, [1, 2, 3, 0]]})
    assert not any("--quaternion" in note for note in import_motion(right, op3).notes)
    np.savetxt(tmp_path / "c.csv", np.hstack([np.zeros((3, 3)), standing, np.zeros((3, 20))]), delimiter=",")
    for format, told_as in (("kimodo", None), ("kimodo", "wxyz"), ("unitree", "wxyz")):
        found = import_motion(tmp_path / "c.csv", op3, format, FormatOptions(quaternion=told_as))
        np.testing.assert_allclose(found.qpos[:, 3:7], standing, atol=1e-12)
    with pytest.raises(UsageError, match="no order 'wzyx' of quaternions; known: wxyz, xyzw"):
        import_motion(path, op3, options=FormatOptions(quaternion="wzyx"))
    table = export(motion_of("op3"), op3, "csv", tmp_path / "d.csv")
    with pytest.raises(UsageError, match="--quaternion: format 'csv'"):
        import_motion(table, op3, options=FormatOptions(quaternion="xyzw"))


def test_a_data_set_of_equal_numbers_that_would_fill_memory_is_refused(op3, tmp_path) -> None:
    path = export(motion_of("op3"), op3, "lerobot", tmp_path / "a")
    rows = next((path / "data").glob("*/*.parquet"))
    state = pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(np.zeros(300_000 * 20, "f4")), 20)
    pyarrow.parquet.write_table(pyarrow.table({"observation.state": state}), rows)
    assert rows.stat().st_size < 100_000
    with pytest.raises(TrajectoryError, match="unpacks to more than"):
        import_motion(path, op3)


def test_a_data_set_whose_table_is_broken_names_it(op3, tmp_path) -> None:
    path = export(motion_of("op3"), op3, "lerobot", tmp_path / "a")
    rows = next((path / "data").glob("*/*.parquet"))
    rows.write_bytes(rows.read_bytes()[:-200])
    with pytest.raises(TrajectoryError, match=r"file-000\.parquet: not a readable Parquet table"):
        import_motion(path, op3)

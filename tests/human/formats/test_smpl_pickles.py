"""Pickles of video trackers: read as data, as the `.npz` of the same numbers is, and never run."""

import collections
import pickle
import sys
import types
import zipfile
from pathlib import Path

import joblib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robot_retarget.base.errors import MotionError
from robot_retarget.human.capture import Request
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers import tracked_people
from robot_retarget.human.readers.smpl import captured, mean_skeleton

T = 9
RNG = np.random.default_rng(9)
ROOT, BODY = RNG.normal(0, 0.2, (T, 3)).astype("f4"), RNG.normal(0, 0.2, (T, 63)).astype("f4")
PLACE, BETAS = RNG.normal(0, 1, (T, 3)).astype("f4"), np.zeros((T, 10), "f4")


@pytest.fixture
def expected(tmp_path) -> np.ndarray:
    np.savez(tmp_path / "clip.npz", global_orient=ROOT, body_pose=BODY, transl=PLACE, betas=BETAS)
    return read_motion(tmp_path / "clip.npz").positions


@pytest.mark.parametrize("pack", [0, 3])
def test_results_of_wham_are_its_bodies_in_the_world(tmp_path, expected, pack):
    poses = np.concatenate([ROOT, BODY, np.zeros((T, 6), "f4")], axis=1)
    world = {"pose_world": poses, "trans_world": PLACE, "betas": BETAS}
    people = {0: {**world, "pose": poses + 1, "trans": PLACE + 1}, 7: {**world, "trans_world": PLACE + 3}}
    joblib.dump(people, tmp_path / "wham_output.pkl", compress=pack)
    motion = read_motion(tmp_path / "wham_output.pkl")
    assert motion.positions == pytest.approx(expected, abs=1e-6)
    assert any("The first of 2 motions was read (0, 7)" in note for note in motion.notes)
    other = read_motion(f"{tmp_path / 'wham_output.pkl'}#7").positions
    assert np.ptp(other - motion.positions, axis=(0, 1)) == pytest.approx(0, abs=1e-5)


def as_torch(path: Path, value, monkeypatch) -> Path:
    """A file as `torch.save` lays it out; PyTorch itself is stood in for by names."""
    torch, utils = types.ModuleType("torch"), types.ModuleType("torch._utils")

    class FloatStorage:
        pass

    def _rebuild_tensor_v2(*_):
        raise AssertionError("a name only")

    for thing, module, home in ((FloatStorage, "torch", torch), (_rebuild_tensor_v2, "torch._utils", utils)):
        thing.__module__, thing.__qualname__ = module, thing.__name__
        setattr(home, thing.__name__, thing)
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.setitem(sys.modules, "torch._utils", utils)
    storages: list[bytes] = []

    class Storage:
        def __init__(self, array: np.ndarray):
            self.count = array.size
            storages.append(np.ascontiguousarray(array, "<f4").tobytes())
            self.name = str(len(storages) - 1)

    class Pickler(pickle._Pickler):
        def persistent_id(self, obj):
            return ("storage", FloatStorage, obj.name, "cuda:0", obj.count) if isinstance(obj, Storage) else None

        def save(self, obj, save_persistent_id=True):
            if isinstance(obj, np.ndarray):
                obj = Tensor(obj)
            return super().save(obj, save_persistent_id)  # pyright: ignore[reportAttributeAccessIssue]

    class Tensor:
        def __init__(self, array: np.ndarray):
            self.array = array

        def __reduce__(self):
            steps = tuple(step // 4 for step in np.ascontiguousarray(self.array, "f4").strides)
            hooks = collections.OrderedDict()
            return _rebuild_tensor_v2, (Storage(self.array), 0, self.array.shape, steps, False, hooks)

    with zipfile.ZipFile(path, "w") as archive:
        with archive.open("results/data.pkl", "w") as stream:
            Pickler(stream, protocol=2).dump(value)
        for k, data in enumerate(storages):
            archive.writestr(f"results/data/{k}", data)
    return path


def test_results_of_gvhmr_are_the_body_in_the_world_before_that_in_the_camera(tmp_path, expected, monkeypatch):
    world = {"body_pose": BODY, "global_orient": ROOT, "transl": PLACE, "betas": BETAS}
    said = {
        "smpl_params_incam": {**world, "transl": PLACE + 2},
        "smpl_params_global": world,
        "K_fullimg": np.eye(3)[None],
    }
    path = as_torch(tmp_path / "hmr4d_results.pt", said, monkeypatch)
    motion = read_motion(path)
    assert motion.positions == pytest.approx(expected, abs=1e-6)
    assert any("smpl_params_global, smpl_params_incam" in note for note in motion.notes)


def test_pickles_that_would_run_code_are_refused_and_do_not(tmp_path, monkeypatch):
    class Harm:
        def __reduce__(self):
            return Path.touch, (tmp_path / "harmed",)

    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"pose": Harm()}))
    as_torch(tmp_path / "a.pt", {"pose": Harm()}, monkeypatch)
    for name in ("a.pkl", "a.pt"):
        with pytest.raises(MotionError, match=rf"{name}: the pickle wants to make .*, which could run code"):
            read_motion(tmp_path / name)
    np.save(tmp_path / "b.npy", np.array([Harm()], dtype=object), allow_pickle=True)
    with pytest.raises(MotionError, match="without pickle"):
        read_motion(tmp_path / "b.npy")
    assert not (tmp_path / "harmed").exists()


def test_pickles_without_a_body_and_cut_ones_are_refused(tmp_path, monkeypatch):
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"dof_pos": np.zeros((4, 29)), "fps": 30, "misc": None}))
    with pytest.raises(MotionError, match=r"no turns of a body in this pickle; it holds dof_pos, fps"):
        read_motion(tmp_path / "a.pkl")
    whole = pickle.dumps({"pose": np.zeros((4, 72))})
    (tmp_path / "b.pkl").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(MotionError, match=r"b\.pkl: .*pickle"):
        read_motion(tmp_path / "b.pkl")
    path = as_torch(tmp_path / "c.pt", {"pose": np.zeros((4, 72), "f4")}, monkeypatch)
    with zipfile.ZipFile(path) as archive:
        index = archive.read("results/data.pkl")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("results/data.pkl", index)
        archive.writestr("results/data/0", bytes(40))
    with pytest.raises(MotionError, match=r"c\.pt: not a readable file of PyTorch"):
        read_motion(path)


def test_aist_pickles_are_scaled_bodies_at_sixty_frames_a_second(tmp_path, expected):
    poses = np.concatenate([ROOT, BODY, np.zeros((T, 6), "f4")], axis=1)
    content = {"smpl_poses": poses, "smpl_trans": 93.8 * PLACE, "smpl_scaling": np.array([93.8]), "smpl_loss": 0.1}
    (tmp_path / "gBR.pkl").write_bytes(pickle.dumps(content))
    assert read_motion(tmp_path / "gBR.pkl").fps == 60
    assert read_motion(tmp_path / "gBR.pkl", fps=30).positions == pytest.approx(expected, abs=1e-5)


def test_rows_of_motion_x_are_the_parameters_side_by_side(tmp_path, expected):
    rows = np.concatenate([ROOT, BODY, np.full((T, 243), 9.0), PLACE, BETAS], axis=1)
    np.save(tmp_path / "clip.npy", rows)
    motion = read_motion(tmp_path / "clip.npy")
    assert motion.fps == 30
    assert motion.positions == pytest.approx(expected, abs=1e-6)


def test_rows_of_phuma_are_those_of_motion_x_in_another_order(tmp_path):
    np.save(tmp_path / "a.npy", np.concatenate([PLACE, ROOT, BODY], axis=1))
    np.save(tmp_path / "b.npy", np.concatenate([ROOT, BODY, np.zeros((T, 243)), PLACE, np.zeros((T, 10))], axis=1))
    phuma, motion_x = read_motion(tmp_path / "a.npy"), read_motion(tmp_path / "b.npy")
    assert phuma.fps == 30
    assert phuma.positions == pytest.approx(motion_x.positions, abs=1e-9)


def phalp_frame(t: int, *people: tuple[int, int], lost: int = 0) -> dict:
    """A frame as 4D-Humans dumps it: people by track and by the frame of the clip that they show."""
    turn = lambda vectors: Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().astype("f4")  # noqa: E731
    bodies = [
        {
            "global_orient": turn(ROOT[k]),
            "body_pose": np.concatenate([turn(BODY[k]), np.tile(np.eye(3, dtype="f4"), (2, 1, 1))]),
            "betas": BETAS[0],
        }
        for _, k in people
    ]
    deep = 5000 / 256 * 1920 / np.hypot(1080, 1920)  # what their focal length makes of the distance
    return {
        "time": t, "tid": [name for name, _ in people], "smpl": bodies, "tracked_time": [lost for _ in people],
        "camera": [PLACE[k] * [1, 1, deep] for _, k in people], "size": [[1080, 1920] for _ in people], "mask": [],
    }  # fmt: skip


def test_tracks_of_4d_humans_are_people_over_the_frames_that_show_them(tmp_path) -> None:
    np.savez(tmp_path / "clip.npz", global_orient=ROOT, body_pose=BODY, transl=PLACE, betas=BETAS)
    expected = captured(dict(np.load(tmp_path / "clip.npz")), tmp_path, Request())
    frames = {f"{t}.jpg": phalp_frame(t, (4, t), (2, T - 1 - t)) for t in range(T)}
    frames["5.jpg"] = phalp_frame(5, (4, 0), lost=1)  # the tracker guesses
    joblib.dump(frames, tmp_path / "demo.pkl", compress=3)
    found = tracked_people.read_pickle(tmp_path / "demo.pkl", Request())
    there = np.arange(T) != 5
    np.testing.assert_allclose(found.positions[there], expected.positions[there], atol=1e-5)
    np.testing.assert_allclose(found.positions[5], (found.positions[4] + found.positions[6]) / 2, atol=1e-9)
    assert found.camera and found.up == "-y" and any("(4, 2)" in note for note in found.notes)
    other = tracked_people.read_pickle(tmp_path / "demo.pkl", Request(clip="2"))
    np.testing.assert_allclose(other.positions[[0, -1]], expected.positions[[-1, 0]], atol=1e-5)


def test_frames_of_multi_hmr_are_people_in_their_order(tmp_path) -> None:
    np.savez(tmp_path / "clip.npz", global_orient=ROOT, body_pose=BODY, transl=PLACE, betas=BETAS)
    expected = captured(dict(np.load(tmp_path / "clip.npz")), tmp_path, Request())
    turns = np.concatenate([ROOT, BODY, np.zeros((T, 93), "f4")], axis=1).reshape(T, 53, 3)
    rest = mean_skeleton(None)[0].offsets[0]
    person = lambda t: {"rotvec": turns[t], "transl_pelvis": (PLACE + rest)[t][None], "shape": BETAS[t], "scores": 0.9}  # noqa: E731
    (tmp_path / "humans.pkl").write_bytes(pickle.dumps([[person(t), person(0)] for t in range(T)]))
    found = tracked_people.read_pickle(tmp_path / "humans.pkl", Request())
    np.testing.assert_allclose(found.positions, expected.positions, atol=1e-5)
    assert found.camera and any("of 2 motions" in note for note in found.notes)


def test_results_of_genmo_are_the_body_in_the_world_and_those_of_gem_x_are_refused(tmp_path, expected) -> None:
    world = {"global_orient": ROOT, "body_pose": BODY, "transl": PLACE, "betas": BETAS}
    content = {
        "body_params_incam": {**world, "transl": PLACE + 1},
        "body_params_global": world,
        "segment_info": [{"start": 0}],
    }
    (tmp_path / "smpl_params.pkl").write_bytes(pickle.dumps(content))
    assert read_motion(tmp_path / "smpl_params.pkl").positions == pytest.approx(expected, abs=1e-6)
    soma = {"body_params_global": {**world, "identity_coeffs": np.zeros((T, 45))}}
    (tmp_path / "hpe_results.pkl").write_bytes(pickle.dumps(soma))
    with pytest.raises(MotionError, match=r"SOMA's 77 joints \(GEM-X\)"):
        read_motion(tmp_path / "hpe_results.pkl")

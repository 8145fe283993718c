"""One known motion in the layouts in which programs keep people from video and music: keys, frames and units as they write them."""

import collections
import io
import json
import pickle
import sys
import types
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.human.motion import Motion
from robot_retarget.human.readers.landmarks import LANDMARKS
from robot_retarget.human.readers.smpl import NAMES, PARENTS, mean_skeleton
from robot_retarget.human.recognition import recognise

Y_UP = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Takes z up to y up."""
TILT = Rotation.from_euler("xz", [0.25, 0.07]).as_matrix()
"""Of the camera: 14° down, 4° aside."""
CAMERA = TILT @ np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Takes z up to a camera's x right, y down, z away."""
AWAY = np.array([0.2, 0.4, 4.5])
REST = mean_skeleton(None)[0].offsets
LEGS = {"hip": "knee", "knee": "ankle", "ankle": "foot"}
ARMS = {"shoulder": "elbow", "elbow": "wrist"}


@dataclass(frozen=True)
class Dance:
    """A body of 24 joints over time: turns (T, 24, 3, 3) in the parents, places of the pelvis (T, 3) and of the joints [m], z up."""

    turns: np.ndarray
    pelvis: np.ndarray
    joints: np.ndarray

    def seen(self, turn: np.ndarray, shift: Any = (0.0, 0.0, 0.0)) -> "Dance":
        """The same body in another frame."""
        turns = self.turns.copy()
        turns[:, 0] = turn @ turns[:, 0]
        return Dance(turns, self.pelvis @ turn.T + shift, self.joints @ turn.T + shift)

    @property
    def vectors(self) -> np.ndarray:
        """(T, 72) turns as vectors."""
        flat = Rotation.from_matrix(self.turns.reshape(-1, 3, 3)).as_rotvec()
        return flat.reshape(len(self.turns), -1).astype("f4")

    @property
    def shift(self) -> np.ndarray:
        """(T, 3) the translation of SMPL."""
        return (self.pelvis - REST[0]).astype("f4")

    def at(self, name: str) -> np.ndarray:
        """The path of a joint."""
        return self.joints[:, NAMES.index(name)]


def danced(motion: Motion) -> Dance:
    """The mean SMPL body with the directions of a motion's limbs."""
    found = recognise(motion.skeleton, motion.positions)
    x = dict(zip(found.keypoints, found.place(motion.positions).swapaxes(0, 1), strict=True))
    ends = {f"{side}_{part}": x[f"{side[0]}_{key}"] for side in ("left", "right") for part, key in KEYPOINTS.items()}
    up = (ends["left_shoulder"] + ends["right_shoulder"]) / 2 - x["pelvis"]
    hips = framed(ends["left_hip"] - ends["right_hip"], up)
    chest = framed(ends["left_shoulder"] - ends["right_shoulder"], up)
    world = np.tile(hips[:, None], (1, 24, 1, 1))
    for k in range(NAMES.index("spine3"), 24):
        if not any(word in NAMES[k] for word in ("foot", "ankle", "knee", "hip")):
            world[:, k] = chest
    for side in ("left", "right"):
        for chain, start in ((LEGS, hips), (ARMS, chest)):
            turn = start
            for part, below in chain.items():
                way = ends[f"{side}_{below}"] - ends[f"{side}_{part}"]
                turn = aligned(turn, REST[NAMES.index(f"{side}_{below}")], way)
                world[:, NAMES.index(f"{side}_{part}")] = turn
            world[:, NAMES.index(f"{side}_{'foot' if chain is LEGS else 'wrist'}")] = turn
            world[:, NAMES.index(f"{side}_hand")] = world[:, NAMES.index(f"{side}_wrist")]
    turns = world.copy()
    for k in range(1, 24):
        turns[:, k] = np.swapaxes(world[:, PARENTS[k]], 1, 2) @ world[:, k]
    legs = [np.linalg.norm(REST[[NAMES.index("left_knee"), NAMES.index("left_ankle")]], axis=1).sum()]
    legs.append(
        sum(
            np.linalg.norm(ends[f"left_{a}"][0] - ends[f"left_{b}"][0]) for a, b in (("hip", "knee"), ("knee", "ankle"))
        )
    )
    pelvis = x["pelvis"] * legs[0] / legs[1]
    joints = np.tile(pelvis[:, None], (1, 24, 1))
    for k in range(1, 24):
        joints[:, k] = joints[:, PARENTS[k]] + world[:, PARENTS[k]] @ REST[k]
    return Dance(turns, pelvis, joints)


KEYPOINTS = {
    "hip": "hip", "knee": "knee", "ankle": "ankle", "foot": "toe", "shoulder": "shoulder", "elbow": "elbow", "wrist": "hand",
}  # fmt: skip


def framed(left: np.ndarray, up: np.ndarray) -> np.ndarray:
    """(T, 3, 3) frames with x to the left and y up."""
    x = left / np.linalg.norm(left, axis=1, keepdims=True)
    z = np.cross(x, up)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def aligned(turn: np.ndarray, rest: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Turns (T, 3, 3) that go on by the shortest turn which brings a rest direction to a way (T, 3)."""
    a, b = turn @ rest, way
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (a, b))
    axis = np.cross(a, b)
    sine, cosine = np.linalg.norm(axis, axis=1), (a * b).sum(axis=1)
    axis *= (np.arctan2(sine, cosine) / np.maximum(sine, 1e-12))[:, None]
    return Rotation.from_rotvec(axis).as_matrix() @ turn


# The files.


def prompt_hmr(folder: Path, dance: Dance) -> Path:
    def body(one: Dance) -> dict[str, np.ndarray]:
        hands = np.zeros((len(one.pelvis), 99), "f4")
        return {
            "pose": np.concatenate([one.vectors[:, :66], hands], axis=1),
            "shape": np.zeros((len(hands), 10), "f4"),
            "trans": one.shift,
        }

    person = {
        "frames": np.arange(len(dance.pelvis)),
        "smplx_cam": body(dance.seen(CAMERA, AWAY)),
        "smplx_world": body(dance.seen(Y_UP)),
    }
    joblib.dump({"camera": {"img_focal": 1000.0}, "people": {1: person}, "has_slam": True}, folder / "results.pkl")
    return folder / "results.pkl"


def edge(folder: Path, dance: Dance) -> Path:
    content = {"smpl_poses": dance.vectors, "smpl_trans": dance.pelvis.astype("f4"), "full_pose": dance.joints}
    (folder / "test_0.pkl").write_bytes(pickle.dumps(content))
    return folder / "test_0.pkl"


def tram(folder: Path, dance: Dance) -> Path:
    seen, frames = dance.seen(CAMERA, AWAY), len(dance.pelvis)
    people = {
        "pred_rotmat": seen.turns, "pred_trans": seen.shift[:, None], "pred_shape": np.zeros((frames, 10)),
        "frame": np.arange(frames),
    }  # fmt: skip
    (folder / "hps").mkdir()
    with torch_named() as tensor:
        np.save(folder / "hps" / "hps_track_0.npy", np.array({k: tensor(v) for k, v in people.items()}, dtype=object))
    turn = Y_UP @ CAMERA.T  # the camera's turn in a world with y up
    camera = {"world_cam_R": np.tile(turn, (frames, 1, 1)), "world_cam_T": np.tile(-turn @ AWAY, (frames, 1))}
    np.save(folder / "camera.npy", np.array({**camera, "img_focal": 1000.0}, dtype=object))
    return folder / "hps" / "hps_track_0.npy"


def tram_alone(folder: Path, dance: Dance) -> Path:
    path = tram(folder, dance)
    (folder / "camera.npy").unlink()
    return path


def slahmr(folder: Path, dance: Dance) -> Path:
    seen = dance.seen(CAMERA, AWAY)
    two = lambda values: np.stack([values, values])  # noqa: E731
    np.savez(
        folder / "clip_000060_world_results.npz", trans=two(seen.shift), root_orient=two(seen.vectors[:, :3]),
        pose_body=two(seen.vectors[:, 3:66]), betas=np.zeros((2, 16)), latent_pose=np.zeros((2, len(seen.pelvis), 32)),
        cam_R=np.tile(np.eye(3), (2, len(seen.pelvis), 1, 1)), floor_plane=np.zeros((1, 3)),
    )  # fmt: skip
    return folder / "clip_000060_world_results.npz"


def romp(folder: Path, dance: Dance) -> Path:
    seen = dance.seen(CAMERA, AWAY)
    frames = {
        f"{t:06d}.png": {
            "smpl_thetas": seen.vectors[t : t + 1], "cam_trans": seen.shift[t : t + 1], "smpl_betas": np.zeros((1, 10), "f4"),
            "track_ids": np.array([3]), "center_confs": np.ones((1, 1)),
        }
        for t in range(len(seen.pelvis))
    }  # fmt: skip
    np.savez(folder / "video_results.npz", results=frames, sequence_results={3: {"frame_id": [0]}})  # pyright: ignore[reportArgumentType]
    return folder / "video_results.npz"


def hybrik(folder: Path, dance: Dance) -> Path:
    seen = dance.seen(CAMERA, AWAY)
    content = {
        "pred_xyz_17": np.zeros((len(seen.pelvis), 17, 3)), "pred_betas": np.zeros((len(seen.pelvis), 10)),
        "pred_thetas": seen.turns.reshape(-1, 216), "transl": seen.pelvis, "img_path": ["a.jpg"] * len(seen.pelvis),
    }  # fmt: skip
    (folder / "res.pk").write_bytes(pickle.dumps(content))
    return folder / "res.pk"


H36M = (
    "pelvis", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "spine2", "neck", "head",
    "head", "left_shoulder", "left_elbow", "left_wrist", "right_shoulder", "right_elbow", "right_wrist",
)  # fmt: skip


def motionbert(folder: Path, dance: Dance) -> Path:
    seen = dance.seen(CAMERA, AWAY)
    points = np.stack([seen.at(name) for name in H36M], axis=1)
    points[:, 10] += 0.5 * (seen.at("head") - seen.at("neck"))
    points = (points - points[:1, :1]) * 0.42  # of the picture's half width, the depth from the first pelvis
    np.save(folder / "X3D.npy", points.astype("f4"))
    return folder / "X3D.npy"


def easymocap(folder: Path, dance: Dance) -> Path:
    """Seen by one camera; `Rh` turns about the origin of the body."""
    seen = dance.seen(CAMERA, AWAY)
    origin = seen.pelvis - seen.turns[:, 0] @ REST[0]
    for t, vectors in enumerate(seen.vectors.astype(float)):
        person = {
            "id": 0, "Rh": [vectors[:3].tolist()], "Th": [origin[t].tolist()], "poses": [[0.0] * 3 + vectors[3:].tolist()],
            "shapes": [[0.0] * 10],
        }  # fmt: skip
        (folder / f"{t:06d}.json").write_text(json.dumps([person]))
    return folder / "000000.json"


BODY_25 = (
    "head", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist", "pelvis",
    "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "head", "head", "head", "head",
    "left_foot", "left_foot", "left_ankle", "right_foot", "right_foot", "right_ankle",
)  # fmt: skip


def easymocap_points(folder: Path, dance: Dance) -> Path:
    """Triangulated by cameras that a board on the floor calibrates: z up."""
    points = np.stack([dance.at(name) for name in BODY_25], axis=1)
    for t, frame in enumerate(points):
        rows = [[*place, 0.9] for place in frame.tolist()]
        rows[3] = [0.0] * 4 if t == 20 else rows[3]  # an elbow that is lost
        (folder / f"{t:06d}.json").write_text(json.dumps([{"id": 0, "keypoints3d": rows}]))
    return folder / "000000.json"


def glamr(folder: Path, dance: Dance) -> Path:
    seen, frames = dance.seen(CAMERA, AWAY), len(dance.pelvis)
    there = np.ones(frames, dtype=bool)
    there[:5] = False  # the person comes later; the rows are extrapolated
    person = {
        "smpl_pose": dance.vectors[:, 3:], "smpl_beta": np.zeros((frames, 10)), "smpl_orient_world": dance.vectors[:, :3],
        "root_trans_world": dance.pelvis, "smpl_orient_cam": seen.vectors[:, :3], "root_trans_cam": seen.pelvis,
        "exist_frames": there, "frames": np.arange(frames), "scale": None,
    }  # fmt: skip
    (folder / "running_seed1.pkl").write_bytes(pickle.dumps({"person_data": {0: person}, "meta": {"num_fr": frames}}))
    return folder / "running_seed1.pkl"


def vibe(folder: Path, dance: Dance) -> Path:
    seen, frames = dance.seen(CAMERA), len(dance.pelvis)
    person = {
        "pred_cam": np.ones((frames, 3)), "orig_cam": np.ones((frames, 4)), "pose": seen.vectors, "betas": np.zeros((frames, 10)),
        "frame_ids": np.arange(frames), "joints2d": None,
    }  # fmt: skip
    joblib.dump({1: person}, folder / "vibe_output.pkl")
    return folder / "vibe_output.pkl"


def mediapipe(folder: Path, dance: Dance) -> Path:
    """World landmarks: about the middle of the hips."""
    seen = dance.seen(CAMERA)
    points = np.zeros((len(seen.pelvis), len(LANDMARKS), 3))
    for k, name in enumerate(LANDMARKS):
        side, _, part = name.partition("_")
        joint = {"foot_index": f"{side}_foot", "heel": f"{side}_ankle"}.get(part, name)
        points[:, k] = seen.at(joint if joint in NAMES else "head")
    hips = points[:, [LANDMARKS.index("left_hip"), LANDMARKS.index("right_hip")]].mean(axis=1, keepdims=True)
    frames = [
        {"worldLandmarks": [dict(zip("xyz", p, strict=True)) for p in frame]} for frame in (points - hips).tolist()
    ]
    (folder / "pose.json").write_text(json.dumps({"fps": 30, "frames": frames}))
    return folder / "pose.json"


def params(one: Dance) -> dict[str, np.ndarray]:
    return {
        "body_pose": one.vectors[:, 3:66], "global_orient": one.vectors[:, :3], "transl": one.shift,
        "betas": np.zeros((len(one.pelvis), 10), "f4"),
    }  # fmt: skip


def genmo(folder: Path, dance: Dance) -> Path:
    content = {"body_params_incam": params(dance.seen(CAMERA, AWAY)), "body_params_global": params(dance.seen(Y_UP))}
    (folder / "smpl_params.pkl").write_bytes(pickle.dumps(content))
    return folder / "smpl_params.pkl"


def gvhmr_in_camera(folder: Path, dance: Dance) -> Path:
    (folder / "incam.pkl").write_bytes(pickle.dumps({"smpl_params_incam": params(dance.seen(CAMERA, AWAY))}))
    return folder / "incam.pkl"


def wham(folder: Path, dance: Dance) -> Path:
    world, seen = dance.seen(Y_UP), dance.seen(CAMERA, AWAY)
    person = {
        "pose": seen.vectors, "trans": seen.shift, "pose_world": world.vectors, "trans_world": world.shift,
        "betas": np.zeros((len(seen.pelvis), 10)), "frame_ids": np.arange(len(seen.pelvis)),
    }  # fmt: skip
    joblib.dump({0: person}, folder / "wham_output.pkl")
    return folder / "wham_output.pkl"


def four_d_humans(folder: Path, dance: Dance) -> Path:
    seen, frames = dance.seen(CAMERA, AWAY), {}
    deep = 5000 / 256 * 1920 / np.hypot(1080, 1920)
    for t in range(len(seen.pelvis)):
        body = {"global_orient": seen.turns[t, :1], "body_pose": seen.turns[t, 1:], "betas": np.zeros(10)}
        frames[f"{t}.jpg"] = {
            "tid": [1], "smpl": [body], "camera": [seen.shift[t] * [1, 1, deep]], "tracked_time": [0], "size": [[1080, 1920]],
        }  # fmt: skip
    joblib.dump(frames, folder / "demo.pkl")
    return folder / "demo.pkl"


def multi_hmr(folder: Path, dance: Dance) -> Path:
    seen = dance.seen(CAMERA, AWAY)
    turns = np.concatenate([seen.vectors[:, :66], np.zeros((len(seen.pelvis), 93))], axis=1).reshape(-1, 53, 3)
    frames = [
        [{"rotvec": turns[t], "transl_pelvis": seen.pelvis[t][None], "shape": np.zeros(10)}] for t in range(len(turns))
    ]
    (folder / "humans.pkl").write_bytes(pickle.dumps(frames))
    return folder / "humans.pkl"


def sam_3d_body(folder: Path, dance: Dance) -> Path:
    seen = dance.seen(CAMERA, AWAY)
    names = {
        3: "head", 4: "head", 5: "left_shoulder", 6: "right_shoulder", 7: "left_elbow", 8: "right_elbow", 9: "left_hip",
        10: "right_hip", 11: "left_knee", 12: "right_knee", 13: "left_ankle", 14: "right_ankle", 15: "left_foot",
        16: "left_foot", 18: "right_foot", 19: "right_foot", 41: "right_wrist", 62: "left_wrist", 69: "neck",
    }  # fmt: skip
    points = np.zeros((len(seen.pelvis), 70, 3))
    for k, name in names.items():
        points[:, k] = seen.at(name) - seen.pelvis
    np.savez(folder / "people.npz", pred_keypoints_3d=points, pred_cam_t=seen.pelvis)
    return folder / "people.npz"


WRITERS: dict[str, Callable[[Path, Dance], Path]] = {
    "PromptHMR": prompt_hmr, "EDGE": edge, "TRAM": tram, "TRAM alone": tram_alone, "SLAHMR": slahmr, "ROMP": romp,
    "HybrIK": hybrik, "MotionBERT": motionbert, "EasyMocap": easymocap, "EasyMocap points": easymocap_points,
    "GLAMR": glamr, "VIBE": vibe, "MediaPipe": mediapipe, "GENMO": genmo, "GVHMR in camera": gvhmr_in_camera, "WHAM": wham,
    "4D-Humans": four_d_humans, "Multi-HMR": multi_hmr, "SAM 3D Body": sam_3d_body,
}  # fmt: skip
IN_CAMERA = (
    "TRAM alone", "SLAHMR", "ROMP", "HybrIK", "MotionBERT", "EasyMocap", "VIBE", "MediaPipe", "GVHMR in camera", "4D-Humans",
    "Multi-HMR", "SAM 3D Body",
)  # fmt: skip
"""In the frame of the tilted camera."""
IN_PLACE = ("VIBE", "MediaPipe")
"""Without a place in space."""


class torch_named:
    """Stands in for PyTorch by names, and makes tensors as `pickle` writes them without `torch.save`."""

    def __enter__(self) -> Callable[[np.ndarray], Any]:
        torch, utils, storage = (types.ModuleType(name) for name in ("torch", "torch._utils", "torch.storage"))
        kinds = {"f4": "FloatStorage", "f8": "DoubleStorage", "i8": "LongStorage"}
        for name in kinds.values():
            setattr(torch, name, type(name, (), {"__module__": "torch", "__qualname__": name}))

        def _rebuild_tensor_v2(*_: Any) -> None: ...
        def _load_from_bytes(*_: Any) -> None: ...

        for made, home in ((_rebuild_tensor_v2, utils), (_load_from_bytes, storage)):
            made.__module__, made.__qualname__ = home.__name__, made.__name__
            setattr(home, made.__name__, made)
        self.before = {name: sys.modules.get(name) for name in ("torch", "torch._utils", "torch.storage")}
        sys.modules.update({"torch": torch, "torch._utils": utils, "torch.storage": storage})

        class Storage:
            def __init__(self, array: np.ndarray):
                self.array = np.ascontiguousarray(array)

            def __reduce__(self) -> Any:
                stream, kind = io.BytesIO(), getattr(torch, kinds[self.array.dtype.str[1:]])
                for value in (0x1950A86A20F9469CFC6C, 1001, {"protocol_version": 1001, "little_endian": True}):
                    pickle.dump(value, stream, protocol=2)

                class Pickler(pickle.Pickler):
                    def persistent_id(self, obj: Any) -> Any:
                        return obj if isinstance(obj, tuple) and obj[:1] == ("storage",) else None

                Pickler(stream, protocol=2).dump(("storage", kind, "94", "cpu", self.array.size, None))
                pickle.dump(["94"], stream, protocol=2)
                stream.write(self.array.size.to_bytes(8, "little") + self.array.tobytes())
                return _load_from_bytes, (stream.getvalue(),)

        class Tensor:
            def __init__(self, array: np.ndarray):
                self.array = np.ascontiguousarray(array)

            def __reduce__(self) -> Any:
                steps = tuple(step // self.array.itemsize for step in self.array.strides)
                return _rebuild_tensor_v2, (
                    Storage(self.array), 0, self.array.shape, steps, False, collections.OrderedDict(),
                )  # fmt: skip

        return Tensor

    def __exit__(self, *_: object) -> None:
        for name, module in self.before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module

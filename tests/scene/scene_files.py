"""Bodies and scene files of the tests."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid

CLIP = rr.read_motion(ROOT / "samples" / "wave.bvh").frames(0, 40)
CUBE = solid(ShapeKind.BOX, (0.4, 0.4, 0.4))
FAR = np.array([1.5, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0])
CRATE = '[[body]]\nname = "crate"\nshape = "box"\nsize = [0.4, 0.4, 0.4]\nposes = "take.csv"\n'


def boxed(poses: np.ndarray, **facts: object) -> Scene:
    return Scene((RigidBody("box", CUBE, poses, **facts),))  # type: ignore[arg-type]


def path(frames: int, fps: float) -> np.ndarray:
    """A box that moves along x at 0.3 m/s and turns about z at 1 rad/s."""
    time = np.arange(frames) / fps
    turn = Rotation.from_rotvec(time[:, None] * [0, 0, 1]).as_quat(scalar_first=True)
    return np.concatenate([FAR[:3] + time[:, None] * [0.3, 0, 0], turn], axis=1)


def written(folder: Path, text: str) -> Path:
    file = folder / "scene.toml"
    file.write_text(text)
    return file


def optitrack(folder: Path, poses: Sequence[Sequence[object]]) -> Path:
    """An export of Motive in the layout of a public take (format 1.21): a body, a marker of it, an unlabelled marker."""
    facts = "Format Version,1.21,Take Name,take,Export Frame Rate,30.000000,Rotation Type,Quaternion,Length Units,Millimeters"
    columns = [
        *[("Rigid Body", "crate", "Rotation", axis) for axis in "XYZW"],
        *[("Rigid Body", "crate", "Position", axis) for axis in "XYZ"],
        ("Rigid Body", "crate", "Error Per Marker", ""),
        *[("Rigid Body Marker", "crate_1", "Position", axis) for axis in "XYZ"],
        ("Rigid Body Marker", "crate_1", "Marker Quality", ""),
        *[("Marker", "Unlabeled:108", "Position", axis) for axis in "XYZ"],
    ]
    kinds, names, channels, axes = (",".join(row) for row in zip(*columns, strict=True))
    identities = ",".join('"CF5107FC"' for _ in columns)
    rows = [f"{k},{k / 30:.6f},{','.join(map(str, pose))},0.1,1,2,3,0.99,,," for k, pose in enumerate(poses)]
    head = [facts, "", f",,{kinds}", f",,{names}", f",,{identities}", f",,{channels}", f"Frame,Time,{axes}"]
    file = folder / "take.csv"
    file.write_text("\n".join([*head, *rows]) + "\n")
    return file

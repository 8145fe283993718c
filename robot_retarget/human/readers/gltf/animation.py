"""Animations of glTF, GLB and VRMA files: nodes with keyed places and turns.

A joint is a bone of the map that VRMA has in the file, else a joint of the largest skin, else a node that is turned. At
rest, where the nodes are as the file places them, no joint is turned.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.gltf.container import GltfFile
from robot_retarget.human.readers.gltf.nodes import Keys, Nodes
from robot_retarget.human.readers.request import Request
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.human.tree import sorted_tree

VRMA = "VRMC_vrm_animation"


def matches_format(header: FileHeader) -> bool:
    """Whether a file is glTF, as text or binary."""
    text = header.text.lstrip()
    return header.head.startswith(b"glTF") or (text.startswith("{") and '"asset"' in text)


def read(path: Path, request: Request) -> Capture:
    """Read one animation, sampled at an even frame rate.

    Raises:
        MotionError: no animation or no joints, a broken file or field, or data that are compressed; names the field.
    """
    file = GltfFile.of(path)
    try:
        return _animated(file, request)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise MotionError(f"not laid out as glTF 2.0: {error}", path) from error


def _animated(file: GltfFile, request: Request) -> Capture:
    """Read the requested animation on the joints of the file."""
    path = file.path
    animations = file.listed("animations")
    if not animations:
        raise MotionError("animations: expected one, found none", path)
    titles = [str(animation.get("name") or f"animation {k}") for k, animation in enumerate(animations)]
    which, notes = request.choose(titles, path)
    nodes = Nodes.of(file)
    keys = nodes.keys(animations[which], f"animations[{which}]")
    joints, kind = _joints(file, keys)
    fps, rate_notes = request.rate()
    times = _times([track.times for track in keys.values()], fps)
    skeleton, positions, rotations = _posed(nodes, keys, joints, times)
    return Capture(skeleton, positions, rotations, fps, str(path), (*kind, *notes, *rate_notes), up="+y")


def _posed(
    nodes: Nodes, keys: Keys, named: Sequence[tuple[int, str]], times: Floats
) -> tuple[Skeleton, Floats, Floats]:
    """x_j and R_j R_rest⁻¹ of the joints at the times, and their rest positions."""
    joints = [joint for joint, _ in named]
    parents, order = sorted_tree(np.array([nodes.nearest_above(joint, joints) for joint in joints]))
    ordered = [joints[k] for k in order]
    positions, turns = nodes.world(keys, ordered, times)
    rest, rest_turns = nodes.world({}, ordered, np.zeros(1))
    undone = [_turn(turns[:, k]) * _turn(rest_turns[:, k]).inv() for k in range(len(ordered))]
    rotations = np.stack([turn.as_quat(scalar_first=True) for turn in undone], axis=1)
    offsets = np.where(parents[:, None] < 0, 0.0, rest[0] - rest[0][np.maximum(parents, 0)])
    return Skeleton(tuple(named[k][1] for k in order), parents, offsets), positions, rotations


def _turn(quaternions: Floats) -> Rotation:
    return Rotation.from_quat(quaternions, scalar_first=True)


def _joints(file: GltfFile, keys: Keys) -> tuple[list[tuple[int, str]], tuple[str, ...]]:
    """The nodes that are joints with their names, and a note about the choice."""
    bones = file.extension(VRMA).get("humanoid", {}).get("humanBones", {})
    if bones:
        named = [(bone.get("node"), name) for name, bone in bones.items()]
        return named, ("The bones are those of the file's own map.",)
    skins = [skin.get("joints", []) for skin in file.listed("skins")]
    joints = max(skins, key=len, default=[])
    notes = (f"Of {len(skins)} skins that with the most joints was taken.",) if len(skins) > 1 else ()
    joints = joints or sorted({node for node, path in keys if path == "rotation"})
    if not joints:
        raise MotionError("no skin, no bone map and no node that is turned: nothing moves like a body", file.path)
    titles = {joint: file.listed("nodes")[joint].get("name") for joint in joints if joint < len(file.listed("nodes"))}
    names = _different([str(titles.get(joint) or f"node_{joint}") for joint in joints])
    return list(zip(joints, names, strict=True)), notes


def _different(names: Sequence[str]) -> list[str]:
    """The names, a number added to those that come again."""
    return [name if names.index(name) == k else f"{name}_{k}" for k, name in enumerate(names)]


def _times(tracks: Sequence[Floats], fps: float) -> Floats:
    """From the first key to the last [s], evenly."""
    first, last = min(float(t[0]) for t in tracks), max(float(t[-1]) for t in tracks)
    return first + np.arange(int((last - first) * fps + 1e-6) + 1) / fps

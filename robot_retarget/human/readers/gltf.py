"""The nodes of a glTF file over time: keyed places, turns and sizes, put together from the root down."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import FileError, MotionError
from robot_retarget.base.untrusted.limits import LIMITS
from robot_retarget.base.untrusted.rotations import LENGTHS, checked_quaternions, quaternions_of_matrices
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.readers.gltf_container import GltfFile
from robot_retarget.human.skeleton import Skeleton, sorted_tree

WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
"""Numbers of each kind of value in the format."""
_REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
"""Values of a node that states none, in the format."""


@dataclass(frozen=True)
class Channel:
    """The keys of one property of a node."""

    times: Floats
    """(N,) [s], rising."""
    values: Floats
    """(N, W), or (N, 3, W) of a spline: slope before, value, slope after. Turns are x y z w."""
    interpolation: str

    def at(self, times: Floats, turns: bool) -> Floats:
        """(T, W) at (T,) times, the ends held beyond them."""
        t = np.clip(times, self.times[0], self.times[-1])
        if self.interpolation == "STEP" or len(self.times) == 1:
            plain = self.values if self.values.ndim == 2 else self.values[:, 1]
            return plain[np.searchsorted(self.times, t + 1e-6, side="right") - 1]
        if self.values.ndim == 3:
            before, values, after = self.values[:, 0], self.values[:, 1], self.values[:, 2]
            return _spline(self.times, before, values, after, t)
        if turns:
            return Slerp(self.times, Rotation.from_quat(self.values))(t).as_quat()
        return np.stack([np.interp(t, self.times, column) for column in self.values.T], axis=1)


Keys = Mapping[tuple[int, str], Channel]
"""Of an animation, by node and property."""


@dataclass(frozen=True)
class Nodes:
    """The tree of nodes and where each is at rest."""

    file: GltfFile
    parents: tuple[int, ...]

    @classmethod
    def of(cls, file: GltfFile) -> "Nodes":
        """Find every node's parent.

        Raises:
            MotionError: a child that is no node, or nodes in a ring.
        """
        nodes = file.listed("nodes")
        parents = [-1] * len(nodes)
        for index, node in enumerate(nodes):
            for child in node.get("children", []):
                if not isinstance(child, int) or not 0 <= child < len(nodes):
                    raise file.error(f"nodes[{index}].children", f"node {child} is not there")
                parents[child] = index
        found = cls(file, tuple(parents))
        for index in range(len(nodes)):
            found.above(index)
        return found

    def above(self, node: int) -> list[int]:
        """A node and all that carry it, up to the root.

        Raises:
            MotionError: the nodes form a ring.
        """
        path = [node]
        while (parent := self.parents[path[-1]]) >= 0:
            if len(path) > len(self.parents):
                raise self.file.error(f"nodes[{node}]", "its parents form a ring")
            path.append(parent)
        return path

    def nearest_above(self, node: int, chosen: Sequence[int]) -> int:
        """Which of the chosen nodes carries a node, by its place among them; −1 for none.

        Raises:
            MotionError: the node is not there.
        """
        if not isinstance(node, int) or not 0 <= node < len(self.parents):
            raise self.file.error("joints", f"node {node} is not there")
        return next((list(chosen).index(one) for one in self.above(node)[1:] if one in chosen), -1)

    def keys(self, animation: Mapping[str, Any], where: str) -> dict[tuple[int, str], Channel]:
        """The tracks of an animation that place, turn or size a node.

        Raises:
            MotionError: a field is missing, keys that do not rise in time, values of another width, or no track.
        """
        tracks: dict[tuple[int, str], Channel] = {}
        samplers = animation.get("samplers", [])
        for index, channel in enumerate(animation.get("channels", [])):
            target, at = channel.get("target", {}), f"{where}.channels[{index}]"
            node, path = target.get("node"), target.get("path")
            if path not in WIDTHS or node is None:
                continue
            sampler = channel.get("sampler")
            if not isinstance(sampler, int) or not 0 <= sampler < len(samplers) or not 0 <= node < len(self.parents):
                raise self.file.error(at, f"sampler {sampler} or node {node} is not there")
            tracks[node, path] = self._track(samplers[sampler], path, at)
        if not tracks:
            raise self.file.error(where, "no channel that places or turns a node")
        return tracks

    def _track(self, sampler: Mapping[str, Any], path: str, where: str) -> Channel:
        times = self.file.numbers(sampler.get("input"), f"{where} input")[:, 0]
        values = self.file.numbers(sampler.get("output"), f"{where} output")
        way = str(sampler.get("interpolation", "LINEAR"))
        if way == "CUBICSPLINE" and len(values) == 3 * len(times):
            values = values.reshape(len(times), 3, -1)
        if len(values) != len(times) or values.shape[-1] != WIDTHS[path]:
            shape = f"{len(times)} keys of {WIDTHS[path]} numbers"
            raise self.file.error(where, f"{path}: expected {shape}, found {values.shape}")
        if not (np.isfinite(times).all() and np.isfinite(values).all() and np.all(np.diff(times) > 0)):
            raise self.file.error(where, f"{path}: expected finite keys that rise in time")
        if path == "rotation" and way != "CUBICSPLINE" and not np.all(np.linalg.norm(values, axis=-1) > LENGTHS[0]):
            raise self.file.error(where, "rotation: expected unit quaternions x y z w")
        return Channel(times, values, way)

    def world(self, keys: Keys, joints: Sequence[int], times: Floats) -> tuple[Floats, Floats]:
        """Places (T, J, 3) and turns (T, J, 4) w x y z of nodes in the scene; no keys give the rest.

        x_j = M_p t_j with M the product of place, turn and size from the root down; a size turns nothing.
        """
        matrices: dict[int, Floats] = {-1: np.tile(np.eye(4), (len(times), 1, 1))}
        turns: dict[int, Rotation] = {-1: Rotation.identity(len(times))}
        for joint in joints:
            for node in reversed(self.above(joint)):
                if node not in matrices:
                    place, turn, size = self._local(node, keys, times)
                    above = self.parents[node]
                    matrices[node] = matrices[above] @ _matrix(place, turn, size)
                    turns[node] = turns[above] * turn
        placed = np.stack([matrices[joint][:, :3, 3] for joint in joints], axis=1)
        return placed, np.stack([turns[joint].as_quat(scalar_first=True) for joint in joints], axis=1)

    def _local(self, node: int, keys: Keys, times: Floats) -> tuple[Floats, Rotation, Floats]:
        """Place (T, 3), turn and size (T, 3) of a node in its parent."""
        rest = self._rest(node)
        found = {}
        for path, width in WIDTHS.items():
            track = keys.get((node, path))
            values = np.broadcast_to(rest[path], (len(times), width)) if track is None else track.at(times, width == 4)
            found[path] = values
        turn = Rotation.from_quat(checked_quaternions(found["rotation"], f"nodes[{node}].rotation"))
        return found["translation"], turn, found["scale"]

    def _rest(self, node: int) -> dict[str, Floats]:
        """The three properties of a node without keys."""
        entry = self.file.listed("nodes")[node]
        if "matrix" in entry:
            return _parts(np.array(entry["matrix"], dtype=float).reshape(4, 4).T)
        rest = {path: np.array(entry.get(path) or default, dtype=float) for path, default in _REST.items()}
        for path, value in rest.items():
            if value.shape != (WIDTHS[path],) or not np.isfinite(value).all():
                raise self.file.error(f"nodes[{node}].{path}", f"expected {WIDTHS[path]} finite numbers")
        return rest


def _matrix(place: Floats, turn: Rotation, size: Floats) -> Floats:
    matrix = np.tile(np.eye(4), (len(place), 1, 1))
    matrix[:, :3, :3] = turn.as_matrix() * size[:, None, :]
    matrix[:, :3, 3] = place
    return matrix


def _parts(matrix: Floats) -> dict[str, Floats]:
    """Place, turn and size of a matrix (4, 4) without shear."""
    size = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) < 0:
        size = -size
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = quaternions_of_matrices(matrix[:3, :3] / size, "matrix")[[1, 2, 3, 0]]
    return {"translation": matrix[:3, 3], "rotation": turn, "scale": size}


def _spline(times: Floats, before: Floats, values: Floats, after: Floats, t: Floats) -> Floats:
    """(T, W) of cubic pieces whose slopes into and out of a key differ."""
    from scipy.interpolate import CubicHermiteSpline

    piece = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    out = np.empty((len(t), values.shape[1]))
    for k in np.unique(piece):
        ends = slice(k, k + 2)
        curve = CubicHermiteSpline(times[ends], values[ends], np.stack([after[k], before[k + 1]]))
        out[piece == k] = curve(t[piece == k])
    return out


# Animations of glTF, GLB and VRMA files: nodes with keyed places and turns.
#
# A joint is a bone of the map that VRMA has in the file, else a joint of the largest skin, else a node that is turned. At
# rest, where the nodes are as the file places them, no joint is turned.

VRMA = "VRMC_vrm_animation"
FRAME = 56
"""Of a joint in a frame, place and turn [bytes]."""


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
    except FileError as error:
        raise MotionError(str(error), path) from error
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
    fps, _ = request.rate()
    sampled = f"Sampled at {fps:g} frames per second from the times of its keys."
    most = LIMITS.unpacked(path) / (FRAME * max(len(joints), 1))
    times = _times([track.times for track in keys.values()], fps, most)
    skeleton, positions, rotations = _posed(nodes, keys, joints, times)
    return Capture(skeleton, positions, rotations, fps, str(path), (*kind, *notes, sampled), up="+y")


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


def _times(tracks: Sequence[Floats], fps: float, most: float) -> Floats:
    """Evenly spaced times from the first key to the last [s], at most as many as the limit of frames."""
    first, last = min(float(t[0]) for t in tracks), max(float(t[-1]) for t in tracks)
    if not (last - first) * fps < most:
        raise MotionError(f"keys over {last - first:.3g} s, more than {most / fps:.0f} s for a file of this size")
    return first + np.arange(int((last - first) * fps + 1e-6) + 1) / fps

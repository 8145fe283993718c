"""glTF, GLB and VRMA: what scipy and an independent reader of the container make of the same file."""

import base64
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp
from shared_files import SHARED, needs_shared

from robot_retarget.base.errors import MotionError
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.capture import Request
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers import gltf
from robot_retarget.human.readers.gltf_container import GltfFile
from robot_retarget.human.recognition import recognise

FOLDER = SHARED / "motions" / "other" / "gltf"
BONES = {
    "leftUpperLeg": "l_hip", "leftLowerLeg": "l_knee", "leftFoot": "l_ankle", "leftToes": "l_toe",
    "leftUpperArm": "l_shoulder", "leftLowerArm": "l_elbow", "leftHand": "l_hand",
    "rightUpperLeg": "r_hip", "rightLowerLeg": "r_knee", "rightFoot": "r_ankle", "rightToes": "r_toe",
    "rightUpperArm": "r_shoulder", "rightLowerArm": "r_elbow", "rightHand": "r_hand",
    "chest": "chest", "neck": "neck", "head": "head",
}  # fmt: skip
"""The keypoint that each bone of VRM's humanoid is."""


@needs_shared
def test_the_bones_of_a_vrma_are_the_keypoints_that_their_names_say():
    motion = read_motion(FOLDER / "three-vrm_test.vrma")
    recognition = recognise(motion.skeleton, motion.positions)
    assert recognition.keypoints == KEYPOINTS
    found = {motion.skeleton.names[mark.joints[0]]: k for k, mark in recognition.marks.items() if len(mark.joints) == 1}
    assert found == BONES


@needs_shared
def test_a_vrma_is_posed_as_matrices_of_an_independent_reader_pose_it():
    import pygltflib

    path = FOLDER / "three-vrm_test.vrma"
    capture = gltf.read(path, Request(fps=24))
    file = pygltflib.GLTF2().load_binary(str(path))
    assert file is not None
    blob = file.binary_blob()
    assert blob is not None

    def numbers(index: int, width: int) -> np.ndarray:
        accessor = file.accessors[index]
        view = file.bufferViews[accessor.bufferView or 0]
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        return np.frombuffer(blob, "<f4", accessor.count * width, start).reshape(-1, width)

    keyed = {}
    for channel in file.animations[0].channels:
        sampler = file.animations[0].samplers[channel.sampler]
        width = 4 if channel.target.path == "rotation" else 3
        keyed[channel.target.node, channel.target.path] = (
            numbers(sampler.input, 1)[:, 0],
            numbers(sampler.output, width),
        )
    start = min(times[0] for times, _ in keyed.values())
    parent = {child: index for index, node in enumerate(file.nodes) for child in node.children or []}
    bones = (file.extensions or {})["VRMC_vrm_animation"]["humanoid"]["humanBones"]

    def matrix(index: int, time: float) -> np.ndarray:
        node, local = file.nodes[index], np.eye(4)
        turn = Rotation.from_quat(node.rotation or [0, 0, 0, 1])
        if (index, "rotation") in keyed:
            times, values = keyed[index, "rotation"]
            turn = Slerp(times, Rotation.from_quat(values))([np.clip(time, times[0], times[-1])])[0]
        local[:3, :3], local[:3, 3] = turn.as_matrix(), node.translation or [0, 0, 0]
        return matrix(parent[index], time) @ local if index in parent else local

    for frame in range(0, len(capture.positions), 7):
        for name, bone in bones.items():
            joint = capture.skeleton.names.index(name)
            expected = matrix(bone["node"], start + frame / 24)
            assert capture.positions[frame, joint] == pytest.approx(expected[:3, 3], abs=1e-6), (frame, name)


@needs_shared
def test_a_clip_of_many_is_chosen_by_name_and_the_others_are_told():
    path = FOLDER / "KayKit_Knight_CC0.glb"
    walk = gltf.read(path, Request(clip="walking_a"))
    assert not any("of 76 motions" in note for note in walk.notes)
    first = gltf.read(path, Request())
    assert any("The first of 76 motions was read" in note and "#" in note for note in first.notes)
    assert "Sampled at 30 frames per second from the times of its keys." in first.notes
    with pytest.raises(MotionError, match=r"holds no motion 'Moonwalk'; known: .*Walking_A"):
        read_motion(f"{path}#Moonwalk")
    feet = [walk.skeleton.names.index(name) for name in ("foot.l", "foot.r")]
    apart = np.subtract(*walk.positions[:, feet, 2].T)
    assert apart.min() < -0.1 and apart.max() > 0.1, "both feet come ahead of the other"
    for above, below in (("upperleg.l", "lowerleg.l"), ("upperarm.r", "lowerarm.r")):
        ends = [walk.skeleton.names.index(name) for name in (above, below)]
        length = np.linalg.norm(np.subtract(*walk.positions[:, ends].swapaxes(0, 1)), axis=1)
        assert length == pytest.approx(np.linalg.norm(walk.skeleton.offsets[ends[1]]), rel=1e-3)


def packed(arrays: list[np.ndarray]) -> tuple[list, list, bytes]:
    """Accessors, views and the buffer of arrays."""
    data, views, accessors = b"", [], []
    for k, array in enumerate(arrays):
        raw = array.astype("<f4").tobytes()
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(raw)})
        kind = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[array.reshape(len(array), -1).shape[1]]
        accessors.append({"bufferView": k, "componentType": 5126, "count": len(array), "type": kind})
        data += raw
    return accessors, views, data


def arm(tmp_path: Path, times, values, path="rotation", way="LINEAR", binary=False, **changes) -> Path:
    """Two nodes, the second a metre from the first, which is turned or moved by keys."""
    accessors, views, data = packed([np.asarray(times, float), np.asarray(values, float)])
    said = {
        "asset": {"version": "2.0"},
        "nodes": [
            {"name": "upper", "children": [1], "translation": [0, 1, 0], "scale": [2, 2, 2]},
            {"name": "lower", "translation": [0.5, 0, 0], "rotation": [0, 0, 0, 1]},
        ],
        "animations": [
            {
                "channels": [
                    {"sampler": 0, "target": {"node": 0, "path": path}},
                    {"sampler": 0, "target": {"node": 1, "path": "weights"}},
                ],
                "samplers": [{"input": 0, "output": 1, "interpolation": way}],
            }
        ],
        "skins": [{"joints": [1, 0]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    said |= changes
    if not binary:
        said["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        (tmp_path / "arm.gltf").write_text(json.dumps(said))
        return tmp_path / "arm.gltf"
    text = json.dumps(said).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    (tmp_path / "arm.glb").write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    return tmp_path / "arm.glb"


QUARTER = [[0, 0, 0, 1], [0, 0, np.sqrt(0.5), np.sqrt(0.5)]]


@pytest.mark.parametrize("binary", [False, True])
def test_a_turn_is_interpolated_on_the_sphere_and_sizes_lengthen_bones(tmp_path, binary):
    capture = gltf.read(arm(tmp_path, [0, 1], QUARTER, binary=binary), Request(fps=10))
    assert capture.skeleton.names == ("upper", "lower") and capture.fps == 10 and len(capture.positions) == 11
    angle = np.linspace(0, np.pi / 2, 11)
    reach = np.stack([np.cos(angle), 1 + np.sin(angle), 0 * angle], axis=1)
    assert capture.positions[:, 1] == pytest.approx(reach, abs=1e-6)
    assert capture.skeleton.offsets[1] == pytest.approx([1, 0, 0])
    assert capture.rotations is not None
    turn = Rotation.from_quat(capture.rotations[:, 1], scalar_first=True)
    assert turn.as_rotvec()[:, 2] == pytest.approx(angle, abs=1e-6)


def test_a_step_holds_its_key_and_a_spline_is_the_formats_own_cubic(tmp_path):
    held = gltf.read(arm(tmp_path, [0, 1], [[0, 0, 0], [1, 2, 3]], "translation", "STEP"), Request(fps=4))
    assert held.positions[:, 0, 0].tolist() == [0, 0, 0, 0, 1]
    keys = [[0, 0, 0], [0, 0, 0], [3, 0, 0], [-1, 0, 0], [1, 2, 3], [0, 0, 0]]
    curved = gltf.read(arm(tmp_path, [0, 2], keys, "translation", "CUBICSPLINE"), Request(fps=2))
    s = np.linspace(0, 1, 5)
    cubic = 2 * (s**3 - 2 * s**2 + s) * 3 + (3 * s**2 - 2 * s**3) * 1 + 2 * (s**3 - s**2) * -1
    assert curved.positions[:, 0, 0] == pytest.approx(cubic, abs=1e-6)


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.6))
def test_any_rest_pose_leaves_no_joint_turned_at_rest(tmp_path_factory, rest):
    folder = tmp_path_factory.mktemp("rest")
    turn = (np.array(rest) / np.linalg.norm(rest)).tolist()
    nodes = [{"children": [1], "rotation": turn}, {"translation": [1, 2, 3], "rotation": turn}]
    capture = gltf.read(arm(folder, [0, 1], [turn, turn], nodes=nodes), Request(fps=5))
    assert capture.rotations is not None
    assert np.abs(capture.rotations[..., 0]) == pytest.approx(1, abs=1e-6)
    assert capture.positions[:, 1] - capture.positions[:, 0] == pytest.approx(
        np.tile(capture.skeleton.offsets[1], (6, 1)), abs=1e-5
    )


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"animations": []}, "animations: expected one, found none"),
        ({"asset": {"version": "1.0"}}, r"asset\.version: expected glTF 2\.0, found 1\.0"),
        ({"skins": [{"joints": [0, 9]}]}, "joints: node 9 is not there"),
        ({"accessors": []}, r"accessors\[0\] is not there"),
        ({"buffers": [{"byteLength": 4, "uri": "../outside.bin"}]}, r"buffers\[0\]\.uri: expected the file"),
        ({"nodes": [{"children": [1]}, {"children": [0]}]}, r"nodes\[\d\]: its parents form a ring"),
        ({"nodes": [{"children": [7]}, {}]}, r"nodes\[0\]\.children: node 7 is not there"),
        ({"asset": "2.0"}, r"asset\.version: expected glTF 2\.0, found none"),
        ({"nodes": [1, 2]}, r"not laid out as glTF 2\.0"),
        ({"skins": {"joints": [0]}}, "skins: expected a list"),
        ({"skins": [{"joints": "0"}]}, r"not laid out as glTF 2\.0"),
        ({"animations": [{"channels": 3}]}, r"not laid out as glTF 2\.0"),
        ({"nodes": [{"translation": [0, 0]}, {}]}, r"nodes\[0\]\.translation: expected 3 finite numbers"),
    ],
)
def test_a_broken_field_is_named(tmp_path, given, message):
    path = arm(tmp_path, [0, 1], QUARTER)
    said = json.loads(path.read_text())
    if "buffers" in given:
        (tmp_path.parent / "outside.bin").write_bytes(b"0" * 64)
    path.write_text(json.dumps(said | given))
    with pytest.raises(MotionError, match=message):
        gltf.read(path, Request())


def test_keys_that_do_not_fit_and_truncated_files_are_refused(tmp_path):
    for values, times, message in (
        (QUARTER[:1], [0, 1], "rotation: expected 2 keys of 4 numbers"),
        (QUARTER * 3, [0, 1], "rotation: expected 2 keys of 4 numbers"),
        (QUARTER, [1, 1], "expected finite keys that rise in time"),
        ([[0, 0, 0, 0], [0, 0, 0, 1]], [0, 1], "expected unit quaternions x y z w"),
    ):
        with pytest.raises(MotionError, match=message):
            gltf.read(arm(tmp_path, times, values), Request())
    whole = arm(tmp_path, [0, 1], QUARTER, binary=True)
    for length in (40, len(whole.read_bytes()) - 8):
        (tmp_path / "cut.glb").write_bytes(whole.read_bytes()[:length])
        with pytest.raises(MotionError, match="truncated: a chunk"):
            read_motion(tmp_path / "cut.glb")
    (tmp_path / "no.gltf").write_text('{"asset": ')
    with pytest.raises(MotionError, match="not JSON"):
        read_motion(tmp_path / "no.gltf")


def test_whole_numbers_stand_for_shares(tmp_path):
    data = np.array([-32768, 0, 32767, 16384], "<i2").tobytes()
    uri = "data:;base64," + base64.b64encode(data).decode()
    said = {
        "asset": {"version": "2.0"},
        "accessors": [{"bufferView": 0, "componentType": 5122, "count": 1, "type": "VEC4", "normalized": True}],
        "bufferViews": [{"buffer": 0}],
        "buffers": [{"uri": uri}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(said))
    assert GltfFile.of(tmp_path / "a.gltf").numbers(0, "x")[0] == pytest.approx([-1, 0, 1, 16384 / 32767])


@pytest.mark.parametrize("interpolation", ["STEP", "LINEAR", "CUBICSPLINE"])
def test_a_channel_holds_its_ends(interpolation: str) -> None:
    values = np.array([[1.0, 0.0, 0.0], [2.0, 4.0, 0.0], [3.0, 5.0, 1.0]])
    keys = np.stack([0 * values + 7, values, 0 * values - 7], axis=1) if interpolation == "CUBICSPLINE" else values
    channel = gltf.Channel(np.array([0.5, 1.0, 2.0]), keys, interpolation)
    found = channel.at(np.array([-1.0, 0.5, 1.0, 2.0, 3.0, 100.0]), turns=False)
    np.testing.assert_allclose(found, values[[0, 0, 1, 2, 2, 2]], atol=1e-9)
    turns = Rotation.from_euler("z", [[10], [50], [90]], degrees=True).as_quat()
    if interpolation != "CUBICSPLINE":
        held = gltf.Channel(np.array([0.5, 1.0, 2.0]), turns, interpolation).at(np.array([0.0, 9.0]), turns=True)
        np.testing.assert_allclose(held, turns[[0, -1]], atol=1e-9)


def test_a_node_at_rest_by_its_matrix_is_that_of_its_three_properties(tmp_path):
    turn, place, size = Rotation.from_euler("xyz", [20, -50, 100], degrees=True), np.array([0.1, 0.7, -0.3]), 1.5
    matrix = np.block([[size * turn.as_matrix(), place[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
    plain = {"translation": place.tolist(), "rotation": turn.as_quat().tolist(), "scale": [size] * 3}
    found = [
        gltf.read(arm(tmp_path, [0, 1], QUARTER, nodes=[{"children": [1]}, lower]), Request()).positions
        for lower in (plain, {"matrix": matrix.T.ravel().tolist()})
    ]
    np.testing.assert_allclose(found[0], found[1], atol=1e-7)
    assert np.ptp(found[0], axis=0).max() > 0.5

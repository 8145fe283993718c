"""The format of a file follows from its content, under any name."""

import contextlib
import pickle
import shutil
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared_files import ROOT, SHARED, needs_shared

from robot_retarget.base.errors import MotionError, RobotRetargetError
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers.table import FORMATS, REFUSED, format_of

WAVE = ROOT / "samples" / "wave.bvh"
OTHER = SHARED / "motions" / "other"
SHARED_FILES = {
    "asfamc/02_01.amc": "ASF/AMC",
    "asfamc/02.asf": "ASF skeleton",
    "c3d/ezc3d_Qualisys.c3d": "C3D",
    "c3d/ezc3d_Optotrak.c3d": "C3D",
    "c3d/pyc3d_my-motion.c3d": "C3D",
    "deepmimic/humanoid3d_walk.txt": "DeepMimic",
    "gltf/three-vrm_test.vrma": "glTF, GLB, VRMA",
    "gltf/KayKit_Knight_CC0.glb": "glTF, GLB, VRMA",
    "npz/kimodo_soma30_01_single_text_prompt.npz": "joint positions",
}


def made(folder: Path) -> dict[Path, str]:
    """A file of every format that can be made here."""
    arrays = {
        "positions.npz": ({"positions": np.zeros((3, 22, 3))}, "joint positions"),
        "amass.npz": ({"poses": np.zeros((3, 156)), "trans": np.zeros((3, 3))}, "SMPL parameters"),
        "gvhmr.npz": ({"body_pose": np.zeros((3, 63)), "global_orient": np.zeros((3, 3))}, "SMPL parameters"),
    }
    files = {}
    for name, (content, title) in arrays.items():
        np.savez(folder / name, **content)
        files[folder / name] = title
    for name, shape, title in (
        ("positions.npy", (3, 22, 3), "joint positions"),
        ("features.npy", (3, 263), "HumanML3D features"),
        ("landmarks.npy", (3, 33, 3), "MediaPipe or FreeMoCap landmarks"),
    ):
        np.save(folder / name, np.zeros(shape))
        files[folder / name] = title
    with zipfile.ZipFile(folder / "clips.zip", "w") as archive:
        archive.write(WAVE, "clips/wave.bvh")
    (folder / "a.fbx").write_bytes(b"Kaydara FBX Binary  \0" + bytes(100))
    (folder / "a.pkl").write_bytes(pickle.dumps({"poses": np.zeros((3, 72))}))
    shutil.copy(WAVE, folder / "wave.bvh")
    named = {"clips.zip": "zip of motions", "a.fbx": "FBX", "a.pkl": "SMPL parameters in a pickle", "wave.bvh": "BVH"}
    return files | {folder / name: title for name, title in named.items()}


def test_each_format_is_told_under_any_name(tmp_path):
    for path, title in made(tmp_path).items():
        assert format_of(path).name == title
        other = path.with_name("renamed.dat")
        if title not in ("joint positions", "MediaPipe or FreeMoCap landmarks") or path.suffix == ".npy":
            shutil.copy(path, other)
            assert format_of(other).name == title


@needs_shared
@pytest.mark.parametrize("name", SHARED_FILES)
def test_files_of_the_wild_are_told_under_any_name(tmp_path, name):
    shutil.copy(OTHER / name, tmp_path / "renamed.dat")
    assert format_of(tmp_path / "renamed.dat").name == SHARED_FILES[name]
    assert sum(one.matches_format(header_of(tmp_path / "renamed.dat")) for one in (*FORMATS, *REFUSED)) == 1


def header_of(path: Path):
    from robot_retarget.human.capture import FileHeader

    return FileHeader(path)


def test_a_bvh_in_a_zip_is_the_bvh(tmp_path):
    with zipfile.ZipFile(tmp_path / "pack.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(WAVE, "clips/wave.bvh")
        archive.write(ROOT / "samples" / "walk.bvh", "clips/walk.bvh")
        archive.writestr("__MACOSX/clips/._wave.bvh", "rubbish")
    alone, packed = read_motion(WAVE), read_motion(f"{tmp_path / 'pack.zip'}#wave.bvh")
    assert np.array_equal(alone.positions, packed.positions)
    assert packed.source.endswith("pack.zip#clips/wave.bvh")
    first = read_motion(tmp_path / "pack.zip")
    assert first.source.endswith("#clips/walk.bvh") and any("The first of 2 motions" in note for note in first.notes)
    with pytest.raises(MotionError, match=r"holds no motion 'run'; known: walk\.bvh, wave\.bvh"):
        read_motion(f"{tmp_path / 'pack.zip'}#run")


def test_a_zip_that_grows_without_end_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.bvh", b"HIERARCHY\n" + b" " * 2**26)
    assert (tmp_path / "bomb.zip").stat().st_size < 100_000
    with pytest.raises(MotionError, match=r"bomb\.zip: unpacks to more than"):
        read_motion(tmp_path / "bomb.zip")


def test_an_array_that_grows_without_end_is_refused(tmp_path):
    np.savez_compressed(tmp_path / "bomb.npz", positions=np.zeros((10**5, 22, 3)))
    assert (tmp_path / "bomb.npz").stat().st_size < 100_000
    with pytest.raises(MotionError, match=r"bomb\.npz: .* takes more than \d+ bytes"):
        read_motion(tmp_path / "bomb.npz")


@settings(max_examples=40)
@given(st.data())
def test_no_damage_to_a_file_ends_in_anything_but_a_sentence(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("damaged")
    path = data.draw(st.sampled_from(sorted(made(folder))))
    content = bytearray(path.read_bytes()[:4000] if data.draw(st.booleans()) else path.read_bytes())
    for _ in range(data.draw(st.integers(0, 6))):
        content[data.draw(st.integers(0, min(len(content), 600) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with contextlib.suppress(RobotRetargetError), np.errstate(all="ignore"):
        read_motion(path)


def test_a_broken_zip_and_one_without_motions_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("readme.txt", "nothing")
    with pytest.raises(MotionError, match=r"holds no \.bvh"):
        read_motion(tmp_path / "a.zip")
    (tmp_path / "b.zip").write_bytes(b"PK\3\4" + bytes(50))
    with pytest.raises(MotionError, match="not a readable zip"):
        read_motion(tmp_path / "b.zip")


def test_an_array_that_would_fill_the_memory_is_refused_by_its_head(tmp_path):
    """9 MB that unpack to 600 MB: in less than a second, for nothing is unpacked."""
    shape = (150_000_000 // 66, 22, 3)
    path = tmp_path / "a.npz"
    head = {"descr": "<f4", "fortran_order": False, "shape": shape}
    packed = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
    with packed as archive, archive.open("positions.npy", "w") as member:
        np.lib.format.write_array_header_1_0(member, head)  # pyright: ignore[reportArgumentType]
        size = 4 * int(np.prod(shape))
        for start in range(0, size, 1 << 24):
            member.write(bytes(min(1 << 24, size - start)))
    began = time.process_time()
    with pytest.raises(MotionError, match=r"a\.npz: .*positions: an array .* takes more than \d+ bytes"):
        read_motion(path)
    assert time.process_time() - began < 1.0


def test_a_head_that_states_another_size_than_the_file_has_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((3, 22, 3)))
    data = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(data.replace(b"(3, 22, 3)", b"(3000000000, 22, 3)"[:10], 1)[:-8])
    with pytest.raises(MotionError, match=r"a\.npy"):
        read_motion(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        (
            "a.mot",
            b"Coordinates\nversion=1\nnRows=2\ninDegrees=yes\nendheader\ntime\n",
            "MOT and STO hold joint angles",
        ),
        ("a.vmd", b"Vocaloid Motion Data 0002" + bytes(80), "mmd_tools.*a.glb"),
        ("a.usda", b"#usda 1.0\n(\n)", "pip install bpy, and python -c .*usd_import.*a.glb"),
        ("a.usdc", b"PXR-USDC" + bytes(80), "pip install bpy, and python -c .*usd_import.*a.glb"),
    ],
)
@pytest.mark.parametrize("renamed", [False, True])
def test_known_formats_that_are_not_read_say_what_they_are_and_how_to_convert_them(
    name, content, sentence, renamed, tmp_path
):
    path = tmp_path / (f"{Path(name).stem}.dat" if renamed else name)
    path.write_bytes(content)
    with pytest.raises(MotionError, match=sentence):
        read_motion(path)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"rigid_body_pos": np.zeros((3, 24, 3)), "fps": 30}, "a motion of ProtoMotions"),
        ({"root_pos": np.zeros((3, 3)), "dof_pos": np.zeros((3, 9))}, "a motion of a robot.*robot-retarget import"),
        ({"clip": {"root_trans_offset": np.zeros((3, 3)), "dof": np.zeros((3, 9))}}, "a motion of a robot"),
    ],
)
def test_pickles_of_other_things_say_what_they_are(content, sentence, tmp_path):
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content))
    with pytest.raises(MotionError, match=sentence):
        read_motion(tmp_path / "a.pkl")


@pytest.mark.parametrize("name", ["a.pt", "a.pkl", "a.pth"])
def test_a_zip_that_is_called_a_pickle_is_refused_with_what_it_holds(name, tmp_path):
    with zipfile.ZipFile(tmp_path / name, "w") as archive:
        archive.writestr("readme.txt", "nothing")
    with pytest.raises(MotionError, match=r"a zip without a pickle of PyTorch; it holds readme\.txt"):
        read_motion(tmp_path / name)


def test_what_is_not_read_is_refused_with_the_line_that_converts_it(tmp_path):
    (tmp_path / "a.fbx").write_bytes(b"Kaydara FBX Binary  \0")
    with pytest.raises(MotionError, match=r"pip install bpy, and python -c .*import_scene\.fbx.*export_scene\.gltf"):
        read_motion(tmp_path / "a.fbx")

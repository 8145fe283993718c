"""Motion files of every kind at the command line: files that are read, files that are refused, and exit codes."""

import numpy as np
import pytest
from forked import run
from shared_files import SHARED, needs_shared

OTHER = SHARED / "motions" / "other"


@needs_shared
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("c3d/pyc3d_my-motion.c3d", "Missing: left front of the pelvis"),
        ("gltf/KayKit_Knight_CC0.glb#Walking_A", "not a human body: arms measure 1.33 of the legs"),
        ("deepmimic/character_humanoid3d.txt", "expected the `Frames` of a DeepMimic motion, found Skeleton"),
        ("asfamc/02.asf", "a skeleton without a motion: give the .amc"),
    ],
)
def test_what_cannot_be_retargeted_is_refused_with_its_reason(tmp_path, name, reason):
    done = run("solve", OTHER / name, "--robot", "op3", "-o", tmp_path / "out.npz")
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert reason in " ".join(done.stderr.split())
    assert not list(tmp_path.iterdir())


def test_the_mistake_in_a_file_is_named_by_its_line(tmp_path):
    (tmp_path / "s.asf").write_text(":root\norder TX RX\n:bonedata\nbegin\nname a\nlength one\n")
    (tmp_path / "s_1.amc").write_text(":FULLY-SPECIFIED\n1\nroot 0 0\n")
    done = run("info", tmp_path / "s_1.amc")
    assert done.returncode == 2 and "s.asf:6: length: expected 1 finite numbers, found one" in " ".join(
        done.stderr.split()
    )


def test_smpl_parameters_take_a_body_model_and_a_frame_rate(tmp_path):
    np.savez(tmp_path / "clip.npz", poses=np.zeros((4, 72)), trans=np.zeros((4, 3)))
    np.savez(tmp_path / "SMPL.npz", v_template=np.zeros((3, 3)))
    done = run("info", tmp_path / "clip.npz", "--source-fps", "25")
    assert done.returncode == 0 and "4 frames at 25 fps" in done.stdout
    done = run("info", tmp_path / "clip.npz", "--body-model", tmp_path / "SMPL.npz")
    assert done.returncode == 2 and "needs the array 'J_regressor'" in " ".join(done.stderr.split())

"""Versions of MuJoCo that give wrong results are refused with the reason; those that were tried are not."""

import copy
import runpy

import mujoco
import numpy as np
import pytest
from shared_files import ROOT

from robot_retarget.base.errors import RobotError
from robot_retarget.base.files import MODELS
from robot_retarget.base.mujoco_setup import check, require_mujoco


@pytest.mark.parametrize("version", ["3.12.0", "3.17.0", "4.0.0", "4.0.1", "4.1.0rc1", "10.0"])
def test_versions_that_were_tried_and_newer_ones_are_taken(version: str) -> None:
    check(version)
    require_mujoco()


@pytest.mark.parametrize(
    ("version", "reason"),
    [("3.11.0", "finds no distance"), ("3.3.7", "older than 3.12"), ("2.3.7", "older")],
)
def test_wrong_and_old_versions_are_refused_with_the_reason_and_the_command(version: str, reason: str) -> None:
    with pytest.raises(
        RobotError, match=rf"MuJoCo {version} cannot be used: .*{reason}.*pip install 'mujoco>=3.12,<5'"
    ):
        check(version)


@pytest.mark.parametrize("cone", [mujoco.mjtCone.mjCONE_PYRAMIDAL, mujoco.mjtCone.mjCONE_ELLIPTIC])
def test_constraints_of_a_robot_with_a_sparse_hessian_are_solved_as_with_a_dense_one(cone: int) -> None:
    """Three robots thrown on one floor: 78 coordinates, which MuJoCo treats as sparse by itself from 60 on."""
    spec = mujoco.MjSpec.from_file(str(MODELS / "op3" / "scene.xml"))
    for k in (1, 2):
        frame = spec.worldbody.add_frame(pos=[k, 0, 0])
        spec.attach(mujoco.MjSpec.from_file(str(MODELS / "op3" / "op3.xml")), prefix=f"{k} ", frame=frame)
    model = spec.compile()
    model.opt.cone = cone
    dense = copy.copy(model)
    dense.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    assert mujoco.mj_isSparse(model) and not mujoco.mj_isSparse(dense)
    data, apart, contacts = mujoco.MjData(model), 0.0, 0
    rng = np.random.default_rng(0)
    data.qvel[:] = 2 * rng.standard_normal(model.nv)
    for _ in range(60):
        mujoco.mj_step(model, data, 10)
        found = []
        for form in (model, dense):
            state = mujoco.MjData(form)
            state.qpos[:], state.qvel[:] = data.qpos, data.qvel
            mujoco.mj_forward(form, state)
            found.append(state.qacc)
        contacts = max(contacts, data.ncon)
        apart = max(apart, np.abs(found[0] - found[1]).max() / np.abs(found[1]).max())
    assert contacts > 10 and apart < 1e-9


def test_the_script_that_tries_versions_names_tests_that_exist() -> None:
    tests = runpy.run_path(str(ROOT / "scripts/tools/mujoco_versions.py"))["TESTS"]
    assert [test for test in tests if not (ROOT / test).exists()] == []

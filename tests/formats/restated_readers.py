"""The loaders of other programs, restated from their documents: a file → root, joints by name, nothing of this package.

Each takes a path, the model's hinge names depth first, and where the format has another order, the model.
"""

import json
import pickle
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pandas


@dataclass
class Pose:
    """What a reader makes of a file."""

    position: np.ndarray
    wxyz: np.ndarray
    joints: dict[str, np.ndarray]
    fps: float
    bodies: dict[str, np.ndarray] | None = None


def hinge_names(model: mujoco.MjModel) -> list[str]:
    return [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]


def named(names, angles) -> dict[str, np.ndarray]:
    return dict(zip(names, np.asarray(angles).T, strict=True))


def beside(path: Path) -> list[str]:
    return json.loads(path.with_name(path.name + ".json").read_text())["joint_names"]


def csv(path, model) -> Pose:
    table = pandas.read_csv(path)
    root = table[[f"root_{c}" for c in ("x [m]", "y [m]", "z [m]", "qw [-]", "qx [-]", "qy [-]", "qz [-]")]].to_numpy()
    joints = {c.removesuffix(" [rad]"): table[c].to_numpy() for c in table.columns if c.endswith(" [rad]")}
    return Pose(root[:, :3], root[:, 3:], joints, 1 / float(np.median(np.diff(table["time [s]"].to_numpy()))))


def _rows(path, wxyz) -> Pose:
    rows = np.loadtxt(path, delimiter=",")
    return Pose(rows[:, :3], rows[:, 3:7][:, wxyz], named(beside(path), rows[:, 7:]), 30)


def unitree(path, model) -> Pose:
    """mjlab's csv_to_npz: motion[:, 3:7][:, [3, 0, 1, 2]] is w x y z, motion[:, 7:] the joints."""
    return _rows(path, [3, 0, 1, 2])


def kimodo(path, model) -> Pose:
    return _rows(path, [0, 1, 2, 3])


def gmr(path, model) -> Pose:
    """GMR's data_loader: pickle.load, root_rot[:, [3, 0, 1, 2]]; unpickled by the interpreter's own pickle."""
    data = pickle.loads(path.read_bytes())
    bodies = dict(zip(data["link_body_list"], np.moveaxis(np.asarray(data["local_body_pos"]), 1, 0), strict=True))
    return Pose(
        data["root_pos"],
        data["root_rot"][:, [3, 0, 1, 2]],
        named(hinge_names(model), data["dof_pos"]),
        data["fps"],
        bodies,
    )


def level_order(model) -> list[str]:
    """Body names breadth first, as PhysX has the links of an articulation."""
    queue, order = [1], []
    while queue:
        body = queue.pop(0)
        order.append(model.body(body).name)
        queue += [b for b in range(2, model.nbody) if model.body_parentid[b] == body]
    return order


def _tracking(path, bodies, joints) -> Pose:
    data = np.load(path)
    places = dict(zip(bodies, np.moveaxis(data["body_pos_w"], 1, 0), strict=True))
    return Pose(
        data["body_pos_w"][:, 0],
        data["body_quat_w"][:, 0],
        named(joints, data["joint_pos"]),
        float(data["fps"][0]),
        places,
    )


def beyondmimic(path, model) -> Pose:
    bodies = level_order(model)
    joints = [model.joint(model.body_jntadr[model.body(name).id] + k).name
              for name in bodies[1:] for k in range(model.body_jntnum[model.body(name).id])]  # fmt: skip
    return _tracking(path, bodies, joints)


def mjlab(path, model) -> Pose:
    return _tracking(path, [model.body(b).name for b in range(1, model.nbody)], hinge_names(model))


def omniretarget(path, model) -> Pose:
    """holosoma's MotionLoader without use_omniretarget_data: motion[:, :3], motion[:, 3:7], motion[:, 7:]."""
    data = np.load(path)
    qpos = data["qpos"]
    return Pose(qpos[:, :3], qpos[:, 3:7], named(hinge_names(model), qpos[:, 7:]), float(data["fps"]))


def omniretarget_training(path, model) -> Pose:
    data = np.load(path)
    rows, places = data["joint_pos"], dict(zip(data["body_names"], np.moveaxis(data["body_pos_w"], 1, 0), strict=True))
    return Pose(rows[:, :3], rows[:, 3:7], named(data["joint_names"], rows[:, 7:]), float(data["fps"][0]), places)


LOCO_KEYS = {
    "joint_names", "frequency", "body_names", "site_names", "metadata", "njnt", "jnt_type", "nbody", "body_rootid",
    "body_weldid", "body_mocapid", "body_pos", "body_quat", "body_ipos", "body_iquat", "nsite", "site_bodyid", "site_pos",
    "site_quat", "qpos", "qvel", "xpos", "xquat", "cvel", "subtree_com", "site_xpos", "site_xmat", "split_points",
}  # fmt: skip


def locomujoco(path, model) -> Pose:
    """Trajectory.load: any other key is a ValueError; joints by name in the order of joint_names, a free one takes seven."""
    data = np.load(path, allow_pickle=True)
    assert set(data.files) <= LOCO_KEYS
    place, at = {}, 0
    for name, kind in zip(data["joint_names"].tolist(), data["jnt_type"], strict=True):
        width = 7 if kind == mujoco.mjtJoint.mjJNT_FREE else 1
        place[name] = data["qpos"][:, at : at + width]
        at += width
    root = next(values for values in place.values() if values.shape[1] == 7)
    bodies = dict(zip(data["body_names"].tolist(), np.moveaxis(data["xpos"], 1, 0), strict=True))
    joints = {name: values[:, 0] for name, values in place.items() if values.shape[1] == 1}
    return Pose(root[:, :3], root[:, 3:], joints, float(data["frequency"]), bodies)


READERS = {
    "csv": csv,
    "unitree": unitree,
    "kimodo": kimodo,
    "protomotions-csv": kimodo,
    "gmr": gmr,
    "beyondmimic": beyondmimic,
    "mjlab": mjlab,
    "omniretarget": omniretarget,
    "omniretarget-training": omniretarget_training,
    "locomujoco": locomujoco,
}

"""The loaders of other programs, restated from their documents: a file → root, joints by name, nothing of this package.

Each takes a path, the model's hinge names depth first, and where the format has another order, the model.
"""

import json
import pickle
import zipfile
from dataclasses import dataclass
from pathlib import Path

import joblib
import mujoco
import numpy as np
import pandas
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


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
    """holosoma 0.1.0's MotionLoader without use_omniretarget_data, with its default of 30 input frames per second.

    `fps` of the file is the time between frames there: round(1 / fps) of a file that stores 30 is 0, and 1 / 0 raises.
    """
    data = np.load(path)
    input_fps = round(1 / data.get("fps", 1 / 30))
    duration = (len(data["qpos"]) - 1) * (1.0 / input_fps)
    qpos = data["qpos"]
    fps = (len(qpos) - 1) / duration
    return Pose(qpos[:, :3], qpos[:, 3:7], named(hinge_names(model), qpos[:, 7:]), fps)


def viser_player(path) -> float:
    """holosoma's viser_player.py: whole frames per second, 30 where the key is absent."""
    data = np.load(path)
    return int(data["fps"]) if "fps" in data else 30


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


def pyroki(path, model) -> Pose:
    """ProtoMotions' converter: base_frame_pos, base_frame_wxyz, joint_angles in the order of the MJCF's joints."""
    data = np.load(path)
    joints = named(hinge_names(model), data["joint_angles"])
    return Pose(data["base_frame_pos"], data["base_frame_wxyz"], joints, float(data["fps"]))


def mimickit(path, model) -> Pose:
    """Motion.load: frames are root position, exponential map, joints."""
    data = pickle.loads(path.read_bytes())
    frames = np.array(data["frames"])
    angle = np.linalg.norm(frames[:, 3:6], axis=1, keepdims=True)
    wxyz = np.hstack([np.cos(angle / 2), np.sin(angle / 2) * frames[:, 3:6] / angle])
    assert data["loop_mode"] in (0, 1)
    return Pose(frames[:, :3], wxyz, named(hinge_names(model), frames[:, 6:]), data["fps"])


def phc(path, model) -> Pose:
    """joblib.load, one clip; joints from pose_aa by the axes of the MJCF, as their forward kinematics takes them."""
    (clip,) = joblib.load(path).values()
    names = hinge_names(model)
    axes = np.array([model.joint(name).axis for name in names])
    angles = np.einsum("tni,ni->tn", clip["pose_aa"][:, 1 : 1 + len(names)], axes)
    np.testing.assert_allclose(angles, clip["dof"], atol=1e-5)
    assert not clip["pose_aa"][:, 1 + len(names) :].any() and clip["pose_aa"].shape[1] == len(names) + 4
    joints = named(names, clip["dof"])
    return Pose(clip["root_trans_offset"], clip["root_rot"][:, [3, 0, 1, 2]], joints, clip["fps"])


def keyframe_kit(path, model) -> Pose:
    """The editor's _load_data: joblib.load, qpos as wide as the model, keyframes with motor_pos and qpos."""
    data = joblib.load(path)
    assert data["qpos"].shape[1] == model.nq
    assert all(len(k["motor_pos"]) == model.nu and len(k["qpos"]) == model.nq for k in data["keyframes"])
    names = {k["name"] for k in data["keyframes"]}
    assert [name for name, _ in data["timed_sequence"]] and {name for name, _ in data["timed_sequence"]} <= names
    qpos, bodies = data["qpos"], np.moveaxis(data["body_pos"], 1, 0)
    places = {model.body(b).name: places for b, places in enumerate(bodies)}
    fps = 1 / float(np.median(np.diff(data["time"])))
    return Pose(qpos[:, :3], qpos[:, 3:7], named(hinge_names(model), qpos[:, 7:]), fps, places)


def core(path, model) -> Pose:
    """CoRe's documents: no object arrays; qpos by qpos_layout, joint_names; unit quaternions; even timestamps."""
    data = np.load(path, allow_pickle=False)
    assert data["format"] == "core-robot-motion-v1" and int(data["schema_version"]) == 1
    assert data["qpos_layout"] == "root_xyz_quat_wxyz_then_model_joint_qpos"
    np.testing.assert_allclose(np.diff(data["timestamps_s"]), 1 / data["fps"], rtol=1e-7)
    assert not data["contact_labels"][:, ~data["contact_availability"]].any()
    qpos = data["qpos"]
    return Pose(qpos[:, :3], qpos[:, 3:7], named(data["joint_names"], qpos[:, 7:]), float(data["fps"]))


def soma(path, model) -> Pose:
    """BONES-SEED's loader: centimetres, degrees, R = Rz Ry Rx, columns NAME_dof."""
    table = pandas.read_csv(path)
    place = table[[f"root_translate{a}" for a in "XYZ"]].to_numpy() / 100
    x, y, z = np.radians(table[[f"root_rotate{a}" for a in "XYZ"]].to_numpy()).T / 2
    wxyz = product(half(z, 2), product(half(y, 1), half(x, 0)))
    joints = {c.removesuffix("_dof"): np.radians(table[c].to_numpy()) for c in table.columns if c.endswith("_dof")}
    return Pose(place, wxyz, joints, 120)


def half(angles: np.ndarray, axis: int) -> np.ndarray:
    quaternion = np.zeros((len(angles), 4))
    quaternion[:, 0], quaternion[:, 1 + axis] = np.cos(angles), np.sin(angles)
    return quaternion


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    out = np.empty_like(a)
    for row, left, right in zip(out, a, b, strict=True):
        mujoco.mju_mulQuat(row, left, right)
    return out


def keyframes(path, model) -> Pose:
    """MuJoCo's own compiler: a spec of the file's keys, attached by including it in a model of as many coordinates."""
    geom, joints = '<geom size="1" mass="1"/>', model.nq - 7
    chain = f"<body><joint/>{geom}" * joints + "</body>" * joints
    holder = path.with_name("holder.xml")
    holder.write_text(
        f'<mujoco><include file="{path.name}"/><worldbody><body><freejoint/>{geom}{chain}</body></worldbody></mujoco>'
    )
    return _keys(mujoco.MjModel.from_xml_path(str(holder)), model)


def scene(path, model) -> Pose:
    """MuJoCo loads the folder's scene, of the same bodies."""
    loaded = mujoco.MjModel.from_xml_path(str(path / "scene.xml"))
    assert [loaded.body(b).name for b in range(loaded.nbody)] == [model.body(b).name for b in range(model.nbody)]
    return _keys(loaded, model)


def _keys(loaded, model) -> Pose:
    frames = [key for key in range(loaded.nkey) if loaded.key(key).name.startswith("frame_")]
    qpos = loaded.key_qpos[frames]
    fps = 1 / float(np.median(np.diff(loaded.key_time[frames])))
    return Pose(qpos[:, :3], qpos[:, 3:7], named(hinge_names(model), qpos[:, 7:]), fps)


def joint_trajectory(path, model) -> Pose:
    """Plain YAML, as rosidl's message from it; the root is not in it."""
    message = yaml.safe_load(path.read_text())
    stamps = [p["time_from_start"]["sec"] + p["time_from_start"]["nanosec"] / 1e9 for p in message["points"]]
    joints = named(message["joint_names"], [p["positions"] for p in message["points"]])
    return Pose(np.empty((0, 3)), np.empty((0, 4)), joints, 1 / float(np.median(np.diff(stamps))))


def limb_trajectories(path, model) -> Pose:
    """A message per limb, as a controller per limb takes it."""
    poses = [joint_trajectory(file, model) for file in sorted(path.glob("*.yaml"))]
    joints = {name: angles for pose in poses for name, angles in pose.joints.items()}
    assert len(joints) == sum(len(pose.joints) for pose in poses), "no joint has two controllers"
    return Pose(poses[0].position, poses[0].wxyz, joints, poses[0].fps)


def bag(path, model) -> Pose:
    """The mcap library's reader; bodies by chaining the transforms of /tf, as tf2 does."""
    states, trees = [], []
    with path.open("rb") as stream:
        for _, channel, message, content in make_reader(
            stream, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            (states if channel.topic == "/joint_states" else trees).append((message.log_time, content))
    names, world = states[0][1].name, []
    for _, tree in trees:
        world.append(chained(tree.transforms))
    root = model.body(1).name
    joints = named(names, [state.position for _, state in states])
    places = {body: np.array([frames[body][0] for frames in world]) for body in world[0]}
    position, wxyz = (np.array([frames[root][k] for frames in world]) for k in (0, 1))
    return Pose(position, wxyz, joints, 1e9 / float(np.median(np.diff([t for t, _ in states]))), places)


def chained(transforms) -> dict:
    """Every frame in the world: (position, w x y z)."""
    found = {"world": (np.zeros(3), np.array([1.0, 0, 0, 0]))}
    for t in transforms:
        place, turn = found[t.header.frame_id]
        move, spin = t.transform.translation, t.transform.rotation
        carried, turned = np.empty(3), np.empty(4)
        mujoco.mju_rotVecQuat(carried, np.array([move.x, move.y, move.z]), turn)
        mujoco.mju_mulQuat(turned, turn, np.array([spin.w, spin.x, spin.y, spin.z]))
        found[t.child_frame_id] = (place + carried, turned)
    return {name: pose for name, pose in found.items() if name != "world"}


def bvh(path, model) -> Pose:
    """A BVH player of a dozen lines: offsets and channels down the tree, y up and centimetres."""
    lines = [line.split() for line in path.read_text().splitlines() if line.strip()]
    start = next(k for k, words in enumerate(lines) if words[0] == "MOTION")
    joints, stack = [], []
    for words in lines[1:start]:
        if words[0] in ("ROOT", "JOINT", "End"):
            joints.append([words[1], stack[-1] if stack else None, None, []])
            stack.append(len(joints) - 1)
        elif words[0] == "OFFSET":
            joints[stack[-1]][2] = np.array(words[1:], float)
        elif words[0] == "CHANNELS":
            joints[stack[-1]][3] = words[2:]
        elif words[0] == "}":
            stack.pop()
    rows = np.array(lines[start + 3 :], float)
    places: dict[str, list] = {name: [] for name, *_ in joints if name != "Site"}
    for row in rows:
        world, at = [], 0
        for name, parent, offset, channels in joints:
            move, turn = offset.copy(), np.eye(3)
            for channel in channels:
                axis = "XYZ".index(channel[0])
                if channel.endswith("position"):
                    move[axis] = row[at]
                else:
                    c, s = np.cos(np.radians(row[at])), np.sin(np.radians(row[at]))
                    spin = np.eye(3)
                    k, m = (axis + 1) % 3, (axis + 2) % 3
                    spin[k, k], spin[m, m], spin[m, k], spin[k, m] = c, c, s, -s
                    turn = turn @ spin
                at += 1
            above = world[parent] if parent is not None else (np.zeros(3), np.eye(3))
            world.append((above[0] + above[1] @ move, above[1] @ turn))
            if name in places:
                places[name].append(world[-1][0][[2, 0, 1]] / 100)
    fps = 1 / float(lines[start + 2][2])
    return Pose(np.empty((0, 3)), np.empty((0, 4)), {}, fps, {name: np.array(p) for name, p in places.items()})


def isaaclab_amp(path, model) -> Pose:
    """Isaac Lab's MotionLoader: joints and bodies by the names in the file, quaternions w x y z."""
    data = np.load(path)
    bodies = dict(zip(data["body_names"].tolist(), data["body_positions"].swapaxes(0, 1), strict=True))
    root = data["body_positions"][:, 0], data["body_rotations"][:, 0]
    return Pose(*root, named(data["dof_names"].tolist(), data["dof_positions"]), 1 / (1 / float(data["fps"])), bodies)


def sonic(path, model) -> Pose:
    """SONIC's MotionDataReader: the first row of a table is a header, rows are steps of 0.02 s, joints in Isaac Lab's order."""
    tables = {
        name: pandas.read_csv(path / f"{name}.csv").to_numpy()
        for name in ("joint_pos", "joint_vel", "body_pos", "body_quat")
    }
    text = (path / "metadata.txt").read_text().splitlines()
    indices = [int(k) for k in text[text.index("Body part indexes:") + 1].strip("[]").split()]
    order = level_order(model)
    places = tables["body_pos"].reshape(len(tables["body_pos"]), -1, 3)
    bodies = {order[index]: places[:, k] for k, index in enumerate(indices)}
    hinges = [model.joint(j).name for body in order for j in range(model.njnt)
              if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE and model.body(model.jnt_bodyid[j]).name == body]  # fmt: skip
    assert tables["joint_vel"].shape == tables["joint_pos"].shape
    return Pose(places[:, 0], tables["body_quat"][:, :4], named(hinges, tables["joint_pos"]), 50.0, bodies)


class TorchFile(pickle.Unpickler):
    """Tensors of a `.pt` as PyTorch lays them out: a storage in a file of its own, and a shape."""

    def __init__(self, archive: zipfile.ZipFile):
        super().__init__(archive.open("archive/data.pkl"))
        self.archive = archive

    def find_class(self, module, name):
        makers = {"_rebuild_tensor_v2": lambda storage, offset, shape, *_: storage.reshape(shape), "OrderedDict": dict}
        return makers.get(name) or {"FloatStorage": "<f4", "BoolStorage": "?"}[name]

    def persistent_load(self, pid):
        return np.frombuffer(self.archive.read(f"archive/data/{pid[2]}"), pid[1])


def protomotions(path, model) -> Pose:
    """MotionLib: tensors by their names, root and bodies in the world, quaternions x y z w; a zip of storages and a pickle."""
    with zipfile.ZipFile(path) as archive:
        data = TorchFile(archive).load()
    names = [model.body(body).name for body in range(1, model.nbody)]
    bodies = dict(zip(names, data["rigid_body_pos"].astype(float).swapaxes(0, 1), strict=True))
    hinges = [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    turns = data["rigid_body_rot"][:, 0][:, [3, 0, 1, 2]].astype(float)
    return Pose(data["rigid_body_pos"][:, 0].astype(float), turns, named(hinges, data["dof_pos"]), data["fps"], bodies)


def lerobot(path, model) -> Pose:
    """LeRobotDataset: rows of every Parquet file under data/, meanings of columns from meta/info.json."""
    rows = pandas.concat(pandas.read_parquet(file) for file in sorted((path / "data").glob("*/*.parquet")))
    info = json.loads((path / "meta/info.json").read_text())
    columns = {name: np.stack(rows[name].to_list()) for name in ("observation.state", "observation.root")}
    joints = [name.removesuffix(".pos") for name in info["features"]["observation.state"]["names"]]
    root = columns["observation.root"].astype(float)
    return Pose(root[:, :3], root[:, 3:], named(joints, columns["observation.state"]), info["fps"])


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
    "protomotions-pyroki": pyroki,
    "mimickit": mimickit,
    "phc": phc,
    "keyframe-kit": keyframe_kit,
    "core": core,
    "soma": soma,
    "mujoco-keyframes": keyframes,
    "mujoco-scene": scene,
    "ros-joint-trajectory": joint_trajectory,
    "ros-limb-trajectories": limb_trajectories,
    "mcap": bag,
    "bvh": bvh,
    "isaaclab-amp": isaaclab_amp,
    "sonic": sonic,
    "lerobot": lerobot,
    "protomotions": protomotions,
}

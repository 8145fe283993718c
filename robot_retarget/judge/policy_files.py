"""Read policies: ONNX files with a contract, Berkeley Humanoid Lite's YAML, and NumPy layers.

The contract of `FILE.onnx` is `FILE.toml` or `FILE.yaml`, or the metadata that mjlab (BeyondMimic) and holosoma's walkers write.
TWIST2's trackers have no metadata; the sizes of their input and output identify them.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.base.untrusted.arrays import load_npz
from robot_retarget.base.untrusted.documents import read_text, read_toml
from robot_retarget.base.untrusted.limits import one_line
from robot_retarget.judge.policy import Contract, Policy, Term


def read_policy(path: str | Path) -> Policy:
    """Read a policy and its contract: an ONNX file, or the NumPy layers of an OP3 walker (`.npz`).

    Raises:
        UsageError: onnxruntime is not installed, the file is no policy, or nothing states its contract.
    """
    path = Path(path)
    if not path.is_file():
        raise UsageError(f"{path}: no such file")
    if path.suffix == ".npz":
        return _layers(path)
    try:
        import onnxruntime  # pyright: ignore[reportMissingImports]  (the extra `policy`)
    except ImportError:
        raise UsageError("--policy needs onnxruntime: pip install onnxruntime") from None
    try:
        session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors share no other base
        raise UsageError(f"{path} is no ONNX policy: {str(error).splitlines()[0]}") from error
    first, *others = session.get_inputs()
    if others:
        raise UsageError(f"{path}: a policy takes one observation, this one also {', '.join(i.name for i in others)}")
    out, width = session.get_outputs()[0].name, first.shape[-1]
    sizes = width, session.get_outputs()[0].shape[-1]
    contract = _contract(path, session.get_modelmeta().custom_metadata_map, sizes)

    def act(observation: Floats) -> Floats:
        action = session.run([out], {first.name: observation[None].astype(np.float32)})[0]
        return np.asarray(action, dtype=float).ravel()

    return Policy(contract, act, width if isinstance(width, int) else None, path.name)


def _contract(path: Path, metadata: Mapping[str, str], sizes: tuple[Any, Any]) -> Contract:
    """Return the contract of an ONNX file, from its sidecar file, its metadata, or TWIST2's sizes."""
    toml, yaml = path.with_suffix(".toml"), path.with_suffix(".yaml")
    try:
        if toml.exists():
            return contract_of(read_toml(toml, UsageError))
        if yaml.exists():
            return from_yaml(_read_yaml(yaml))
        if {"joint_names", "dof_names"} & metadata.keys():
            return from_metadata(metadata)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise UsageError(f"{path}: its contract lacks or breaks {error}") from error
    if sizes == TWIST2_SIZES:
        return twist2()
    raise UsageError(f"{path}: no metadata of mjlab or holosoma, and no contract {toml}")


def _read_yaml(path: Path) -> Mapping[str, Any]:
    try:
        import yaml
    except ImportError:
        raise UsageError(f"{path} needs pyyaml: pip install pyyaml") from None
    try:
        return yaml.safe_load(read_text(path, UsageError))
    except yaml.YAMLError as error:
        raise UsageError(f"{path}: not YAML: {one_line(str(error))}") from error


def _layers(path: Path) -> Policy:
    """Return a walker of humanoid-companion: swish layers over a normalised observation, and the tangent of half the output."""
    arrays = load_npz(path)
    try:
        count, history = int(arrays["n_layers"]), int(arrays["obs_history"])
        layers = [(arrays[f"w{k}"], arrays[f"b{k}"]) for k in range(count)]
        joints = tuple(str(name).removesuffix("_act") for name in arrays["actuator_names"])
        terms = "gyro", "up", "command_velocity", "command_turn", "joints", "actions_before"
        contract = Contract(
            1 / float(arrays["ctrl_dt"]), joints, arrays["default_pose"], arrays["action_scale"], np.array(PLAYGROUND),
            np.array(0.0), tuple(map(Term, terms)), earlier=history - 1, newest_first=True,
        )  # fmt: skip
        mean, deviation = arrays["obs_mean"], arrays["obs_std"]
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{path}: no layers of a policy: {error}") from error

    def act(observation: Floats) -> Floats:
        x = (observation - mean) / deviation
        for weights, bias in layers[:-1]:
            x = x @ weights + bias
            x = x / (1 + np.exp(-x))
        return np.tanh((x @ layers[-1][0] + layers[-1][1])[: len(joints)])

    return Policy(contract, act, len(mean), path.name)


PLAYGROUND = 21.1
"""Stiffness of the servos in MuJoCo Playground's OP3; their damping is that of the model's joints [N m/rad]."""


def contract_of(table: Mapping[str, Any]) -> Contract:
    """Return the contract in a TOML table; `observation` lists names, or tables of `name`, `scale` and `history`."""
    given = {name: tuple(map(_term, table[name])) for name in ("observation", "after") if name in table}
    return Contract(**{**table, "joints": tuple(table["joints"]), **given})


def _term(given: str | dict[str, Any]) -> Term:
    if isinstance(given, str):
        return Term(given)
    scale = given.get("scale", 1.0)
    return Term(**{**given, "scale": tuple(scale) if isinstance(scale, list) else scale})


def from_yaml(table: Mapping[str, Any]) -> Contract:
    """Return the contract in a configuration of Berkeley Humanoid Lite."""
    if table["history_length"]:
        raise UsageError("policy: Berkeley Humanoid Lite's configurations are known without history: write a contract")
    moved = table["action_indices"]
    default, stiffness, damping = (
        np.array([table[name][k] for k in moved], dtype=float)
        for name in ("default_joint_positions", "joint_kp", "joint_kd")
    )
    terms = "command_velocity", "command_turn", "gyro", "gravity", "joints", "speeds", "actions"
    return Contract(
        1 / table["policy_dt"], tuple(table["joints"][k] for k in moved), default, np.array(table["action_scale"]), stiffness,
        damping, tuple(map(Term, terms)), clip=table["action_limit_upper"],
    )  # fmt: skip


def twist2() -> Contract:
    """Return the contract of TWIST2's trackers of the G1, as its `deploy_real/server_low_level_g1_sim.py` at d5c7108e runs them."""
    sides = [f"{side}_{part}" for limb in TWIST2[:2] for side in ("left", "right") for part in limb]
    joints = [*sides[:12], *TWIST2[2], *sides[12:]]
    values = {part: row for limb in TWIST2 for part, row in limb.items()}
    rows = np.array([values[name.removeprefix("left_").removeprefix("right_")] for name in joints])
    default = rows[:, 0] * [-1 if name == "right_shoulder_roll" else 1 for name in joints]
    seen = tuple(0.0 if "ankle" in name else 0.05 for name in joints)
    reference = Term("reference_motion"), Term("reference_joints")
    own = Term("gyro", 0.25), Term("lean"), Term("joints"), Term("speeds", seen), Term("actions")
    return Contract(
        50.0, tuple(f"{name}_joint" for name in joints), default, np.array(0.5), rows[:, 1], rows[:, 2], (*reference, *own), earlier=10, after=reference,
        clip=10.0,
    )  # fmt: skip


def from_metadata(metadata: Mapping[str, str]) -> Contract:
    """Return the contract in the metadata of mjlab's policies, or of holosoma's walkers on the G1 and the T1."""
    if "joint_names" in metadata:
        default, scale, stiffness, damping = (
            np.array([float(word) for word in metadata[key].split(",")])
            for key in ("default_joint_pos", "action_scale", "joint_stiffness", "joint_damping")
        )
        names = metadata["observation_names"].split(",")
        terms = tuple(Term(part) for name in names for part in MJLAB.get(name, (name,)))
        return Contract(50.0, tuple(metadata["joint_names"].split(",")), default, scale, stiffness, damping, terms)
    joints = tuple(json.loads(metadata["dof_names"]))
    stand, gyro, speeds = next((row for joint, row in HOLOSOMA.items() if joint in joints), ({}, 1.0, 1.0))
    if not stand:
        raise UsageError(f"policy: it has no joint of a known walker ({', '.join(HOLOSOMA)}): write a contract")
    terms = (
        Term("actions"), Term("gyro", gyro), Term("command_turn"), Term("command_velocity"), Term("cos_phase"),
        Term("joints"), Term("speeds", speeds), Term("gravity"), Term("sin_phase"),
    )  # fmt: skip
    default = np.array([next((angle for end, angle in stand.items() if joint.endswith(end)), 0.0) for joint in joints])
    stiffness, damping = (np.array(json.loads(metadata[key])) for key in ("kp", "kd"))
    return Contract(50.0, joints, default, np.array(0.25), stiffness, damping, terms)


MJLAB = {
    "command": ("reference_joints", "reference_speeds"),
    "motion_anchor_pos_b": ("reference_place",),
    "motion_anchor_ori_b": ("reference_turn",),
    "joint_pos": ("joints",),
    "joint_vel": ("speeds",),
    "base_ang_vel": ("gyro",),
    "base_lin_vel": ("velocity",),
    "projected_gravity": ("gravity",),
}
"""Terms of mjlab's tracking task by the names in its metadata; `actions` is one of ours."""
HOLOSOMA: dict[str, tuple[dict[str, float], float, float]] = {
    "left_hip_pitch_joint": (
        {
            "hip_pitch_joint": -0.312, "knee_joint": 0.669, "ankle_pitch_joint": -0.363, "elbow_joint": 0.6,
            "shoulder_pitch_joint": 0.2, "left_shoulder_roll_joint": 0.2, "right_shoulder_roll_joint": -0.2,
        }, 0.25, 0.05,
    ),
    "AAHead_yaw": (
        {
            "Shoulder_Pitch": 0.2, "Left_Shoulder_Roll": -1.35, "Right_Shoulder_Roll": 1.35, "Left_Elbow_Yaw": -0.5,
            "Right_Elbow_Yaw": 0.5, "Hip_Pitch": -0.2, "Knee_Pitch": 0.4, "Ankle_Pitch": -0.25,
        }, 1.0, 0.1,
    ),
}  # fmt: skip
"""By one of a robot's joints: its standing pose [rad], and the scales of gyroscope and speeds. From the configuration of holosoma at
fc600e7d: the metadata have joints and gains only, and the observation is in alphabetical order of its names."""
TWIST2_SIZES = 1432, 29
"""Numbers of a tracker's observation and action, of the format of TWIST2."""
TWIST2: tuple[dict[str, tuple[float, float, float]], ...] = (
    {
        "hip_pitch": (-0.2, 100, 2), "hip_roll": (0, 100, 2), "hip_yaw": (0, 100, 2), "knee": (0.4, 150, 4),
        "ankle_pitch": (-0.2, 40, 2), "ankle_roll": (0, 40, 2),
    },
    {
        "shoulder_pitch": (0, 40, 5), "shoulder_roll": (0.4, 40, 5), "shoulder_yaw": (0, 40, 5), "elbow": (1.2, 40, 5),
        "wrist_roll": (0, 4, 0.2), "wrist_pitch": (0, 4, 0.2), "wrist_yaw": (0, 4, 0.2),
    },
    {"waist_yaw": (0, 150, 4), "waist_roll": (0, 150, 4), "waist_pitch": (0, 150, 4)},
)  # fmt: skip
"""Angle [rad], stiffness [N m/rad] and damping [N m s/rad] of the joints of a leg, of an arm and of the waist, from TWIST2's
library."""

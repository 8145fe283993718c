"""The public comparison of retargeters on LAFAN1 `dance1_subject1`, frames 0–599, on the G1: our row beside the published ones.

    python scripts/bench/compare_public.py --clip dance600.bvh --scene scene_g1_29dof_wbt_plane.xml [--trajectory theirs.npz]

The definitions are those of evaluator version 2 of `Arkitect-z/retargeting_comparison`. The clip comes from LAFAN1, the scene
from holosoma; both are the user's. Without `--trajectory`, the clip is solved as a whole and as a stream.
"""

import argparse
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import robot_retarget as rr
from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.human.motion import Motion

HUMAN = {
    "root": "Hips",
    "torso": "Spine2",
    "head": "Head",
    **{f"{side}_{part}": f"{side.capitalize()}{joint}" for side in ("left", "right") for part, joint in (
        ("shoulder", "Arm"), ("elbow", "ForeArm"), ("wrist", "Hand"),
        ("hip", "UpLeg"), ("knee", "Leg"), ("ankle", "Foot"), ("toe", "Toe"),
    )},
}  # fmt: skip
"""Joints of LAFAN1 by the evaluator's names."""
BODIES = {
    "root": "pelvis",
    "torso": "torso_link",
    **{f"{side}_{part}": f"{side}_{body}" for side in ("left", "right") for part, body in (
        ("shoulder", "shoulder_roll_link"), ("elbow", "elbow_link"), ("wrist", "wrist_yaw_link"),
        ("hip", "hip_roll_link"), ("knee", "knee_link"), ("ankle", "ankle_roll_link"), ("toe", "foot_contact_point"),
    )},
}  # fmt: skip
"""Bodies of the scene by the evaluator's names; the head is `HEAD` above the torso."""
HEAD = np.array([0.0, 0.0, 0.35])
"""The head in the torso's frame [m]."""
CHAINS = [(f"{s}_{a}", f"{s}_{b}", f"{s}_{c}") for s in ("left", "right")
          for a, b, c in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))]  # fmt: skip
BONES = [("root", "torso"), *((a, b) for chain in CHAINS for a, b in pairwise(chain))]
PUBLISHED = {
    "GMR": (116.2, 8.3, 21.8, 6.5, 2.5, 11.4, 15.4, 1797.0, None),
    "OmniRetarget": (107.7, 7.6, 8.2, 53.2, 0.5, 1.0, 7.4, 604.0, None),
    "dense mink": (86.7, 20.3, 14.1, 33.3, 12.5, 0.0, 8.4, 1360.0, None),
    "sparse mink": (100.4, 24.0, 44.0, 29.5, 14.0, 0.0, 5.8, 803.0, None),
}
"""Rows of the repository's `core_summary.csv` (7c45e56), in the order of `COLUMNS`."""
COLUMNS = (
    "RF-KPE mm", "bone °", "bend °", "skate %", "stance cm", "pen max mm", "acc rms rad/s²", "jerk p95 rad/s³",
    "self-contact %",
)  # fmt: skip
SLOW, LOW, LEAST = 0.01, 0.05, 3
"""A standing foot: slower [m/s], lower above the clip's first percentile [m], for at least so many frames."""


@dataclass(frozen=True)
class Playback:
    """A trajectory measured on the scene: semantic points (T, 3) [m], heading (T,) [rad], contacts per frame."""

    points: dict[str, Floats]
    heading: Floats
    floor_depth: Floats
    self_contacts: Floats


def measured(model: mujoco.MjModel, qpos: Floats) -> Playback:
    """Measure a trajectory (T, 36) with MuJoCo's kinematics and contacts."""
    data, floor = mujoco.MjData(model), model.geom("floor").id
    points: dict[str, list[Floats]] = {name: [] for name in (*BODIES, "head")}
    depth, contacts = np.zeros(len(qpos)), np.zeros(len(qpos))
    for t, configuration in enumerate(qpos):
        data.qpos[:] = configuration
        mujoco.mj_forward(model, data)
        for name, body in BODIES.items():
            points[name].append(data.body(body).xpos.copy())
        points["head"].append(data.body("torso_link").xpos + data.body("torso_link").xmat.reshape(3, 3) @ HEAD)
        for contact in data.contact:
            if floor in contact.geom:
                depth[t] = max(depth[t], -contact.dist)
            else:
                contacts[t] += 1
    forward = Rotation.from_quat(qpos[:, 3:7], scalar_first=True).apply([1.0, 0.0, 0.0])
    heading = np.arctan2(forward[:, 1], forward[:, 0])
    return Playback({name: np.array(p) for name, p in points.items()}, heading, depth, contacts)


def human_points(motion: Motion) -> dict[str, Floats]:
    """Return (T, 3) per semantic point of the human [m]."""
    return {name: motion.positions[:, motion.skeleton.names.index(joint)] for name, joint in HUMAN.items()}


def human_heading(points: dict[str, Floats]) -> Floats:
    """Return (T,) the heading across hips and shoulders [rad]."""
    across = sum(points[f"right_{part}"] - points[f"left_{part}"] for part in ("hip", "shoulder"))
    forward = np.cross([0.0, 0.0, 1.0], across)
    return np.arctan2(forward[:, 1], forward[:, 0])


def local(points: dict[str, Floats], heading: Floats) -> dict[str, Floats]:
    """Return the points relative to the root, turned by the heading."""
    turn = Rotation.from_rotvec(np.outer(-heading, [0.0, 0.0, 1.0]))
    return {name: turn.apply(p - points["root"]) for name, p in points.items()}


def height(points: dict[str, Floats]) -> float:
    """Return the distance of the head from the middle of both toes in the first frame [m]."""
    return float(np.linalg.norm(points["head"][0] - (points["left_toe"][0] + points["right_toe"][0]) / 2))


def angles(a: Floats, b: Floats) -> Floats:
    """Return (T,) the angles between two series of vectors [rad]."""
    cosine = (a * b).sum(-1) / np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), 1e-12)
    return np.arccos(cosine.clip(-1.0, 1.0))


def normals(points: dict[str, Floats], chain: tuple[str, str, str]) -> Floats:
    """Return (T, 3) the normals of a limb's plane."""
    upper, middle, end = (points[name] for name in chain)
    return np.cross(middle - upper, end - middle)


def standing(points: dict[str, Floats], fps: float) -> Bools:
    """Return (T, 2) whether the human's ankles stand, in runs of `LEAST` frames or more."""
    feet = np.stack([points["left_ankle"], points["right_ankle"]], axis=1)
    stands = (speeds(feet, fps) < SLOW) & (feet[..., 2] < np.percentile(feet[..., 2], 1.0) + LOW)
    for column in stands.T:
        edges = np.flatnonzero(np.diff(np.concatenate([[0], column, [0]])))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            column[first:last] = last - first >= LEAST
    return stands


def speeds(points: Floats, fps: float) -> Floats:
    """Return (T, …) horizontal speeds [m/s]; the first frame has that of the second."""
    moved = np.linalg.norm(np.diff(points[..., :2], axis=0), axis=-1) * fps
    return np.concatenate([moved[:1], moved])


def row(motion: Motion, model: mujoco.MjModel, qpos: Floats) -> tuple[float, ...]:
    """Return the figures of a trajectory in the order of `COLUMNS`."""
    fps, human, robot = motion.fps, human_points(motion), measured(model, qpos)
    scale = height(measured(model, model.qpos0[None]).points) / height(human)
    theirs, ours = local(human, human_heading(human)), local(robot.points, robot.heading)
    kpe = np.mean([np.linalg.norm(ours[n] - scale * theirs[n], axis=1).mean() for n in HUMAN if n != "root"])
    bone = np.mean([angles(theirs[b] - theirs[a], ours[b] - ours[a]) for a, b in BONES])
    bend = [angles(normals(theirs, chain), normals(ours, chain)) for chain in CHAINS]
    toes = np.stack([robot.points["left_toe"], robot.points["right_toe"]], axis=1)
    stands = standing(human, fps)
    skates = (stands & (speeds(toes, fps) > SLOW)).any(axis=1)
    velocity = np.angle(np.exp(1j * np.diff(qpos[:, 7:], axis=0))) * fps
    acceleration = np.diff(velocity, axis=0) * fps
    rms = [np.sqrt((a**2).mean(axis=1)) for a in (acceleration, np.diff(acceleration, axis=0) * fps)]
    padded = [np.concatenate([np.zeros(len(qpos) - len(r)), r]) for r in rms]
    return (
        1e3 * float(kpe),
        np.degrees(float(bone)),
        np.degrees(float(np.mean(np.minimum(bend, np.pi - np.array(bend))))),
        100 * float(skates.mean()),
        100 * float(toes[..., 2][stands].mean()),
        1e3 * float(robot.floor_depth.max()),
        float(padded[0].mean()),
        float(np.percentile(padded[1], 95)),
        100 * float((robot.self_contacts > 0).mean()),
    )


def solved(motion: Motion, scene: Path) -> dict[str, tuple[Floats, float]]:
    """Return the configurations and frames per second of processor time, by way of solving."""
    robot, found = rr.load_robot(scene), {}
    began = time.process_time()
    whole = rr.retarget(motion, robot, balance="off").trajectory.qpos
    found["robot-retarget, whole clip"] = whole, len(motion) / (time.process_time() - began)
    began = time.process_time()
    streamed = np.array([q for q in rr.stream(robot, motion)])
    found["robot-retarget, stream"] = streamed, len(motion) / (time.process_time() - began)
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clip", type=Path, required=True, help="BVH of the 600 frames")
    parser.add_argument("--scene", type=Path, required=True, help="the G1's scene with floor, 29 hinges")
    parser.add_argument("--trajectory", type=Path, nargs="*", default=[], help="trajectories (.npz) to judge instead")
    given = parser.parse_args()
    motion, model = rr.read_motion(given.clip), mujoco.MjModel.from_xml_path(str(given.scene))
    judged = {
        path.stem: (rr.load_trajectory(path, rr.load_robot(given.scene)).qpos, np.nan) for path in given.trajectory
    }
    print(f"| | {' | '.join(COLUMNS)} | frames/s |\n|{'---|' * (len(COLUMNS) + 2)}")
    for name, (qpos, fps) in (judged or solved(motion, given.scene)).items():
        print(f"| {name} | {' | '.join(f'{v:.2f}' for v in row(motion, model, qpos))} | {fps:.0f} |", flush=True)
    for name, figures in PUBLISHED.items():
        print(f"| {name}, published | {' | '.join('–' if v is None else f'{v:g}' for v in figures)} | |")


if __name__ == "__main__":
    main()

"""Plain figures of a retargeted trajectory against the human motion it came from, for the measuring scripts.

They use what the solver never sees (MuJoCo's own contacts, differences over time) or compare the two bodies afresh.
"""

from dataclasses import dataclass, fields

import mujoco
import numpy as np
from scipy.ndimage import median_filter

from robot_retarget.arrays import Floats
from robot_retarget.human.match import Match
from robot_retarget.human.normalisation import normalised_distances
from robot_retarget.robot import Robot, world_points

SEGMENTS = (("shoulder", "elbow"), ("elbow", "hand"), ("hip", "knee"), ("knee", "ankle"))
LIMBS = (("pelvis", "chest"), *((f"{side}_{a}", f"{side}_{b}") for side in "lr" for a, b in SEGMENTS))
NEAR = {"hand": 0.13, "head": 0.22, "knee": 0.14, "hip": 0.10, "pelvis": 0.10}
"""A human hand this near to such a part, over the path between them, is in contact with it [-]."""
SLACK = 0.04
"""The robot keeps a contact that is no further than this beyond the human's [-]."""
TOUCHING = 1e-3
"""Links overlap from this depth on [m]."""


@dataclass(frozen=True)
class Figures:
    """Of one trajectory; `nan` where there is nothing to measure."""

    limb_deg: float
    """Angle between a human bone and the robot's, arms, legs and trunk, seen from the own pelvis [deg]."""
    distance_err: float
    """|d/τ of the robot − d/τ of the human| over all keypoint pairs, τ the path between them [-]."""
    contacts: float
    """Share of the human's hand contacts that the robot makes too."""
    overlap_pct: float
    """Frames in which links overlap, but for those that do where the robot rests [%]."""
    depth_cm: float
    """The deepest overlap [cm]."""
    skate_cm_s: float
    """Speed of the slowest sole point of a foot whose toes stand in the human motion [cm/s]."""
    float_cm: float
    """Median height of the lowest sole point [cm]."""
    jerk: float
    """Root of the mean squared third difference of the joints [rad/s³]."""
    step_rad: float
    """The largest change of one joint from frame to frame [rad]."""


def figures(robot: Robot, match: Match, human: Floats, qpos: Floats, fps: float) -> Figures:
    """Judge configurations (T, nq) against human keypoints (T, K, 3) [m] in the order of `match.keypoints`."""
    x = world_points(robot, match.points, qpos)
    nearness = normalised_distances(human, match.parents, match.human_bones)
    reached = normalised_distances(x, match.parents, match.robot_bones)
    upper = np.triu_indices(len(match.keypoints), 1)
    depth = overlaps(robot, qpos)
    soles = [world_points(robot, sole, qpos) for sole in match.anatomy.soles.values()]
    joints = qpos[:, robot.qpos_index]
    return Figures(
        _limb_angle(match, human, x),
        float(np.abs(reached - nearness)[:, *upper].mean()),
        _contacts_kept(match, nearness, reached),
        100 * float((depth > TOUCHING).mean()),
        100 * float(depth.max()),
        _skate(match, human, qpos, robot, fps),
        100 * float(np.median(np.min([sole[:, :, 2].min(1) for sole in soles], axis=0))) if soles else np.nan,
        float(np.sqrt((np.diff(joints, 3, axis=0) ** 2).mean()) * fps**3) if len(joints) > 3 else np.nan,
        float(np.abs(np.diff(joints, axis=0)).max(initial=0.0)),
    )


def mean(several: list[Figures]) -> Figures:
    """Column by column over what could be measured; `depth_cm` and `step_rad` take the largest."""
    table = {f.name: np.array([getattr(one, f.name) for one in several]) for f in fields(Figures)}
    pick = {name: np.nanmax if name in ("depth_cm", "step_rad") else np.nanmean for name in table}
    return Figures(**{name: float(pick[name](v)) if np.isfinite(v).any() else np.nan for name, v in table.items()})


def overlaps(robot: Robot, qpos: Floats) -> Floats:
    """(T,) the deepest overlap of two links at every frame, by MuJoCo's own contact filter [m]."""
    model, data = robot.model, mujoco.MjData(robot.model)
    solid = np.asarray(model.body_weldid)[model.geom_bodyid] != 0

    def contacts(q: Floats) -> list[tuple[tuple[int, int], float]]:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        found = data.contact
        return [((int(a), int(b)), float(d)) for (a, b), d in zip(found.geom, found.dist, strict=True)]

    rest = {pair for pair, distance in contacts(model.qpos0) if distance < 0}
    inside = [[-d for pair, d in contacts(q) if pair not in rest and solid[list(pair)].all()] for q in qpos]
    return np.array([max(depths, default=0.0) for depths in inside]).clip(min=0.0)


def _limb_angle(match: Match, human: Floats, x: Floats) -> float:
    limbs = [(match.index(a), match.index(b)) for a, b in LIMBS if {a, b} <= set(match.keypoints)]
    start, end = np.array(limbs).T
    ours, theirs = (_unit(_from_pelvis(match, y, y[:, end] - y[:, start])) for y in (x, human))
    return float(np.degrees(np.arccos(np.clip((ours * theirs).sum(-1), -1, 1))).mean())


def _from_pelvis(match: Match, x: Floats, vectors: Floats) -> Floats:
    """Vectors (T, B, 3) turned about z so that the hip line of their body points along y."""
    if not {"l_hip", "r_hip"} <= set(match.keypoints):
        return vectors
    left = _unit((x[:, match.index("l_hip")] - x[:, match.index("r_hip")])[:, None] * [1, 1, 0])
    ahead = np.cross(left, [0.0, 0.0, 1.0])
    parts = [(vectors * ahead).sum(-1), (vectors * left).sum(-1), vectors[..., 2]]
    return np.stack(parts, axis=-1)


def _contacts_kept(match: Match, nearness: Floats, reached: Floats) -> float:
    made, kept = 0, 0
    for i, a in enumerate(match.keypoints):
        for j, b in enumerate(match.keypoints):
            if a.endswith("_hand") and b.split("_")[-1] in NEAR and (i < j or not b.endswith("_hand")):
                touching = nearness[:, i, j] < NEAR[b.split("_")[-1]]
                made += int(touching.sum())
                kept += int((touching & (reached[:, i, j] < nearness[:, i, j] + SLACK)).sum())
    return kept / made if made else np.nan


def _skate(match: Match, human: Floats, qpos: Floats, robot: Robot, fps: float) -> float:
    slips = []
    for side, sole in match.anatomy.soles.items():
        if f"{side}_toe" not in match.keypoints or len(qpos) < 2:
            continue
        toe = human[:, match.index(f"{side}_toe")] / match.human_leg
        slow = np.linalg.norm(np.diff(toe, axis=0), axis=1) * fps < 0.2
        low = toe[1:, 2] < np.quantile(toe[:, 2], 0.02) + 0.08
        planted = median_filter((slow & low).astype(np.uint8), 5).astype(bool)
        steps = np.diff(world_points(robot, sole, qpos)[:, :, :2], axis=0)
        slips.append((np.linalg.norm(steps, axis=2) * fps).min(axis=1)[planted])
    found = np.concatenate(slips) if slips else np.zeros(0)
    return 100 * float(found.mean()) if found.size else np.nan


def _unit(vectors: Floats) -> Floats:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)

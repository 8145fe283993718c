"""A second public comparison on LAFAN1 `dance1_subject1`, all 3,945 frames, on the G1: our row beside the published ones.

    python scripts/bench/compare_contact.py --clip dance1_subject1.bvh --assets GMR/assets/unitree_g1 [--trajectory theirs.pkl]

The definitions are those of `prabin172/alex-gmr-retargeting` at 4f04a94, which judges GMR; floor and joints are measured on GMR's
`g1_mocap_29dof.xml`, self-collisions by the fifteen cylinders of its `g1_custom_collision_29dof.urdf`. Clip and models are the
user's. Without `--trajectory`, the clip is solved as a whole.
"""

import argparse
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

import robot_retarget as rr
from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.human.motion import Motion

COLUMNS = (
    "depth cm", "deeper than .5 cm %", "floating %", "self-collision %", "self-collision cm", "fastest rad/s", "jerk rad/s³",
    "contact %",
)  # fmt: skip
PUBLISHED = {
    "GMR": (7.1, 1.9, 89.6, 1.3, 5.5, 47.5, None, None),
    "GMR, height fix": (2.7, 0.3, 99.5, None, None, 47.5, None, None),
    "GMR, polished by them": (3.2, 0.6, 98.6, 0.4, 2.2, 6.2, None, None),
}
"""Rows of its `GMR-baseline-results.md` and `planLogGMR.md`, in the order of `COLUMNS`."""
NEAR = 0.005
"""Depth, or height of the lowest point, beyond which a frame counts [m]."""
PLANTED, HELD = 0.05, 0.03
"""A foot is planted while the human's foot or toe is lower, and held while the robot's sole is nearer to the floor [m]."""
HOPS = 2
"""Bodies that are this near in the tree are no self-collision."""


def lowest_points(model: mujoco.MjModel, qpos: Floats) -> tuple[Floats, Floats]:
    """Return the heights (T,) of the lowest point of the body, and (T, 2) of both soles [m], over all colliding geoms."""
    data = mujoco.MjData(model)
    geoms = [
        g for g in range(model.ngeom) if model.geom_bodyid[g] and (model.geom_contype[g] or model.geom_conaffinity[g])
    ]
    corners = {g: _corners(model, g) for g in geoms}
    feet = [
        {g for g in geoms if model.geom_bodyid[g] == model.body(f"{s}_ankle_roll_link").id} for s in ("left", "right")
    ]
    body, soles = np.zeros(len(qpos)), np.zeros((len(qpos), 2))
    for t, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        heights = {
            g: data.geom_xpos[g, 2] + (points @ data.geom_xmat[g, 6:]).min() - radius
            for g, (points, radius) in corners.items()
        }
        body[t] = min(heights.values())
        soles[t] = [min(heights[g] for g in foot) for foot in feet]
    return body, soles


def _corners(model: mujoco.MjModel, geom: int) -> tuple[Floats, float]:
    """Return points (P, 3) in the axes of a geom, and the radius around them, whose hull is the geom [m]."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        points = np.asarray(model.mesh_vert[first : first + count], dtype=float)
        return points[ConvexHull(points).vertices], 0.0
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return np.array([[0, 0, size[1]], [0, 0, -size[1]]]), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return size * [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], 0.0
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        turns = np.linspace(0, 2 * np.pi, 128, endpoint=False)
        rim = size[0] * np.column_stack([np.cos(turns), np.sin(turns)])
        return np.concatenate([np.column_stack([rim, np.full(128, z * size[1])]) for z in (-1, 1)]), 0.0
    raise SystemExit(f"geom {geom} of the model has a shape that is not known here")


def self_collisions(urdf: Path, qpos: Floats) -> Floats:
    """Return the depth (T,) of the deepest self-collision of the cylinders [m]."""
    spec = mujoco.MjSpec.from_file(str(urdf))
    spec.meshdir = str(urdf.parent / "meshes")
    pelvis = spec.body("pelvis")
    if not pelvis.joints:
        pelvis.add_freejoint()
    model = spec.compile()
    data, depth = mujoco.MjData(model), np.zeros(len(qpos))
    for t, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for contact in data.contact:
            first, second = model.geom_bodyid[contact.geom]
            if first and second and second not in _up(model, first) and first not in _up(model, second):
                depth[t] = max(depth[t], -contact.dist)
    return depth


def _up(model: mujoco.MjModel, body: int) -> list[int]:
    """Return a body's next `HOPS` bodies towards the root."""
    chain: list[int] = []
    for _ in range(HOPS):
        body = int(model.body_parentid[body])
        chain.append(body)
    return chain


def planted(motion: Motion) -> Bools:
    """Return (T, 2) whether the human's left and right foot are low."""
    return np.stack(
        [
            np.minimum(
                *(motion.positions[:, motion.skeleton.names.index(f"{side}{part}"), 2] for part in ("Foot", "Toe"))
            )
            < PLANTED
            for side in ("Left", "Right")
        ],
        axis=1,
    )


def row(motion: Motion, assets: Path, qpos: Floats) -> tuple[float, ...]:
    """Return the figures of a trajectory in the order of `COLUMNS`."""
    low, soles = lowest_points(mujoco.MjModel.from_xml_path(str(assets / "g1_mocap_29dof.xml")), qpos)
    within, down = self_collisions(assets / "g1_custom_collision_29dof.urdf", qpos), planted(motion)
    jerk = np.linalg.norm(np.diff(qpos[:, 7:], 3, axis=0), axis=1) * motion.fps**3
    some = down.any(axis=1)
    correct = (low > -NEAR) & (~down | (abs(soles) < HELD)).all(axis=1)
    return (
        100 * max(0.0, -low.min()), 100 * (low < -NEAR).mean(), 100 * (low > NEAR).mean(), 100 * (within > 0).mean(),
        100 * within.max(), abs(np.diff(qpos[:, 7:], axis=0)).max() * motion.fps, jerk.mean(), 100 * correct[some].mean(),
    )  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clip", type=Path, required=True, help="BVH of LAFAN1")
    parser.add_argument("--assets", type=Path, required=True, help="GMR's folder of the G1")
    parser.add_argument("--trajectory", type=Path, nargs="*", default=[], help="trajectories to judge instead")
    given = parser.parse_args()
    motion, robot = rr.read_motion(given.clip), rr.load_robot(given.assets / "g1_mocap_29dof.xml")
    judged = {path.stem: rr.load_trajectory(path, robot) for path in given.trajectory}
    judged = judged or {"robot-retarget": rr.retarget(motion, robot, balance="off").trajectory}
    print(f"| | {' | '.join(COLUMNS)} |\n|{'---|' * (len(COLUMNS) + 1)}")
    for name, trajectory in judged.items():
        print(f"| {name} | {' | '.join(f'{v:.2f}' for v in row(motion, given.assets, trajectory.qpos))} |", flush=True)
    for name, figures in PUBLISHED.items():
        print(f"| {name}, published | {' | '.join('–' if v is None else f'{v:g}' for v in figures)} |")


if __name__ == "__main__":
    main()

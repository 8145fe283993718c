"""Box and climb of the public comparison `Arkitect-z/retargeting_comparison`, on the data of the wheel `holosoma-retargeting`.

    pip download --no-deps holosoma-retargeting; unzip it; python scripts/bench/bench_scene.py FOLDER CASE [--frames N] [--model FILE] [--stream]

The cases of the comparison are `box` and `climb`; the wheel has a second box and four more climbs. `--model` solves for another robot of the wheel,
such as models/g1/g1_29dof_spherehand.xml, which OmniRetarget takes for climbs.

A frame touches if the least distance of the robot's solid geoms from the bodies is from −1.1 mm to 2 cm; it penetrates below
that. Contact within 2 cm alone counts a hand deep inside the box. A foot slips if a sphere of its sole moves farther than
√2 + 0.1 mm in a frame while the human's toe moves 1 cm or less: heels that rise about resting toes count as well. The
second number counts only the lowest spheres of the foot. All distances are MuJoCo's, in holosoma's own model.
"""

import argparse
import re
import time
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

import robot_retarget as rr
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.placed_scene import placed_scene
from robot_retarget.human.surroundings import with_scene
from robot_retarget.solver.pipeline import Result
from robot_retarget.solver.solve import trajectory_of

TOUCH = (-0.0011, 0.02)
SLIP = (np.sqrt(2) + 0.1) * 1e-3
STILL = 0.01
LOWEST = 0.003
"""Spheres of a foot this near to its lowest one carry it [m]."""
HANDS, FEET = "rubber_hand|sphere_hand|thumb|pinky|wrist", "ankle"
"""Links of hands and feet, by the names of the geoms."""


def without_object(package: Path) -> Path:
    """Write the robot's scene without the box beside its meshes."""
    text = (package / "models/g1/g1_29dof_w_largebox.xml").read_text()
    file = package / "models/g1/g1_29dof_alone.xml"
    file.write_text(re.sub(r'<body name="largebox_link">.*?</body>', "", text, flags=re.S))
    return file


def box(package: Path, name: str) -> tuple[rr.Motion, float | None]:
    """Return a carried box: full size, as in the comparison."""
    clip = package / f"demo_data/OMOMO_new/{name}.pt"
    file = package / "box.toml"
    shape = f'model = "{package.resolve()}/models/largebox/largebox.xml"'
    file.write_text(f'[[body]]\nname = "largebox"\n{shape}\nposes = "{clip.resolve()}"\n')
    return with_scene(rr.read_motion(clip), rr.read_scene(file)), 1.0


def climb(package: Path, name: str) -> tuple[rr.Motion, float | None]:
    """Return a climb over two or three blocks, every fourth frame, which are scaled with the human."""
    folder = (package / f"demo_data/climb/{name}").resolve()
    file = package / "climb.toml"
    body = '[[body]]\nname = "{1.stem}"\nshape = "mesh"\nfile = "{0}/box_models/{1.name}"\n'
    file.write_text("".join(body.format(folder, path) for path in sorted(folder.glob("box_models/*.obj"))))
    clip = next(folder.glob("*.npy"))
    return with_scene(rr.read_motion(clip).resample(30), rr.read_scene(file)), None


CASES = {"box": (box, "sub3_largebox_003"), "box10": (box, "sub10_largebox_049")}
CASES |= {f"climb{k or ''}": (climb, f"mocap_climb_seq_{k}") for k in range(5)}
"""Per case its reader, and the clip."""


@dataclass(frozen=True, eq=False)
class Streamed:
    """What a stream makes of a motion."""

    graph: RobotGraph
    robot: rr.Robot
    trajectory: rr.Trajectory


def streamed(motion: rr.Motion, graph: RobotGraph, scale: float | None) -> Streamed:
    """Return the motion frame by frame, with the pose of the bodies at each."""
    qpos = np.array(list(rr.stream(graph.robot, motion, scene_scale=scale)))
    return Streamed(graph, graph.robot, trajectory_of(graph.motion, graph.robot, qpos))


def distances(result: Result | Streamed) -> tuple[np.ndarray, list[str]]:
    """Return (T, G) least distance of each solid geom of the robot from the bodies [m], and the names of the geoms."""
    graph = result.graph
    scene = placed_scene(graph.human, graph.match)
    assert scene is not None
    among, qpos = scene.among(result.robot), result.trajectory.qpos
    geoms = [
        g
        for g in range(result.robot.model.ngeom)
        if result.robot.model.geom_contype[g] and result.robot.model.geom_bodyid[g]
    ]
    bodies = [among.model.geom(f"scene: {name}").id for name in scene.names]
    found, ends = np.full((len(qpos), len(geoms)), np.inf), np.zeros(6)
    for t, (q, poses) in enumerate(zip(qpos, scene.poses(len(qpos)), strict=True)):
        among.near(q, poses, 0.0)
        for k, geom in enumerate(geoms):
            found[t, k] = min(mujoco.mj_geomDistance(among.model, among.data, body, geom, 1.0, ends) for body in bodies)
    return found, [result.robot.model.geom(g).name for g in geoms]


def slips(result: Result | Streamed, graph: RobotGraph) -> tuple[float, float]:
    """Return the share of frames in which a sphere of a sole slips while the human's toe is still, of all spheres and of the lowest [%]."""
    robot, qpos = result.robot, result.trajectory.qpos
    data, spheres = (
        mujoco.MjData(robot.model),
        {
            s: [robot.model.body(f"{side}_ankle_roll_sphere_{k}_link").id for k in range(1, 5)]
            for s, side in (("l", "left"), ("r", "right"))
        },
    )
    places = np.empty((len(qpos), robot.model.nbody, 3))
    for t, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(robot.model, data)
        places[t] = data.xpos
    slipped = np.zeros((2, len(qpos) - 1), bool)
    for side, own in spheres.items():
        toe = graph.human.positions[:, graph.match.index(f"{side}_toe")]
        still = np.linalg.norm(np.diff(toe, axis=0), axis=1) <= STILL
        moved = np.linalg.norm(np.diff(places[:, own, :2], axis=0), axis=2)
        height = places[:, own, 2]
        low = height <= height.min(axis=1, keepdims=True) + LOWEST
        resting = np.where(low[1:] & low[:-1], moved, 0.0)
        slipped |= np.stack([still & (way.max(axis=1) > SLIP) for way in (moved, resting)])
    every, lowest = 100 * slipped.mean(axis=1)
    return float(every), float(lowest)


def share(flags: np.ndarray) -> str:
    return f"{100 * float(flags.mean()):.1f} %"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("package", type=Path, help="the folder holosoma_retargeting of the unpacked wheel")
    parser.add_argument("case", choices=CASES)
    parser.add_argument("--model", type=Path, help="the robot; by default that of the comparison")
    parser.add_argument("--frames", type=int, help="the first N frames alone")
    parser.add_argument("--stream", action="store_true", help="frame by frame, in place of the whole clip")
    parser.add_argument("--out", type=Path, help="write the trajectory here")
    given = parser.parse_args()
    read, name = CASES[given.case]
    motion, scale = read(given.package, name)
    motion = motion if given.frames is None else motion.frames(0, given.frames)
    robot = rr.load_robot(given.model or without_object(given.package))
    began = time.process_time()
    graph = rr.describe(motion, robot, scene_scale=scale)
    described = time.process_time() - began
    result = streamed(motion, graph, scale) if given.stream else rr.solve(graph, balance="off")
    took = time.process_time() - began
    least, names = distances(result)
    for title, own in (("all", ""), ("hands", HANDS), ("feet", FEET)):
        near = least[:, [k for k, name in enumerate(names) if re.search(own, name)]].min(axis=1)
        touching, inside = (near >= TOUCH[0]) & (near <= TOUCH[1]), near < TOUCH[0]
        deepest = 1e3 * max(-near.min(), 0.0)
        print(
            f"{title:6} touch {share(touching)}, ≤ 2 cm {share(near <= TOUCH[1])}, inside {share(inside)}, deepest {deepest:.1f} mm"
        )
    every, lowest = slips(result, graph)
    print(
        f"slips {every:.1f} %, of the lowest spheres {lowest:.1f} %; {len(motion)} frames in {took:.1f} s CPU (describe {described:.1f}), {len(motion) / took:.0f} fps"
    )
    if isinstance(result, Result):
        print(
            {name: round(float(stress.sum()), 2) for name, stress in result.solution.stress.items()},
            [e.sentence for e in result.solution.unmet][:4],
        )
    if given.out:
        result.trajectory.save(given.out)


if __name__ == "__main__":
    main()

"""The impulse that a robot survives without and with balance feedback: `python scripts/bench_feedback.py --worlds 20 CLIP.npz …`.

A push of 0.1 s on the trunk, in the middle of the motion, in four directions. The table has the impulse [N s] that all but one in
twenty drawn worlds survive: no body other than a foot touches the floor within 1.8 s. `stand` is the first pose, held. `--gif FILE` draws
one push without and with feedback side by side.
"""

import argparse
from itertools import islice
from pathlib import Path

import mujoco
import numpy as np

import robot_retarget as rr
from robot_retarget.arrays import Floats
from robot_retarget.simulate.domain import draws
from robot_retarget.simulate.plant import Plant
from robot_retarget.simulate.push import AFTER, DIRECTIONS, pushed, standing, survived_impulses, worlds_at_push
from robot_retarget.simulate.rollout import plant_of
from robot_retarget.trajectory import Trajectory, load_trajectory

STRIDE = 5
"""A frame of the GIF is drawn at every fifth goal."""
SIZE = 300
"""Height and width of each picture of the GIF [pixels]."""


def survived_by_most(trajectory: Trajectory, plant: Plant, worlds: int, feedback: bool) -> list[float]:
    """The impulse in each direction that all but one in twenty worlds survive [N s]."""
    starts = worlds_at_push(plant, trajectory, draws(worlds), feedback)
    return [float(survived_impulses(starts, np.array(way))[worlds // 20]) for way in DIRECTIONS.values()]


def film(trajectory: Trajectory, plant: Plant, impulse: Floats, feedback: bool) -> list[np.ndarray]:
    """Pictures of a push in the first drawn world."""
    (start,) = worlds_at_push(plant, trajectory, draws(1), feedback)
    renderer, camera, frames = mujoco.Renderer(plant.model, SIZE, SIZE), mujoco.MjvCamera(), []
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (0.05, 0, 0.2), 1.1, 120, -12
    for world in islice(pushed(start, impulse), 0, round(AFTER * start.goals.rate), STRIDE):
        renderer.update_scene(world.data, camera)
        frames.append(renderer.render().copy())
    return frames


def side_by_side(trajectory: Trajectory, plant: Plant, impulse: Floats, path: Path) -> None:
    """Write a GIF of one push, without feedback on the left and with it on the right."""
    from PIL import Image

    films = [film(trajectory, plant, impulse, feedback) for feedback in (False, True)]
    joined = [Image.fromarray(np.hstack(pair)) for pair in zip(*films, strict=True)]
    joined[0].save(path, save_all=True, append_images=joined[1:], duration=40, loop=0)


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("clips", nargs="+", type=Path, help="trajectories of a robot with a sensor")
    ap.add_argument("--robot", default="op3")
    ap.add_argument("--worlds", type=int, default=20)
    ap.add_argument("--gif", type=Path)
    ap.add_argument("--impulse", type=float, nargs=2, default=(1.3, 0.0), help="of the GIF, ahead and left [N s]")
    arg = ap.parse_args()
    plant = plant_of(rr.load_robot(arg.robot), "free")
    motions = {path.stem: load_trajectory(path) for path in arg.clips}
    first = standing(next(iter(motions.values())))
    if arg.gif:
        side_by_side(first, plant, np.array([*arg.impulse, 0.0]), arg.gif)
        return
    print("| motion | feedback | " + " | ".join(f"{name} [N s]" for name in DIRECTIONS) + " |")
    print("|---|---|" + "---|" * len(DIRECTIONS))
    for name, trajectory in {"stand": first, **motions}.items():
        for feedback in (False, True):
            found = survived_by_most(trajectory, plant, arg.worlds, feedback)
            cells = " | ".join(f"{x:.2f}" for x in found)
            print(f"| {name} | {'with' if feedback else 'without'} | {cells} |", flush=True)


if __name__ == "__main__":
    main()

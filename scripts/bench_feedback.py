"""The impulse that a robot survives without and with balance feedback: `python scripts/bench_feedback.py --worlds 20 CLIP.npz …`.

A push of 0.1 s on the trunk, in the middle of the motion, in four directions. An impulse [N s] counts as survived where at
most one in twenty drawn worlds falls within `AFTER` seconds: a body other than a foot on the floor. Each world is played once up to the
push; every impulse begins from its state there. `stand` stands for the first pose held. `--gif FILE` draws one push without and with
feedback side by side.
"""

import argparse
import copy
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

import robot_retarget as rr
from robot_retarget.arrays import Floats
from robot_retarget.goals import Goals
from robot_retarget.simulate.compensate import compensated
from robot_retarget.simulate.domain import Draw, drawn, draws
from robot_retarget.simulate.feedback import ClosedLoop, with_feedback
from robot_retarget.simulate.feet import feet_of
from robot_retarget.simulate.goals import Playback
from robot_retarget.simulate.plant import Plant
from robot_retarget.simulate.rollout import plant_of
from robot_retarget.simulate.stepping import set_on_floor
from robot_retarget.trajectory import Trajectory, load_trajectory

DIRECTIONS = {"fore": (1.0, 0, 0), "aft": (-1.0, 0, 0), "left": (0, 1.0, 0), "right": (0, -1.0, 0)}
DURATION = 0.1
"""Of a push [s]."""
AFTER = 1.8
"""A robot that is still up so long after the push has survived it [s]."""
MOST, STEP = 4.0, 0.125
"""Impulses are looked for up to, and to within [N s]."""


@dataclass
class World:
    """One drawn world at a moment."""

    plant: Plant
    data: mujoco.MjData
    goals: Goals
    loop: ClosedLoop | None
    late: int
    row: int = 0
    sent: list[Floats] = field(default_factory=list)
    """Controls, the latest last."""

    def branch(self) -> "World":
        """A copy that goes its own way."""
        return World(
            self.plant, copy.copy(self.data), self.goals, copy.deepcopy(self.loop), self.late, self.row, [*self.sent]
        )

    def tick(self, force: Floats) -> None:
        """One goal under a force (3,) on the trunk [N]."""
        model, data, root = self.plant.model, self.data, self.plant.robot.root_body
        data.xfrc_applied[root, :3] = force
        held = round(1 / (self.goals.rate * model.opt.timestep))
        row = min(self.row, len(self.goals) - 1)
        sent = self.plant.controls(self.goals.angles[row][None])[0]
        if self.loop is not None:
            sent = self.loop.controls(row, data)
        self.sent.append(sent)
        whole, rest = divmod(self.late, held)
        if rest:
            data.ctrl[:] = self.sent[max(len(self.sent) - whole - 2, 0)]
            mujoco.mj_step(model, data, rest)
        data.ctrl[:] = self.sent[max(len(self.sent) - whole - 1, 0)]
        mujoco.mj_step(model, data, held - rest)
        self.row += 1


def begun(plant: Plant, trajectory: Trajectory, goals: Goals, draw: Draw, feedback: bool) -> World:
    """A world at the first goal."""
    world, how = drawn(plant, draw, Playback())
    data = mujoco.MjData(world.model)
    data.qpos[:] = trajectory.qpos[0]
    set_on_floor(world.model, data)
    mujoco.mj_forward(world.model, data)
    imu = plant.servo_map.imu if plant.servo_map else None
    loop = ClosedLoop(world, goals, imu, how.seed) if feedback and imu is not None else None
    data.ctrl[:] = world.controls(goals.angles[:1])[0]
    return World(world, data, goals, loop, round(how.delay / world.model.opt.timestep))


def touches_floor(world: World, feet: set[int]) -> bool:
    """Whether anything but a foot is on the floor."""
    bodies = world.plant.model.geom_bodyid[world.data.contact.geom[: world.data.ncon]]
    scene = (bodies == 0).any(axis=1)
    return bool(scene.any()) and not set(bodies[scene].max(axis=1).tolist()) <= feet


def pushed(start: World, impulse: Floats, feet: set[int]) -> Iterator[World]:
    """The ticks after a push, up to a fall."""
    world, rate = start.branch(), start.goals.rate
    for k in range(round(AFTER * rate)):
        world.tick(impulse / DURATION if k < round(DURATION * rate) else np.zeros(3))
        yield world
        if k % 4 == 0 and touches_floor(world, feet):
            return


def survives(start: World, impulse: Floats, feet: set[int]) -> bool:
    """Whether a world is still up at the end."""
    ticks = sum(1 for _ in pushed(start, impulse, feet))
    return ticks == round(AFTER * start.goals.rate)


def largest(starts: list[World], direction: Floats, feet: set[int]) -> float:
    """The largest impulse that all but one in twenty worlds survive [N s]."""
    allowed, low, high = len(starts) // 20, 0.0, MOST
    while high - low > STEP:
        middle, fallen = (low + high) / 2, 0
        for start in starts:
            fallen += not survives(start, middle * direction, feet)
            if fallen > allowed:
                break
        low, high = (middle, high) if fallen <= allowed else (low, middle)
    return low


def starts_of(trajectory: Trajectory, plant: Plant, worlds: int, feedback: bool) -> list[World]:
    """Every world at the moment of the push."""
    goals = compensated(plant, trajectory, "free")
    goals = with_feedback(plant, trajectory, goals) if feedback else goals
    found = [begun(plant, trajectory, goals, draw, feedback) for draw in draws(worlds)]
    for world in found:
        for _ in range(len(goals) // 2):
            world.tick(np.zeros(3))
    return found


def standing(trajectory: Trajectory) -> Trajectory:
    """Its first pose, held for a second."""
    frames = round(trajectory.fps) + 1
    return Trajectory(
        np.tile(trajectory.qpos[:1], (frames, 1)), trajectory.fps, trajectory.joint_names, trajectory.robot, "stand"
    )


def side_by_side(trajectory: Trajectory, plant: Plant, impulse: Floats, path: Path) -> None:
    """A GIF of one push in the nominal world, without feedback on the left and with it on the right."""
    from PIL import Image

    feet = set(feet_of(plant.robot).all_bodies)
    films = []
    for feedback in (False, True):
        start = starts_of(trajectory, plant, 1, feedback)[0]
        renderer, frames = mujoco.Renderer(plant.model, 300, 300), []
        camera = mujoco.MjvCamera()
        camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (0.05, 0, 0.2), 1.1, 120, -12
        for k, world in enumerate(pushed(start, impulse, feet | set(range(plant.model.nbody)))):
            if k % 5 == 0:
                renderer.update_scene(world.data, camera)
                frames.append(renderer.render().copy())
        films.append(frames)
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
    feet = set(feet_of(plant.robot).all_bodies)
    motions = {path.stem: load_trajectory(path) for path in arg.clips}
    first = standing(next(iter(motions.values())))
    if arg.gif:
        side_by_side(first, plant, np.array([*arg.impulse, 0.0]), arg.gif)
        return
    print("| motion | feedback | " + " | ".join(f"{name} [N s]" for name in DIRECTIONS) + " |")
    print("|---|---|" + "---|" * len(DIRECTIONS))
    for name, trajectory in {"stand": first, **motions}.items():
        for feedback in (False, True):
            starts = starts_of(trajectory, plant, arg.worlds, feedback)
            found = [largest(starts, np.array(way), feet) for way in DIRECTIONS.values()]
            print(
                f"| {name} | {'with' if feedback else 'without'} | " + " | ".join(f"{x:.2f}" for x in found) + " |",
                flush=True,
            )


if __name__ == "__main__":
    main()

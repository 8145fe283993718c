"""Bodies of a scene in a simulation: carried along their path, or free, with mass and friction."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.robot.geoms import solid_geoms
from robot_retarget.robot.model import Robot
from robot_retarget.scene.geoms import PREFIX, moving_bodies, place_bodies
from robot_retarget.scene.scene import Scene

Objects = Literal["carried", "free"]
"""Whether moving bodies follow their path, or move by contact and gravity."""
DROPPED = 0.5
"""A free body is dropped when it is farther from its path than this share of its longest edge [-]."""

SOLID = 1 << 29
"""Contact type of bodies for solid geoms of the robot: a model may list its contacts by pairs instead of types."""
STIFF = 0.01
"""Time constant of a free body's contacts [s]: half of MuJoCo's default of 0.02."""
TURNING = 4
"""Dimensions of contacts of free bodies (MuJoCo's `condim`): with friction against turning about the normal, as of a palm."""


@dataclass(frozen=True, eq=False)
class SimulatedBodies:
    """The bodies of a scene in a plant's model."""

    scene: Scene
    """With poses at the frames of the trajectory."""
    model: mujoco.MjModel

    @cached_property
    def carried(self) -> Ints:
        """(M, 2) mocap ids and indices of the bodies that follow their path."""
        return moving_bodies(self.model, self.scene)

    @cached_property
    def free(self) -> tuple[int, ...]:
        """Indices of the bodies that move by contact and gravity."""
        carried = set(self.carried[:, 1].tolist())
        return tuple(k for k, body in enumerate(self.scene.bodies) if not body.fixed and k not in carried)

    @cached_property
    def ids(self) -> Ints:
        """Ids of the bodies in the model."""
        return np.array([self.model.body(PREFIX + name).id for name in self.scene.names], np.int64)

    @cached_property
    def still(self) -> tuple[int, ...]:
        """Ids in the model of the bodies at rest."""
        return tuple(int(self.ids[k]) for k, body in enumerate(self.scene.bodies) if body.fixed)

    @cached_property
    def coordinates(self) -> Ints:
        """(7 F,) indices of the free bodies' poses in the model's configuration, in their order."""
        first = self.model.jnt_qposadr[self.model.body_jntadr[self.ids[list(self.free)]]]
        return (first[:, None] + np.arange(7)).ravel()

    @cached_property
    def dofs(self) -> Ints:
        """(6 F,) indices of the free bodies' velocities in the model."""
        return (self.model.body_dofadr[self.ids[list(self.free)]][:, None] + np.arange(6)).ravel()

    def free_paths(self, frames: Floats) -> Floats:
        """Return (N, 7 F) poses of the free bodies at fractional frames (N,)."""
        return self.paths(frames)[:, list(self.free)].reshape(len(frames), -1)

    def touch(self, robot: Robot) -> None:
        """Let all solid geoms of the robot touch the bodies, and stiff contacts hold the free ones: soft friction lets a held body creep."""
        model, own = self.model, np.isin(self.model.geom_bodyid, self.ids)
        model.geom_contype[own] |= SOLID
        for geom in [g for geoms in solid_geoms(robot).values() for g in geoms]:
            body = int(robot.model.geom_bodyid[geom])
            model.geom_conaffinity[model.body_geomadr[body] + geom - robot.model.body_geomadr[body]] |= SOLID
            model.body_conaffinity[body] |= SOLID
        model.body_contype[self.ids] |= SOLID
        if self.free:
            held = np.isin(model.geom_bodyid, self.ids[list(self.free)])
            model.geom_solref[held], model.geom_priority[held], model.geom_condim[held] = (STIFF, 1.0), 1, TURNING

    def paths(self, frames: Floats) -> Floats:
        """Return (N, B, 7) poses at fractional frames (N,)."""
        return self.scene.resampled(frames).poses(len(frames))

    def place(self, data: mujoco.MjData, poses: Floats, settling: bool) -> None:
        """Set the carried bodies to their poses (B, 7), and the free ones while the robot settles: hands come to grips with them."""
        place_bodies(data, poses, self.carried)
        if settling and self.free:
            data.qpos[self.coordinates] = poses[list(self.free)].ravel()
            data.qvel[self.dofs] = 0.0

    def figures(self, paths: Floats, places: Floats, times: Floats) -> dict[str, Any]:
        """Return when each free body was dropped, how far it was from its path and its mass, by name.

        Args:
            paths: (N, B, 7) poses of the trajectory.
            places: (N, B, 3) places in the simulation [m].
            times: (N,) [s].
        """
        found = {}
        for k in self.free:
            body = self.scene.bodies[k]
            off = np.linalg.norm(places[:, k] - paths[: len(places), k, :3], axis=1)
            lost = np.flatnonzero(off > DROPPED * body.shape.size.max())
            when = round(float(times[lost[0]]), 2) if lost.size else None
            found[body.name] = {
                "dropped_s": when,
                "off_m": round(float(off.max(initial=0.0)), 4),
                "mass_kg": round(body.weight, 4),
            }
        return found


def dropped(figures: Mapping[str, Any]) -> list[str]:
    """Return the reasons of free bodies against a trajectory."""
    lost = {name: facts["dropped_s"] for name, facts in figures.get("objects", {}).items()}
    return [f"{name} is dropped at {when:g} s" for name, when in lost.items() if when is not None]

"""Which bodies touch: of a robot with itself, over the frames of a trajectory."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.robot.model import Robot


@dataclass(frozen=True)
class Contacts:
    """C overlaps of two bodies, each in one frame or step."""

    frame: Ints
    """(C,)"""
    bodies: Ints
    """(C, 2) body ids, the lower first."""
    depth: Floats
    """(C,) how far the surfaces overlap [m]."""
    places: Floats
    """(C, 3) where, in the world [m]."""

    def __len__(self) -> int:
        return len(self.frame)

    def of(self, chosen: Any) -> "Contacts":
        """Those that a mask (C,) chooses."""
        return Contacts(self.frame[chosen], self.bodies[chosen], self.depth[chosen], self.places[chosen])

    @property
    def own(self) -> "Contacts":
        """Those of the robot with itself."""
        return self.of(self.bodies[:, 0] > 0)

    @property
    def scene(self) -> "Contacts":
        """Those with the world."""
        return self.of(self.bodies[:, 0] == 0)

    def without(self, pairs: set[tuple[int, int]]) -> "Contacts":
        """Those of other pairs of bodies."""
        return self.of(np.array([tuple(pair) not in pairs for pair in self.bodies.tolist()], dtype=bool))

    def pairs(self) -> set[tuple[int, int]]:
        """The pairs of bodies that overlap at all."""
        return {(a, b) for a, b in self.bodies.tolist()}


class ContactLog:
    """Collects MuJoCo's contacts over frames or steps."""

    def __init__(self, model: mujoco.MjModel, bodies: int | None = None):
        """Watch the first `bodies` of a model, by default all; those of a scene come last."""
        self._watched = model.nbody if bodies is None else bodies
        self._body = np.asarray(model.geom_bodyid)
        self._frames: list[int] = []
        self._counts: list[int] = []
        self._geoms: list[Ints] = []
        self._distances: list[Floats] = []
        self._places: list[Floats] = []

    def record(self, frame: int, data: mujoco.MjData) -> None:
        """Take down the contacts of this moment."""
        if data.ncon:
            contact = data.contact
            self._frames.append(frame)
            self._counts.append(len(contact.dist))
            self._geoms.append(contact.geom.astype(np.int64))
            self._distances.append(contact.dist.copy())
            self._places.append(contact.pos.copy())

    def table(self) -> Contacts:
        """Overlaps of the watched bodies with each other."""
        found = self._all()
        return found.of(found.bodies[:, 1] < self._watched)

    def around(self) -> Contacts:
        """Overlaps of the watched bodies with the others."""
        found = self._all()
        own = (found.bodies[:, 0] > 0) & (found.bodies[:, 0] < self._watched)
        return found.of(own & (found.bodies[:, 1] >= self._watched))

    def _all(self) -> Contacts:
        if not self._frames:
            return Contacts(np.zeros(0, int), np.zeros((0, 2), int), np.zeros(0), np.zeros((0, 3)))
        geoms, distance = np.concatenate(self._geoms), np.concatenate(self._distances)
        frames = np.repeat(self._frames, self._counts)
        overlap = (distance < 0) & (geoms >= 0).all(1)  # negative ids belong to deformable bodies
        bodies = np.sort(self._body[geoms[overlap]], axis=1)
        places = np.concatenate(self._places)[overlap]
        return Contacts(frames[overlap], bodies.astype(np.int64), -distance[overlap], places)


def replay_contacts(robot: Robot, qpos: Floats) -> Contacts:
    """Self-contacts over the configurations (T, nq), without any dynamics, less the `reference_overlaps` ones."""
    return _overlaps(robot, qpos).own.without(reference_overlaps(robot))


def reference_overlaps(robot: Robot) -> set[tuple[int, int]]:
    """Pairs of bodies that overlap already in the reference pose `qpos0`: the model's own affair, no motion's."""
    return _overlaps(robot, np.array(robot.model.qpos0)[None]).own.pairs()


def summary(contacts: Contacts, robot: Robot, frames: int) -> list[dict[str, Any]]:
    """A line per pair of bodies, deepest first: names, greatest depth [m], frames, share of all frames."""
    lines = []
    for first, second in sorted(contacts.pairs()):
        of_pair = contacts.of((contacts.bodies == (first, second)).all(1))
        count = len(np.unique(of_pair.frame))
        lines.append(
            {
                "bodies": [robot.model.body(first).name, robot.model.body(second).name],
                "depth_m": round(float(of_pair.depth.max()), 5),
                "frames": count,
                "share": round(count / frames, 4),
            }
        )
    return sorted(lines, key=lambda line: -line["depth_m"])


def _overlaps(robot: Robot, qpos: Floats) -> Contacts:
    model, data = robot.model, mujoco.MjData(robot.model)
    log = ContactLog(model)
    for frame, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        log.record(frame, data)
    return log.table()

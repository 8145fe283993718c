"""A pose without a side stays without one: where a problem is its own mirror image, so is every step.

A squat or a clap is a saddle as soon as links touch: either knee may go first, and rounding, or which of two equally deep
corners is found first, decides. Let S reflect tangent vectors in the robot's own sagittal plane. Where the hinges q and
the gradient g are their own mirror images, S g = g, and with each row of the quadratic program its reflection is one,
whatever step v solves it has a mirror image S v that solves it too, and (v + S v)/2 costs no more than either. Motions of
a human are never so even: they are left alone.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot import Anatomy, Robot
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.robot.mirror import Mirror, mirror_of
from robot_retarget.solve.quadratic import Quadratic

EVEN = 5e-4
"""Angles that differ from their mirror images by no more are even, and gradients that would move them by no more [rad]:
the two sides of a robot as it was drawn differ by tenths of a millimetre."""


class Symmetry:
    """The sagittal plane of one robot, as it moves with its root."""

    def __init__(self, robot: Robot, mirror: Mirror):
        self.robot, self.mirror = robot, mirror
        self.present = mirror.whole and (robot.floating or not robot.root_joints.size)

    def both_sides(self, qpos: Floats, start: Floats) -> Floats:
        """A start that was made from an even configuration by moving one limb, with the other moved likewise."""
        if not self.even(qpos):
            return start
        hinges, both = self.robot.qpos_index, start.copy()
        own = start[hinges]
        both[hinges] = np.where(own == qpos[hinges], self.mirror.angles(own), own)
        return both

    def even(self, qpos: Floats) -> bool:
        """Whether a configuration (nq,) is its own mirror image, on a robot that has one."""
        angles = qpos[self.robot.qpos_index]
        return self.present and bool(np.abs(self.mirror.angles(angles) - angles).max() < EVEN)

    def reflection(self, qpos: Floats) -> Floats:
        """S (nv, nv) = Sᵀ = S⁻¹: what tangent vectors and gradients at a configuration (nq,) are in the root's sagittal plane.

        The root travels in world axes, by M v with M = 1 − 2 n nᵀ, and turns in its own, by −(1 − 2 ℓ ℓᵀ) ω.
        """
        seen = self._own.copy()
        if self.robot.floating:
            left = self.mirror.left_in_world(qpos[self.robot.root_address + 3 :][:4])
            travel = slice(self._root, self._root + 3)
            seen[travel, travel] = np.eye(3) - 2 * np.outer(left, left)
        return seen

    @property
    def _root(self) -> int:
        """Where a free root begins among the tangent directions."""
        return int(self.robot.model.jnt_dofadr[self.robot.root_joints[0]])

    @cached_property
    def _own(self) -> Floats:
        """What of S does not depend on the configuration: all but how the root travels."""
        seen, hinges = np.zeros((self.robot.model.nv, self.robot.model.nv)), self.robot.dof_index
        seen[np.ix_(hinges, hinges)] = self.mirror.angles(np.eye(len(hinges))).T
        if self.robot.floating:
            turn = slice(self._root + 3, self._root + 6)
            seen[turn, turn] = 2 * np.outer(self.mirror.left, self.mirror.left) - np.eye(3)
        return seen


def pulls_evenly(reflection: Floats, here: Quadratic) -> bool:
    """Whether the gradient at an even configuration would move no joint to one side."""
    uneven = np.abs(reflection @ here.gradient - here.gradient)
    return bool((uneven <= EVEN * (1 + here.normal.diagonal())).all())


def doubled(reflection: Floats, here: Quadratic, soles: int) -> Quadratic:
    """The model whose links keep apart as mirror images of each other do: the half of the rows that demands most, and its
    reflections in place of the others. Hulls of meshes differ from side to side by a millimetre and more.
    """
    rows, least = here.rows.copy(order="F"), here.least.copy()
    order = soles + np.argsort(-least[soles:], kind="stable")
    half = len(order) // 2
    demanding, others = order[:half], order[half : 2 * half]
    rows[others, :-1] = rows[demanding, :-1] @ reflection
    rows[others, -1], least[others] = rows[demanding, -1], least[demanding]
    return replace(here, rows=rows, least=least)


def symmetry_of(robot: Robot, anatomy: Anatomy) -> Symmetry:
    """The symmetry of a robot; its left at the reference pose is that of its pelvis or chest."""
    frames = anatomy.frames
    body, axes = next((frames[segment] for segment in ("pelvis", "chest") if segment in frames), (0, np.eye(3)))
    left = body_frames(robot, np.array(robot.model.qpos0)[None])[1][0, body] @ axes[:, 1]
    return Symmetry(robot, mirror_of(robot, left))

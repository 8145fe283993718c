"""The trajectory that is scored, and measurements that several figures share."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.base.keypoints import SIDES
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.soles import contacts_of
from robot_retarget.contact.stance import SMOOTH
from robot_retarget.human.features import HumanFeatures
from robot_retarget.robot import Anatomy, Points, Robot, world_points
from robot_retarget.robot.body_distances import RobotAmongBodies
from robot_retarget.robot.contacts import replay_contacts
from robot_retarget.robot.dynamics import required_forces
from robot_retarget.robot.geoms import solid_geoms
from robot_retarget.robot.kinematics import POSED
from robot_retarget.robot.limbs import SOLE
from robot_retarget.robot.links import local_points
from robot_retarget.robot.support import feet_of
from robot_retarget.robot.timing import joint_velocities
from robot_retarget.scores.pair import Pair
from robot_retarget.trajectory import Trajectory

# The points of a foot that stand on the floor, as the figures on feet see them.

COUNT = 80
"""A sole is sampled by at most this many points, evenly in the order of the model's vertices: half gives the same skate
of three clips, double 0.03 in place of 0.06 cm/s of one."""


_ROUND = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER)


@dataclass(frozen=True, eq=False)
class Foot:
    """How a sole moves over T frames."""

    lowest: Floats
    """(T,) height of its lowest point [m]."""
    middle: Floats
    """(T, 2) the mean of its points, seen from above [m]."""
    slip: Floats
    """(T,) speed along the floor of its slowest point, 0 at the first frame [m/s]."""


def foot_of(robot: Robot, sole: Points, qpos: Floats, fps: float) -> Foot:
    """Follow a sole through configurations (T, nq), a block of frames at a time."""
    count = len(qpos)
    lowest, middle, slip = np.empty(count), np.empty((count, 2)), np.zeros(count)
    for first in range(0, count, POSED):
        before = max(first - 1, 0)
        places, new = world_points(robot, sole, qpos[before : first + POSED]), slice(first, first + POSED)
        own = places[first - before :]
        lowest[new], middle[new] = own[..., 2].min(axis=1), own[..., :2].mean(axis=1)
        steps = np.linalg.norm(np.diff(places[..., :2], axis=0), axis=2) * fps
        slip[before + 1 : first + POSED] = steps.min(axis=1, initial=np.inf)
    return Foot(lowest, middle, slip)


def soles_of(robot: Robot, anatomy: Anatomy) -> tuple[Points, ...]:
    """The left and the right sole; none where the robot has not both."""
    feet = [anatomy.sites.get(f"{side}_toe", anatomy.sites.get(f"{side}_ankle")) for side in "lr"]
    soles = tuple(sole_points(robot, foot.body) for foot in feet if foot)
    return soles if len(soles) == 2 and all(len(sole) for sole in soles) else ()


def sole_points(robot: Robot, foot: int) -> Points:
    """The sole of a body: vertices of its geoms within `SOLE` of the lowest in the reference pose.

    Spheres, capsules and cylinders count by the lowest points of their ends.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    mujoco.mj_forward(model, data)
    clouds = [_places(model, data, int(geom)) for geom in np.flatnonzero(model.geom_bodyid == foot)]
    cloud = np.concatenate([np.zeros((0, 3)), *clouds])
    if not len(cloud):
        return Points(np.zeros(0, int), cloud)
    cloud = cloud[cloud[:, 2] < cloud[:, 2].min() + SOLE]
    cloud = cloud[np.linspace(0, len(cloud) - 1, min(COUNT, len(cloud))).astype(int)]
    return Points(np.full(len(cloud), foot), (cloud - data.xpos[foot]) @ data.xmat[foot].reshape(3, 3))


def _places(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Floats:
    """(P, 3) the outermost points of a geom in the world [m]."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    local, below = local_points(model, geom), np.zeros(3)
    if kind in _ROUND:
        half = 0.0 if kind == mujoco.mjtGeom.mjGEOM_SPHERE else float(size[1])
        local, below = np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]), np.array([0.0, 0.0, size[0]])
    return local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom] - below


TOUCH_REACH = 0.05
"""Links that are farther from a body do not touch it [m]: 2.5 times the 2 cm of `pose.BODY_TOUCH`."""
OVERLAP = 1e-3
"""Overlaps of links up to this depth are the softness of a touch [m]: half and double find none in three clips
either."""


@dataclass(frozen=True, eq=False)
class Subject:
    """One trajectory of T frames on its robot, with its human motion if that is known."""

    trajectory: Trajectory
    robot: Robot
    soles: tuple[Points, ...] = ()
    """Left and right; empty for a robot without recognised feet."""
    compared: Pair | None = None
    """The keypoints of human and robot; None without a human motion."""
    anatomy: Anatomy | None = None
    """The recognised parts of the robot; None if it is no humanoid."""
    around: HumanFeatures | None = None
    """The human among the bodies of the trajectory; None without a human motion or bodies."""

    @property
    def pair(self) -> Pair:
        """The keypoints of human and robot, of a subject with a human motion."""
        assert self.compared is not None
        return self.compared

    def __len__(self) -> int:
        return len(self.trajectory)

    @property
    def fps(self) -> float:
        """Frames per second [1/s]."""
        return self.trajectory.fps

    @cached_property
    def body_links(self) -> Ints:
        """(L,) links that bodies around the robot may touch."""
        return np.array(list(solid_geoms(self.robot)))

    @cached_property
    def body_distances(self) -> Floats:
        """(T, B, L) distances of links from the bodies around, at most `TOUCH_REACH` [m]."""
        scene, qpos = self.trajectory.scene, self.trajectory.qpos
        assert scene is not None
        distances = RobotAmongBodies(self.robot, scene).along(qpos, scene.poses(len(qpos)), TOUCH_REACH)
        return distances.reshape(len(qpos), len(scene), -1)

    @cached_property
    def angles(self) -> Floats:
        """(T, n) of the hinges [rad]."""
        return self.trajectory.qpos[:, self.robot.qpos_index]

    @cached_property
    def speeds(self) -> Floats:
        """(T − 1, n) of the hinges from each frame to the next [rad/s]."""
        return np.abs(joint_velocities(self.trajectory, self.robot))

    @cached_property
    def jerk(self) -> float | None:
        """Root mean square over hinges and frames [rad/s³]; None below four frames."""
        third = np.diff(self.angles, 3, axis=0)
        return float(np.sqrt((third**2).mean()) * self.fps**3) if third.size else None

    @cached_property
    def depth(self) -> Floats:
        """(T,) the deepest overlap of the robot with itself [m]."""
        contacts, deepest = replay_contacts(self.robot, self.trajectory.qpos), np.zeros(len(self))
        np.maximum.at(deepest, contacts.frame, contacts.depth)
        return deepest

    @cached_property
    def feet(self) -> tuple[Foot, ...]:
        """How each foot moves; empty for a robot without recognised feet."""
        return tuple(foot_of(self.robot, sole, self.trajectory.qpos, self.fps) for sole in self.soles)

    @cached_property
    def lowest(self) -> Floats:
        """(T,) height of the lowest sole point of both feet [m]."""
        return np.min([foot.lowest for foot in self.feet], axis=0)

    @cached_property
    def slip(self) -> Floats:
        """(T, 2) speed along the floor of each foot's slowest sole point, 0 at the first frame [m/s]."""
        return np.stack([foot.slip for foot in self.feet], axis=1)

    @cached_property
    def planted(self) -> Bools | None:
        """(T, 2) whether each foot of the human stands, but at the first frame, which has no speed; None without feet."""
        contacts = self.pair.contacts
        if contacts is None or contacts.feet != SIDES:
            return None
        planted = contacts.planted
        planted[0] = False
        return planted

    @cached_property
    def contacts(self) -> ContactRecord:
        """Which feet of the robot are on the ground."""
        return contacts_of(self.trajectory, self.robot, self.anatomy)

    @property
    def root(self) -> Floats:
        """(T, 3) place of the free root [m]."""
        first = self.robot.root_address
        return self.trajectory.qpos[:, first : first + 3]

    @cached_property
    def floor_level(self) -> float:
        """Height of the lowest sole point where the clip stands: its 5th percentile [m]."""
        return float(np.percentile(self.lowest, 5))

    @cached_property
    def forces(self) -> Floats:
        """(T, nv) generalised forces in addition to the floor's (`robot.dynamics.required_forces`) [N, N m]."""
        soles = feet_of(self.robot).corners
        qpos = self.trajectory.qpos
        return required_forces(self.robot, qpos, self.fps, soles, SMOOTH, ~self.contacts.flying & bool(len(soles)))

    def floor_of(self, pose: Floats) -> float:
        """Height of the lowest sole point in a pose (1, nq) [m]."""
        return float(min(world_points(self.robot, sole, pose)[..., 2].min() for sole in self.soles))

    @cached_property
    def standing_height(self) -> float:
        """Height of the root over the lowest sole point in the reference pose [m]."""
        pose = self.robot.neutral()[None]
        floor = self.floor_of(pose) if self.soles else 0.0
        return max(float(pose[0, self.robot.root_address + 2]) - floor, 1e-6)

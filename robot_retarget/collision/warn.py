"""Self-collisions flagged before they happen, by the interaction distance of the links' surfaces.

Every frame, every pair of links that may touch: capsules and the closed form of `approach` give D and α. The few pairs
that could touch within the horizon are looked at again by `foresight`: MuJoCo's distance of their geoms along the path
of the joints. A pair is then in one of four states,

    contact      the geoms touch now,
    imminent     for `confirm` seconds running, an instant t ahead showed an overlap deeper than ½ doubt t² − margin
                 (or the very next step did); one look is enough where the stream has kept its pace (`pace`),
    approaching  an overlap, or surfaces nearer than `margin`, are foreseen within the horizon,
    clear        none of these,

and keeps the highest that any of the last `release` seconds called for, so that a warning does not flicker. A stretch
of imminent or contact is an event. States are looked at every 1/30 s, whatever the frame rate, and stand in between.
Everything at a frame depends on that frame and earlier ones only.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.collision.approach import Approach, CapsulePairs
from robot_retarget.collision.events import Event, events_of
from robot_retarget.collision.foresight import Foresight, Joints, changes, span_of, strides
from robot_retarget.collision.pace import TRUSTED, Pace
from robot_retarget.collision.states import State, Windows
from robot_retarget.dgp.interaction import Interaction
from robot_retarget.errors import TrajectoryError, UsageError
from robot_retarget.robot import Robot
from robot_retarget.robot.capsules import Capsules, fit_capsules
from robot_retarget.robot.clearance import Clearance, Marks, Pairs
from robot_retarget.robot.collidable import collidable
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.trajectory import Trajectory

APPROACHING, IMMINENT, CONTACT = (np.int8(state) for state in (State.APPROACHING, State.IMMINENT, State.CONTACT))
Judge = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class WarnOptions:
    """When a warning is raised, and how long it holds.

    Raises:
        UsageError: a negative or NaN option, or no horizon.
    """

    horizon: float = 0.5
    """How far ahead is looked [s]."""
    dead_band: float = 2e-4
    """Relative steps of 1/30 s up to this length are rest [m]: 6 mm/s, which covers 3 mm in the default horizon."""
    slack: float = 0.01
    """Pairs whose capsules come this near within the horizon are looked at by MuJoCo [m]."""
    margin: float = 0.008
    """Surfaces foreseen this near count as touching, when they are nearest [m]."""
    doubt: float = 0.45
    """Unforeseen acceleration allowed for [m/s²]: an overlap t ahead counts once it is deeper than ½ doubt t² − margin."""
    confirm: float = 2 / 30
    """Time for which a contact must be foreseen before it is called imminent [s]."""
    release: float = 0.25
    """Time for which a state is kept after the last frame that called for it [s]."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < np.inf:
                raise UsageError(f"{name} must be finite and not negative, got {value}")
        if self.horizon == 0:
            raise UsageError("horizon must be above 0 s")


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What of a robot may touch what: fitted once, used for any number of trajectories."""

    robot: Robot
    capsules: Capsules
    pairs: Pairs

    @cached_property
    def capsule_pairs(self) -> CapsulePairs:
        """The capsules of every pair."""
        return CapsulePairs(self.capsules, self.pairs)

    @cached_property
    def names(self) -> list[tuple[str, str]]:
        """The links of every pair."""
        return self.pairs.names(self.robot)

    @property
    def fit_error(self) -> dict[str, float]:
        """By link name, how far its capsules reach beyond its geoms, in the worst direction [m]."""
        return {self.robot.model.body(link).name: round(x, 4) for link, x in self.capsules.excess.items()}


def surfaces(robot: Robot) -> Surfaces:
    """Fit capsules to a robot and list the pairs of links that may touch."""
    return Surfaces(robot, fit_capsules(robot), collidable(robot))


@dataclass(frozen=True, eq=False)
class Warnings:
    """T frames (one, when streaming) of P pairs of links."""

    pairs: list[tuple[str, str]]
    """P pairs of links by name."""
    fps: float
    distance: Floats
    """(T, P) between the links' capsules now [m]."""
    ahead: Floats
    """(T, P) the interaction distance D of their capsules [m]."""
    alpha: Ints
    """(T, P) α: D is reached α − 1 steps of 1/30 s from now."""
    state: np.ndarray
    """(T, P) `State`."""
    time_to_contact: Floats
    """(T, P) [s]; 0 in contact, infinite where none is foreseen."""
    depth: Floats
    """(T, P) overlap foreseen within the horizon [m]."""
    touching: np.ndarray
    """(T, P) whether the geoms touch now."""

    def __len__(self) -> int:
        return len(self.state)

    @property
    def flagged(self) -> np.ndarray:
        """(T, P) whether a contact is imminent or there."""
        return self.state >= State.IMMINENT

    @cached_property
    def events(self) -> list[Event]:
        """Every warning with what came of it, in order of time."""
        return events_of(self.pairs, self.flagged, self.touching, self.time_to_contact, self.depth, self.fps)


def warnings_of(
    trajectory: Trajectory, robot: Robot, options: WarnOptions | None = None, known: Surfaces | None = None
) -> Warnings:
    """Flag the self-collisions of a whole trajectory ahead of time, as if it came frame by frame.

    Args:
        known: the robot's surfaces, where they are at hand (`surfaces`).

    Raises:
        TrajectoryError: it belongs to another robot, or has a single frame.
    """
    require_same_robot(trajectory, robot)
    if len(trajectory) < 2:
        raise TrajectoryError("warnings need two frames: a step is the way from one frame to the next; got 1")
    eye = Eye(known or surfaces(robot), trajectory.fps, options or WarnOptions())
    qpos = eye.joints.pinned(trajectory.qpos)
    ends, steps = eye.ends.along(qpos), strides(qpos, eye.span)
    near = eye.known.capsule_pairs.approach(ends, strides(ends, eye.span), eye.interaction)
    looks = np.arange(0, len(qpos), eye.span)
    seen = eye.look(near.at(looks), qpos[looks], steps[looks], changes(steps, eye.span)[looks], eye.windows.all)
    return eye.warnings(near, seen, np.arange(len(qpos)))


class Warner:
    """Warnings of a stream: give every configuration as it comes."""

    def __init__(self, robot: Robot, fps: float, options: WarnOptions | None = None, known: Surfaces | None = None):
        """Fit the robot's surfaces, unless they are `known`.

        Raises:
            UsageError: fps is not positive.
        """
        if not (np.isfinite(fps) and fps > 0):
            raise UsageError(f"frames per second must be positive, got {fps}")
        self.robot = robot
        self.eye = Eye(known or surfaces(robot), float(fps), options or WarnOptions())
        self._past: deque[Floats] = deque(maxlen=self.eye.span + 1)
        self._ends: deque[Floats] = deque(maxlen=self.eye.span + 1)
        self._step: Floats | None = None
        self._count = 0
        self._seen: Seen | None = None

    def update(self, qpos: Floats) -> Warnings:
        """What is to be said of this configuration (nq,), knowing those before.

        Raises:
            TrajectoryError: it has another length, or a value that is not finite.
        """
        nq = self.robot.model.nq
        if np.shape(qpos) != (nq,) or not np.isfinite(qpos).all():
            raise TrajectoryError(f"a configuration of {self.robot.name!r} is {nq} finite numbers")
        eye, still = self.eye, self.eye.joints.pinned(np.asarray(qpos, dtype=float)[None])
        ends = eye.ends.along(still)
        self._past.append(still)
        self._ends.append(ends)
        share = eye.span / max(len(self._ends) - 1, 1)
        near = eye.known.capsule_pairs.approach(ends, (ends - self._ends[0]) * share, eye.interaction)
        since = self._count % eye.span
        if self._seen is None or since == 0:
            step = (still - self._past[0]) * share
            changed = step - self._step if self._step is not None and self._count > eye.span else np.zeros_like(step)
            self._seen, self._step = eye.look(near, still, step, changed, eye.windows.next), step
        self._count += 1
        return eye.warnings(near, self._seen, np.array([since]))


@dataclass(frozen=True, eq=False)
class Seen:
    """What L looks made of P pairs, (L, P) each; the fields are those of `Warnings`."""

    state: np.ndarray
    time_to_contact: Floats
    depth: Floats
    touching: np.ndarray


class Eye:
    """What both ways of watching share: one robot, one frame rate, one set of options.

    It looks once in every step, so that other frame rates see the same.
    """

    def __init__(self, known: Surfaces, fps: float, options: WarnOptions):
        self.known, self.fps, self.options = known, fps, options
        self.span = span_of(fps)
        step = self.span / fps
        self.interaction = Interaction(options.horizon / step, options.dead_band)
        self.joints = Joints(known.robot)
        self.ends = Marks(known.robot, known.capsules.points)
        self.clearance = Clearance(known.robot, known.pairs)
        self.foresight = Foresight(self.joints, self.clearance, options.horizon, step, options.margin, options.doubt)
        self.pace = Pace(self.foresight.k, step)
        self.windows = Windows(round(options.confirm / step) + 1, round(options.release / step) + 1)

    def look(self, near: Approach, qpos: Floats, steps: Floats, changed: Floats, judge: Judge) -> Seen:
        """States at L looks, from configurations (L, nq), their steps and changes of step."""
        looks, pairs = np.nonzero(near.ahead <= self.options.slack)
        gains, trusted = self._gains(qpos, steps, changed)
        paths, bounds = self.joints.paths(qpos, steps, changed, gains), np.searchsorted(looks, np.arange(len(qpos) + 1))
        distances, rough = [np.zeros((paths.shape[1], 0))], near.distance[looks, pairs]
        drop = rough - near.ahead[looks, pairs]
        for path, first, last in zip(paths, bounds.tolist(), bounds[1:].tolist(), strict=False):
            if first < last:
                distances.append(self.foresight.look(path, pairs[first:last], rough[first:last], drop[first:last]))
        seen = self.foresight.outlook(np.concatenate(distances, axis=1))

        def spread(values: np.ndarray) -> np.ndarray:
            full = np.zeros(near.ahead.shape, dtype=values.dtype)
            full[looks, pairs] = values
            return full

        foreseen, touching = seen.sure > 0, seen.distance <= 0
        called = np.isfinite(seen.contact) * APPROACHING
        called[(seen.next <= self.options.margin / 2) | (foreseen & trusted[looks])] = IMMINENT
        called[touching] = CONTACT
        state, contact = judge(spread(foreseen), spread(called)), np.full(near.ahead.shape, np.inf)
        contact[looks, pairs] = seen.contact
        return Seen(state, contact, spread(seen.depth), spread(touching))

    def _gains(self, qpos: Floats, steps: Floats, changed: Floats) -> tuple[Floats, np.ndarray]:
        """(L, 2, 1 + K) gains now and at every instant, and (L,) whether the stream keeps its pace."""
        gains = np.zeros((len(qpos), 2, 1 + len(self.foresight.k)))
        trusted = np.zeros(len(qpos), dtype=bool)
        for t, (joints, step, change) in enumerate(zip(qpos, steps, changed, strict=True)):
            gains[t, :, 1:] = self.pace.next(joints, step, change)  # a free root, pinned, adds no error
            trusted[t] = self.pace.trust >= TRUSTED
        return gains, trusted

    def warnings(self, near: Approach, seen: Seen, frames: Ints) -> Warnings:
        """What was seen, said at frames counted from the first look; the time to contact runs on between looks."""
        names, fields = self.known.names, (near.distance, near.ahead, near.alpha)
        if self.span == 1:
            return Warnings(names, self.fps, *fields, seen.state, seen.time_to_contact, seen.depth, seen.touching)
        look, since = frames // self.span, (frames % self.span) / self.fps
        contact = np.maximum(seen.time_to_contact[look] - since[:, None], 0.0)
        return Warnings(names, self.fps, *fields, seen.state[look], contact, seen.depth[look], seen.touching[look])

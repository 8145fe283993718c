"""Collision warnings by the interaction distance [Mucherino2019] of the surfaces of links, and of links and bodies around.

A trajectory's own next frames are followed. In a stream, whose next frames are unknown, all joints continue with their last step v,
of 1/30 s, within their ranges. With d(q) the signed distance of two links
at a configuration q, the interaction distance over a horizon of H steps is

    D = min_{0 ≤ k ≤ H} d(q + k v),    α = 1 + the k of the minimum.

The minimum includes fractions of a step where a hinge turns by more than `robot.kinematics.CHECKED_TURN` in it. A pair is flagged while
D is at most the margin and the links approach, or when they overlap now or on the way since the previous step. A flag is held for the
release time, so that it does not flicker. A link and a body of a scene are flagged while the link is about to be deeper in
the body than a touch; bodies continue with their last step as well. A stretch of flagged frames is an event. In a stream, everything at
a frame depends on this frame and earlier ones only. Pairs are evaluated once in every step, so that the frame rate does not matter.
"""

import itertools
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base import files
from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.robot import Robot
from robot_retarget.robot.body_distances import RobotAmongBodies
from robot_retarget.robot.distances import LinkDistances
from robot_retarget.robot.kinematics import parts_between
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.scene.scene import Scene, extrapolated
from robot_retarget.trajectory import Trajectory

# Warnings as events: pair of links, time and outcome.

COLUMNS = ("link_a", "link_b", "first_warning", "predicted_contact", "contact", "lead_s", "depth_m", "last")


@dataclass(frozen=True)
class Event:
    """One interval of warning of one pair of links."""

    pair: tuple[str, str]
    first_warning: int
    """Frame in which the warning is raised."""
    predicted_contact: int
    """Frame of the predicted contact."""
    contact: int | None
    """First frame in which the geoms touch, or None."""
    lead_s: float
    """From the warning to the contact, or to the predicted one if no contact came [s]."""
    depth_m: float
    """Deepest predicted overlap [m]."""
    last: int
    """The last frame of the warning."""

    def contract(self) -> dict[str, Any]:
        """Return the event as JSON fields."""
        return {**asdict(self), "pair": list(self.pair)}


def events_of(
    pairs: Sequence[tuple[str, str]],
    flagged: np.ndarray,
    touching: np.ndarray,
    time_to_contact: Floats,
    depth: Floats,
    fps: float,
) -> list[Event]:
    """Return the intervals of flagged frames, in order of time; all arrays are (T, P).

    Args:
        pairs: P names of both links.
        flagged: (T, P) whether a warning is raised.
        touching: (T, P) whether links overlap.
        time_to_contact: (T, P) [s].
        depth: (T, P) predicted overlap [m].
        fps: frames per second [1/s].
    """
    edge = np.diff(flagged.astype(np.int8), axis=0, prepend=0, append=0)
    starts, stops = np.argwhere(edge.T == 1), np.argwhere(edge.T == -1)
    found = []
    for (pair, start), (_, stop) in zip(starts.tolist(), stops.tolist(), strict=True):
        hits = np.flatnonzero(touching[start:stop, pair])
        contact = start + int(hits[0]) if hits.size else None
        wait = float(time_to_contact[start, pair])
        predicted = start + round(wait * fps) if np.isfinite(wait) else start
        lead = ((predicted if contact is None else contact) - start) / fps
        deepest = float(depth[start:stop, pair].max())
        found.append(Event(pairs[pair], start, predicted, contact, round(lead, 4), round(deepest, 5), stop - 1))
    return sorted(found, key=lambda event: event.first_warning)


def figures_of(events: Sequence[Event], frames: int, fps: float) -> dict[str, Any]:
    """Return counts and the median lead of the events.

    Args:
        events: of a trajectory.
        frames: number of frames.
        fps: frames per second [1/s].
    """
    hits = [event for event in events if event.contact is not None]
    return {
        "frames": frames,
        "fps": fps,
        "events": len(events),
        "contacts": len(hits),
        "median_lead_s": round(float(np.median([event.lead_s for event in hits])), 4) if hits else None,
    }


def write_csv(events: Sequence[Event], path: str | Path) -> Path:
    """Write the events as a table, whole or not at all.

    Args:
        events: of a trajectory.
        path: of the file.

    Raises:
        OutputError: it cannot be written.
    """
    rows = ((*e.pair, e.first_warning, e.predicted_contact, e.contact, e.lead_s, e.depth_m, e.last) for e in events)
    return files.write_csv(path, COLUMNS, rows)


PLANNED = 0.1
"""Horizon along known frames [s]: the time in which a person or a guard stops a robot; recall and precision stay 1.0
(`benchmarks/warnings.md`)."""
STEP = 1 / 30
"""Duration of a step [s]: whole frames, at least one; 1/30 s is a frame of a usual motion file."""


class State(IntEnum):
    """State of a pair of links."""

    CLEAR = 0
    APPROACHING = 1
    IMMINENT = 2
    CONTACT = 3


@dataclass(frozen=True)
class WarnOptions:
    """When a warning is raised, and how long it is held.

    Raises:
        UsageError: a negative or NaN option, or no horizon.
    """

    horizon: float = STEP
    """How far ahead to look [s]. Of the last step, one serves captured motion and 0.2 s warns of smooth machine motion earlier."""
    margin: float = 0.008
    """Interaction distance at which a pair is flagged [m]: in fast motions of the G1 it gives a recall of 0.94 and a
    precision of 0.86, 12 mm 0.96 and 0.77 (`benchmarks/warnings.md`)."""
    dead_band: float = 5e-4
    """Links that come nearer by less do not approach [m]: jitter of captured joints. Of a boxing OP3 half gives 42 and
    double 36 events in place of 37, of two clips on the G1 one fewer at most."""
    release: float = 0.25
    """Time for which a flag is held after the last frame that raised it [s]: half and double flag 271 and 677 in place
    of 424 frames of a boxing OP3, in 39 and 36 events."""
    rest: float = 0.0011
    """A link that is no deeper in a body touches it [m]: the bound of the public comparison of retargeters."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < np.inf:
                raise UsageError(f"{name} must be finite and not negative, got {value}")
        if self.horizon == 0:
            raise UsageError("horizon must be above 0 s")


@dataclass(frozen=True, eq=False)
class Warnings:
    """T frames (one, when streaming) of P pairs of links."""

    pairs: list[tuple[str, str]]
    """P pairs of links by name."""
    fps: float
    distance: Floats
    """(T, P) now [m], negative where links overlap; at most the reach of `LinkDistances`."""
    ahead: Floats
    """(T, P) interaction distance D [m]."""
    alpha: Floats
    """(T, P) α: D is reached α − 1 steps of 1/30 s from now."""
    swept: Floats
    """(T, P) least distance since the previous step [m], now included."""
    flagged: Bools
    """(T, P) whether a warning is raised or held."""
    closing: Bools
    """(T, P) whether the links approach."""
    time_to_contact: Floats
    """(T, P) [s]; 0 in contact, infinite where no contact is predicted."""
    reach: float
    """Largest distance that is measured [m]."""
    touch: Floats | float = 0.0
    """(P,) or a scalar, distance at which a pair is in contact [m]: 0 of links, below 0 of a link and a body."""

    def __repr__(self) -> str:
        return f"<Warnings: {len(self.pairs)} pairs over {len(self)} frames, {int(self.flagged.any(axis=0).sum())} flagged>"

    def __len__(self) -> int:
        return len(self.flagged)

    @property
    def touching(self) -> Bools:
        """(T, P) whether the pairs are in contact now, or were since the previous step."""
        return self.swept <= self.touch

    @property
    def state(self) -> np.ndarray:
        """(T, P) `State`."""
        state = np.where(self.flagged, State.IMMINENT, np.where(self.closing, State.APPROACHING, State.CLEAR))
        return np.where(self.touching, State.CONTACT, state).astype(np.int8)

    @cached_property
    def events(self) -> list[Event]:
        """All warnings with their outcome, in order of time."""
        depth = np.maximum(-self.ahead, 0.0)
        return events_of(self.pairs, self.flagged, self.touching, self.time_to_contact, depth, self.fps)


def warnings_of(
    trajectory: Trajectory,
    robot: Robot,
    options: WarnOptions | None = None,
    links: LinkDistances | None = None,
    *,
    planned: bool = True,
) -> Warnings:
    """Return the warnings of a whole trajectory.

    Args:
        trajectory: of the robot.
        robot: the robot.
        options: by default with a horizon of `PLANNED` along the trajectory's frames, and of one step without them.
        links: distances of the robot, if they are compiled already.
        planned: take the next frames of the trajectory over the horizon. Otherwise joints continue with their last step, as in a
            stream, whose next frames are unknown.

    Raises:
        TrajectoryError: it belongs to another robot, or has a single frame.
    """
    require_same_robot(trajectory, robot)
    if len(trajectory) < 2:
        raise TrajectoryError("warnings need two frames: a step is the way from one frame to the next; got 1")
    options = options or WarnOptions(horizon=PLANNED if planned else STEP)
    warner = Warner(robot, trajectory.fps, options, links, trajectory.scene)
    around = itertools.repeat(None) if trajectory.scene is None else trajectory.scene.poses(len(trajectory))
    reach = warner.steps * warner.span if planned else 0
    frames = [
        warner.update(qpos, poses, trajectory.qpos[t + 1 : t + 1 + reach])
        for t, (qpos, poses) in enumerate(zip(trajectory.qpos, around, strict=False))
    ]
    columns = ("distance", "ahead", "alpha", "swept", "flagged", "closing", "time_to_contact")
    joined = {name: np.concatenate([getattr(frame, name) for frame in frames]) for name in columns}
    return replace(frames[0], **joined)


class Warner:
    """Causal warnings of a stream."""

    robot: Robot
    fps: float
    options: WarnOptions

    def __init__(
        self,
        robot: Robot,
        fps: float,
        options: WarnOptions | None = None,
        links: LinkDistances | None = None,
        scene: Scene | None = None,
    ):
        """Compile the distances of the robot, unless `links` are given, and of the bodies of a scene.

        Raises:
            UsageError: fps is not positive.
        """
        if not (np.isfinite(fps) and fps > 0):
            raise UsageError(f"frames per second must be positive, got {fps}")
        self.robot, self.fps, self.options = robot, float(fps), options or WarnOptions()
        self.links: LinkDistances = links or LinkDistances(robot)
        self.bodies: RobotAmongBodies | None = None if scene is None else RobotAmongBodies(robot, scene)
        own, among = len(self.links), 0 if self.bodies is None else len(self.bodies.names)
        self.pairs: list[tuple[str, str]] = self.links.names + ([] if self.bodies is None else self.bodies.names)
        self._margin: Floats = np.repeat([self.options.margin, -self.options.rest], [own, among])
        self._touch: Floats = np.repeat([0.0, -self.options.rest], [own, among])
        self.span: int = max(1, round(STEP * fps))
        self.step: float = self.span / fps
        """Duration of a step [s]."""
        self.steps: int = max(1, round(self.options.horizon / self.step))
        self._past: deque[tuple[Floats, Floats | None]] = deque(maxlen=self.span + 1)
        self._held = np.zeros(own + among, dtype=int)
        """Number of steps for which each flag is still held."""
        self._planned: Floats = np.empty((0, robot.model.nq))
        self._count = 0
        self._last: Warnings | None = None

    def update(self, qpos: Floats, poses: Floats | None = None, planned: Floats | None = None) -> Warnings:
        """Return the warnings at the next configuration (nq,).

        Args:
            qpos: (nq,).
            poses: (B, 7) of the bodies of the scene, in the world of the robot; none without a scene.
            planned: (N, nq) next frames, if they are known; joints continue with their last step after them.

        Raises:
            TrajectoryError: it has another length, or a value that is not finite, or there are no poses for the scene.
        """
        if (self.bodies is None) != (poses is None):
            raise TrajectoryError("poses of bodies belong to the scene of the warnings: give both, or none")
        nq = self.robot.model.nq
        if np.shape(qpos) != (nq,) or not np.isfinite(qpos).all():
            raise TrajectoryError(f"a configuration of {self.robot.name!r} is {nq} finite numbers")
        self._past.append((np.array(qpos, dtype=float), poses))
        self._planned = np.empty((0, nq)) if planned is None else np.asarray(planned, dtype=float)
        since, self._count = self._count % self.span, self._count + 1
        if since == 0 or self._last is None:
            self._last = self._evaluated()
        contact = np.maximum(self._last.time_to_contact - since / self.fps, 0.0)
        return replace(self._last, time_to_contact=contact)

    def _evaluated(self) -> Warnings:
        """Return the warnings of the present frame; other frame rates evaluate the same frames."""
        parts = int(parts_between(self.robot, self._past[0][0], self._past[-1][0]))
        along = self._distances(np.arange(1 - parts, self.steps * parts + 1) / parts)
        swept, along = along[:parts].min(axis=0), along[parts - 1 :]
        now, ahead, alpha = along[0], along.min(axis=0), 1 + along.argmin(axis=0) / parts
        closing = ahead < now - self.options.dead_band
        near = closing & (ahead <= self._margin)
        release = round(self.options.release / self.step) + 1
        self._held = np.where(near | (swept <= self._touch), release, np.maximum(self._held - 1, 0))
        contact = _time_to_zero(along - self._touch, self.step / parts, np.where(near, (alpha - 1) * self.step, np.inf))
        fields = {"distance": now, "ahead": ahead, "alpha": alpha, "swept": swept, "closing": closing}
        rows: dict[str, Any] = {name: values[None] for name, values in (fields | {"time_to_contact": contact}).items()}
        flagged, reach = self._held[None] > 0, self.links.reach
        return Warnings(self.pairs, self.fps, flagged=flagged, reach=reach, touch=self._touch, **rows)

    def _distances(self, k: Floats) -> Floats:
        """Return the distances (N, P) of all pairs k steps (N,) from now, along the last step."""
        path, before, now = self._path(k), self._past[0][1], self._past[-1][1]
        along = self.links.along(path)
        if self.bodies is None or before is None or now is None:
            return along
        return np.hstack([along, self.bodies.along(path, extrapolated(before, now, k), self.links.reach)])

    def _path(self, k: Floats) -> Floats:
        """Return the configurations (N, nq) k steps (N,) from now: along the planned frames, then along the last step."""
        now = self._past[-1][0]
        path = now + k[:, None] * (now - self._past[0][0])
        known = np.vstack([now, self._planned])
        at = k * self.span
        inside = (at > 0) & (at <= len(known) - 1)
        before = np.floor(at[inside]).astype(int)
        after, share = np.minimum(before + 1, len(known) - 1), (at[inside] - before)[:, None]
        path[inside] = (1 - share) * known[before] + share * known[after]
        beyond = at > max(len(known) - 1, 0)
        if len(known) > 1:
            path[beyond] = (
                known[-1] + (k[beyond, None] - (len(known) - 1) / self.span) * (known[-1] - known[-2]) * self.span
            )
        columns, robot = self.robot.qpos_index, self.robot
        low, high = np.minimum(robot.lower, now[columns]), np.maximum(robot.upper, now[columns])
        path[:, columns] = np.clip(path[:, columns], low, high)
        return path


def _time_to_zero(along: Floats, interval: float, otherwise: Floats) -> Floats:
    """Return the times at which distances (N, P), one every interval [s], first reach zero [s], else `otherwise`."""
    after = (along <= 0).argmax(axis=0)
    pairs = np.flatnonzero((along <= 0).any(axis=0))
    time = otherwise.copy()
    k = after[pairs]
    outer, inner = along[np.maximum(k - 1, 0), pairs], along[k, pairs]
    time[pairs] = np.where(k > 0, (k - 1 + outer / np.maximum(outer - inner, 1e-12)) * interval, 0.0)
    return time

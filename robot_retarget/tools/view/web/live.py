"""The latest pose of a robot, its performer and the bodies around it, for a served page."""

import json
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from threading import Condition, Event, Thread
from time import monotonic, perf_counter
from typing import Any

import numpy as np
from anyio.to_thread import run_sync
from scipy.interpolate import interp1d
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import OutputError, UsageError
from robot_retarget.human.motion import Motion
from robot_retarget.human.readers.bvh import write_bvh
from robot_retarget.human.surroundings import first_frame
from robot_retarget.live.frame import Frame
from robot_retarget.live.loop import LivePose, Loop
from robot_retarget.robot.model import Robot
from robot_retarget.robot.timing import sample
from robot_retarget.scene.scene import Scene
from robot_retarget.tools.view.staging import SKIN, height_of
from robot_retarget.tools.view.web.serve import message_of
from robot_retarget.tools.view.web.shapes import shapes_of, shapes_of_scene
from robot_retarget.tools.view.web.show import SCALAR_LAST, poses, seen
from robot_retarget.tools.view.web.take import Take
from robot_retarget.tools.view.web.viewer import Viewer
from robot_retarget.trajectory import Trajectory

RECENT = 60
"""Number of frames for the rate and the latency."""
LOST = 1.0
"""Least time between two writings of a take [s], by definition."""
REWRITTEN = 20
"""A take is written again once this many times the time of the last writing have passed [-]: by definition it costs a twentieth of one processor."""


class Recording:
    """A take that is being recorded.

    Its file is written again every `LOST`, and less often once a writing takes longer than `LOST` / `REWRITTEN`. A killed stream
    loses the part since the last writing.

    Args:
        robot: the recorded robot.
        folder: the folder of `take_N.npz`, with the least free number.
    """

    def __init__(self, robot: Robot, folder: Path) -> None:
        self.path: Path = next(path for n in count(1) if not (path := folder / f"take_{n}.npz").exists())
        self._robot, self._poses = robot, list[tuple[float, Floats]]()
        self._frames = list[Frame]()
        self._stop, self._writer = Event(), Thread(target=self._write, daemon=True)
        self._writer.start()

    def add(self, qpos: Floats, frame: Frame | None = None) -> None:
        """Add a pose (nq,) at the present time, and its frame of the performer; frames of another skeleton are left out."""
        self._poses.append((monotonic(), np.array(qpos)))
        if frame is not None and (not self._frames or frame.skeleton is self._frames[-1].skeleton):
            self._frames.append(frame)

    @property
    def length(self) -> float:
        """Time from the first pose to the last [s]."""
        return round(self._poses[-1][0] - self._poses[0][0], 2) if len(self._poses) > 1 else 0.0

    def end(self) -> float:
        """Write the whole take; return its length [s].

        Raises:
            UsageError: the take has fewer than two poses.
            OutputError: a file cannot be written.
        """
        self._stop.set()
        self._writer.join()
        if not self.length:
            raise UsageError("no pose came while the take was recorded")
        self._save()
        if len(self._frames) > 1:
            write_bvh(self._performance(), self.motion)
        return self.length

    @property
    def motion(self) -> Path:
        """Path of the performer's motion; `end` writes it from two frames on."""
        return self.path.with_suffix(".bvh")

    def _performance(self) -> Motion:
        """Return the performer's joints at an even rate, by linear interpolation."""
        times = np.array([frame.arrived for frame in self._frames])
        joints = np.array([frame.positions for frame in self._frames])
        fps = round((len(times) - 1) / (times[-1] - times[0]), 3)
        even = interp1d(times - times[0], joints, axis=0)(np.arange(int((times[-1] - times[0]) * fps) + 1) / fps)
        return Motion(self._frames[0].skeleton, even, None, fps, source=self.motion.name)

    def _write(self) -> None:
        pause = LOST
        while not self._stop.wait(pause):
            began = perf_counter()
            with suppress(OutputError):  # `end` raises it
                self._save()
            pause = max(LOST, REWRITTEN * (perf_counter() - began))

    def _save(self) -> None:
        """Write the poses so far, at an even rate."""
        poses = self._poses[:]
        length = poses[-1][0] - poses[0][0] if len(poses) > 1 else 0.0
        if not length:
            return
        times, qpos = np.array([time for time, _ in poses]), np.array([pose for _, pose in poses])
        fps = float(np.clip(round((len(poses) - 1) / length), 1, 1000))
        names = self._robot.joint_names, self._robot.name
        numbered = Trajectory(qpos, 1.0, *names, source="live")
        at = np.interp(np.arange(int(length * fps) + 1) / fps, times - times[0], np.arange(len(poses)))
        Trajectory(sample(numbered, self._robot, at), fps, *names, source="live").save(self.path)


class LiveRobot:
    """The latest pose, shared with waiting pages. Older poses are dropped; those of a take are kept."""

    def __init__(
        self, robot: Robot, scene: Scene | None = None, facts: Callable[[], dict[str, Any]] = dict, takes: Path = Path()
    ) -> None:
        """Start with a standing robot.

        Args:
            robot: the robot of the stream.
            scene: the bodies around it.
            facts: figures of the stream for the page.
            takes: the folder of recorded takes.
        """
        self.robot, self._shapes, self._facts, self._folder = robot, shapes_of(robot), facts, takes
        around = None if scene is None else first_frame(scene)
        drawn = () if around is None else seen(shapes_of_scene(around))
        self._names = [around.names[body] for body in drawn] if around is not None else []
        self._count, self._pose = 0, b""
        self._changed = Condition()
        self._take: Recording | None = None
        still = Trajectory(robot.standing()[None], 1.0, robot.joint_names, robot.name, source="live", scene=around)
        self.viewer: Viewer = Viewer((Take(robot, still),))

    def show(
        self,
        qpos: Floats,
        bodies: Mapping[str, Floats] | None = None,
        size: float = 1.0,
        human: Floats | None = None,
        frame: Frame | None = None,
    ) -> None:
        """Show a pose.

        Args:
            qpos: (nq,) of the robot.
            bodies: (7,) poses of the bodies around it by name.
            size: size of the bodies over their captured size [-].
            human: (J, 3) joints of the performer, scaled to the robot, from the point of the floor under their middle [m].
            frame: the performer's frame, for a take.
        """
        rows: dict[str, Any] = {"robot": np.round(poses(self.robot, qpos[None], self._shapes), 4).ravel().tolist()}
        if bodies:
            around = np.array([bodies[name] for name in self._names]).reshape(-1, 7)[:, SCALAR_LAST]
            rows |= {"bodies": np.round(around, 4).ravel().tolist(), "size": size}
        if human is not None:
            rows["human"] = np.round(human, 4).ravel().tolist()
        with self._changed:
            self._count, self._pose = self._count + 1, json.dumps(rows).encode()
            if self._take is not None:
                self._take.add(qpos, frame)
            self._changed.notify_all()

    def next(self, seen: int, timeout: float) -> tuple[int, bytes] | None:
        """Wait for a pose with another number than `seen`; return its number and its JSON, or None after the timeout [s]."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._count != seen, timeout):
                return None
            return self._count, self._pose

    def state(self) -> dict[str, Any]:
        """Return the facts of the stream, and the length of the present take [s]."""
        with self._changed:
            recording = None if self._take is None else self._take.length
        return self._facts() | {"recording": recording}

    def record(self) -> dict[str, Any]:
        """Start a take, or end the present one; return its files and its length [s] (`Recording`).

        Raises:
            UsageError: the take has fewer than two poses.
            OutputError: a file cannot be written.
        """
        with self._changed:
            take, self._take = self._take, None if self._take is not None else Recording(self.robot, self._folder)
        if take is None:
            return {"recording": 0.0}
        seconds, motion = take.end(), take.motion
        return {"wrote": str(take.path), "seconds": seconds, "motion": str(motion) if motion.exists() else None}

    def end(self) -> dict[str, Any]:
        """End a take of two poses or more, as `record` does; return an empty table without one."""
        return self.record() if self._take is not None and self._take.length else {}


STATE = 0.5
"""Interval of the state of a stream [s]."""


def live_routes(following: LiveRobot, taken: Callable[[dict[str, Any]], dict[str, Any]]) -> list[BaseRoute]:
    """Return the routes of poses, as server-sent events until the page is closed, and of recorded takes.

    Args:
        following: the robot of the stream.
        taken: returns the answer to the page, from the table of `LiveRobot.record`.
    """

    async def events() -> AsyncIterator[bytes]:
        count, said = 0, float("-inf")
        while True:
            count, pose = await run_sync(following.next, count, STATE) or (count, b"")
            if pose:
                yield b"data: " + pose + b"\n\n"
            if monotonic() - said >= STATE:
                said = monotonic()
                yield b"event: state\ndata: " + json.dumps(following.state()).encode() + b"\n\n"

    async def live(request: Request) -> Response:
        return StreamingResponse(events(), media_type="text/event-stream")

    async def record(request: Request) -> Response:
        await message_of(request)
        return JSONResponse(await run_sync(lambda: taken(following.record())))

    return [Route("/live", live), Route("/record", record, methods=["POST"])]


class PageSink:
    """Shows a stream on a page; the page's server takes `robot`."""

    def __init__(self, robot: Robot, scene: Scene | None = None, source: str = "") -> None:
        """Start with a standing robot; `source` describes the source of the frames in words."""
        self.robot: LiveRobot = LiveRobot(robot, scene, self._facts)
        self._loop: Loop | None = None
        self._source, self._height, self._frames = source, height_of(robot), deque[float](maxlen=RECENT)
        self._performer: tuple[Any, float] | None = None

    def follow(self, loop: Loop) -> None:
        """Show the performer and the state of a loop as well."""
        self._loop = loop

    def show(self, pose: LivePose) -> None:
        frame = self._loop.last if self._loop is not None else None
        new = frame if self._loop is not None and not self._loop.resting else None
        if new is not None:
            self._frames.append(new.arrived)
        self.robot.show(pose.qpos, pose.bodies, pose.size, None if frame is None else self._scaled(frame), new)

    def _scaled(self, frame: Frame) -> Floats:
        """Return (J, 3) the performer's joints [m]; their largest extent is the robot's height, and the lowest is `SKIN` of it above the floor."""
        points = frame.positions
        if self._performer is None or self._performer[0] is not frame.skeleton:
            extent = float(np.linalg.norm(points[:, None] - points, axis=-1).max())
            self._performer = frame.skeleton, self._height / max(extent, 1e-6)
        middle = np.array([*points[:, :2].mean(axis=0), points[:, 2].min()])
        return (points - middle) * self._performer[1] + [0.0, 0.0, SKIN * self._height]

    def _facts(self) -> dict[str, Any]:
        """Return state, address, rate, latency and faults of the stream, and the performer's bones."""
        loop, frames = self._loop, [*self._frames]
        facts: dict[str, Any] = {"state": "waiting for a performer", "source": self._source}
        if loop is None or loop.last is None:
            return facts
        moving = len(frames) > 1 and monotonic() - frames[-1] < 1.0
        rate = (len(frames) - 1) / max(frames[-1] - frames[0], 1e-6) if moving else 0.0
        latencies = [*loop.stats.latencies][-RECENT:]
        calibrated = getattr(loop.stream, "calibration", None) is not None
        following = "following" if calibrated else "measuring the performer: stand upright for a second"
        parents = loop.last.skeleton.parents
        return facts | {
            "state": "no frames: the robot rests" if loop.resting else following,
            "rate": round(rate, 1),
            "latency_ms": round(1000 * float(np.median(latencies)), 1) if latencies else None,
            "faults": {**loop.source.faults.counts, **getattr(loop.stream, "faults", {})},
            "bones": [[int(parent), joint] for joint, parent in enumerate(parents) if parent >= 0],
        }

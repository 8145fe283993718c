"""Headsets as sources: their programs are polled for the newest body. PICO through XRoboToolkit, others through Isaac Teleop."""

import importlib
import time
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.human.readers.headset import JOINTS, NANOSECOND, HeldBody
from robot_retarget.live.frame import Fault, FaultCounter, Frame, RefusedError, SenderClock

POLL = 1e-3
"""Pause between two questions [s]; a frame is 1 ms later at most."""
INTERVAL = 1 / 90
"""Between two updates of an OpenXR session [s]: the fastest body trackers send 90 a second."""


class TrackedBody(NamedTuple):
    """A body as a headset hands it over."""

    poses: Floats
    """(24, 7) x y z [m] and quaternion x y z w in OpenXR's axes."""
    tracked: Bools
    """(24,)."""
    stamp: float | None
    """On the headset's clock [s]; None where it gives none."""


class HeadsetSource:
    """Frames of a headset; joints that are not tracked are held in their parents."""

    faults: FaultCounter
    dropped = 0
    ended = False

    def __init__(self, headset: "XrtHeadset | IsaacHeadset", faults: FaultCounter) -> None:
        self._headset, self.faults = headset, faults
        self._body, self._clock = HeldBody(), SenderClock(faults)
        self.skeleton = self._body.skeleton

    def newest(self, timeout: float) -> Frame | None:
        until = time.monotonic() + timeout
        while True:
            body, now = self._headset.ask(), time.monotonic()
            if body is not None:
                try:
                    return self._frame(body, now)
                except RefusedError as error:
                    self.faults.refused(error)
            if now >= until:
                return None
            time.sleep(min(POLL, until - now))

    def _frame(self, body: TrackedBody, arrived: float) -> Frame:
        if np.shape(body.poses) != (JOINTS, 7) or np.shape(body.tracked) != (JOINTS,):
            shapes = f"{np.shape(body.poses)} and {np.shape(body.tracked)}"
            raise RefusedError(Fault.MALFORMED, f"a body of {shapes}, expected ({JOINTS}, 7) and ({JOINTS},)")
        held = self._body.step(body.poses, body.tracked)
        if held is None:
            raise RefusedError(Fault.NOT_TRACKED, "no pelvis")
        if not body.tracked.all():
            lost = np.array(self.skeleton.names)[~body.tracked]
            self.faults.note(Fault.INCOMPLETE, f"{', '.join(lost[:4])} not tracked: held")
        return Frame(self.skeleton, arrived, arrived, *held).at(self._clock.time(body.stamp, arrived))

    def close(self) -> None:
        self._headset.close()


class XrtHeadset:
    """PICO's body from the XRoboToolkit PC Service on this machine.

    Raises:
        UsageError: `xrobotoolkit-sdk` is not installed.
    """

    def __init__(self) -> None:
        self._sdk = _installed("xrobotoolkit_sdk", "xrobotoolkit-sdk", "xrt")
        self._sdk.init()
        self._stamp = 0

    def ask(self) -> TrackedBody | None:
        stamp = self._sdk.get_body_timestamp_ns()
        if stamp == self._stamp or not self._sdk.is_body_data_available():
            return None
        self._stamp = stamp
        return TrackedBody(_numbers(self._sdk.get_body_joints_pose()), np.ones(JOINTS, dtype=bool), stamp * NANOSECOND)

    def close(self) -> None:
        self._sdk.close()


class IsaacHeadset:
    """The body of an Isaac Teleop session: live by default, or a session that replays a record.

    Raises:
        UsageError: `isaacteleop` is not installed, or its runtime does not run.
    """

    def __init__(self, session: Any = None, tracker: Any = None) -> None:
        self._open, self._asked, self._last = ExitStack(), 0.0, b""
        self._session, self._tracker = (session, tracker) if session is not None else self._live()

    def _live(self) -> tuple[Any, Any]:
        io, oxr = (_installed(f"isaacteleop.{part}", "isaacteleop", "isaac") for part in ("deviceio", "oxr"))
        tracker = io.FullBodyTracker()
        try:
            space = oxr.OpenXRSession("robot-retarget", io.DeviceIOSession.get_required_extensions([tracker]))
            handles = self._open.enter_context(space).get_handles()
            return self._open.enter_context(io.DeviceIOSession.run([tracker], handles)), tracker
        except RuntimeError as error:
            self._open.close()
            raise UsageError(f"--from isaac: {error}") from None

    def ask(self) -> TrackedBody | None:
        now = time.monotonic()
        if now - self._asked < INTERVAL:
            return None
        self._asked = now
        self._session.update()
        found = self._tracker.get_body_pose(self._session)
        if found is None:
            return None
        joints = found.joints
        places, turns = _numbers(joints.positions), _numbers(joints.orientations)
        if places.ndim != 2 or turns.ndim != 2 or len(places) != len(turns):
            return TrackedBody(np.zeros(0), np.zeros(0, dtype=bool), None)
        poses = np.concatenate([places, turns], axis=1)
        if poses.tobytes() == self._last:
            return None
        self._last = poses.tobytes()
        return TrackedBody(poses, np.array(joints.is_valid) != 0, None)

    def close(self) -> None:
        self._open.close()


def _numbers(values: Any) -> Floats:
    """Return values as an array of numbers; empty for other values."""
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        return np.zeros(0)


def _installed(module: str, package: str, source: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise UsageError(f"--from {source} needs {package}: pip install {package}") from None


HEADSETS: dict[str, type[XrtHeadset] | type[IsaacHeadset]] = {"xrt": XrtHeadset, "isaac": IsaacHeadset}
"""Headsets by the name of the source."""

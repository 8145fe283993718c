"""The server of the keyframe page. The page holds the keyframes; the server joins, drags, judges and saves them."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from threading import Lock
from typing import Any

import numpy as np

from robot_retarget.base.errors import UsageError
from robot_retarget.edit.keyframe_files import KeyframeFile
from robot_retarget.edit.keyframes import Keyframe, KeyframedMotion, dragged, trajectory_through
from robot_retarget.judge.report import Report
from robot_retarget.tools.view.web.editor import touch_routes
from robot_retarget.tools.view.web.serve import PORT, Served, serve
from robot_retarget.tools.view.web.shapes import keypoints_of, shapes_of
from robot_retarget.tools.view.web.show import poses
from robot_retarget.tools.view.web.take import Take, take_of
from robot_retarget.tools.view.web.viewer import Viewer
from robot_retarget.trajectory import Trajectory

MOST = 2000
"""Largest number of keyframes [-], by definition: more than the 1785 steps of a file of action pages."""


class KeyframeDesk:
    """Answers the requests of a page about the keyframes of a file."""

    ACTS = ("keyframes", "pose", "judge", "save")

    def __init__(self, file: KeyframeFile, judge: Callable[[Trajectory], Report]):
        """Start with a file, which only `save` writes; `judge` passes verdicts."""
        self.file, self._judge, self._shapes, self._lock = file, judge, shapes_of(file.robot), Lock()

    @property
    def take(self) -> Take:
        """The trajectory through the keyframes of the file."""
        return self._take(self._through(self.file.keyframes)[0])

    def act(self, what: str, table: Any) -> dict[str, Any] | bytes:
        """Return the packed trajectory and its keyframes, or for `pose` a single pose.

        Args:
            what: `keyframes`, `judge`, `save`, or `pose`.
            table: `rows` of keyframes, by default those of the file; for `pose` the number `at` of its keyframe, and a `keypoint`
                to drag to a `place` [m].

        Raises:
            RobotRetargetError: the keyframes or the request are invalid.
        """
        with self._lock:
            keys = _keyframes(table, self.file)
            if what == "pose":
                return self._pose(keys, table)
            file, files = self.file.holding(keys), list[str]()
            shown = [replace(key, step=own.step) for key, own in zip(file.keyframes, keys, strict=True)]
            trajectory, motion = self._through(shown)
            if what == "save":
                files = [str(file.save()), str(trajectory.save(file.path.with_suffix(".npz")))]
                self.file, shown = file, [*file.keyframes]
            report = self._judge(trajectory) if what == "judge" else None
            rows = [asdict(key) | {"angles": key.angles.tolist()} for key in shown]
            state = {"rows": rows, "times": motion.times.tolist(), "notes": motion.notes, "files": files}
            return Viewer((self._take(trajectory, report),)).packed({"keyframes": state})

    def _through(self, keys: Sequence[Keyframe]) -> tuple[Trajectory, KeyframedMotion]:
        return trajectory_through(keys, self.file.robot, source=self.file.path.name)

    def _take(self, trajectory: Trajectory, report: Report | None = None) -> Take:
        if report is None:
            return Take(self.file.robot, trajectory)
        return take_of(trajectory, self.file.robot, report=report)

    def _pose(self, keys: list[Keyframe], table: dict[str, Any]) -> dict[str, Any]:
        """Return the angles and the places of bodies and keypoints at a keyframe, after the drag of the table."""
        at, robot, reached = table.get("at"), self.file.robot, ""
        if not isinstance(at, int) or not 0 <= at < len(keys):
            raise UsageError(f"keyframes are 0 to {len(keys) - 1}, got {at!r}")
        trajectory, motion = self._through(keys)
        qpos = np.array(trajectory.qpos[min(round(motion.times[at] * trajectory.fps), len(trajectory) - 1)])
        qpos[robot.qpos_index] = keys[at].angles
        if "keypoint" in table:
            place = np.array(table.get("place"), float)
            if place.shape != (3,) or not np.isfinite(place).all():
                raise UsageError("a place is three numbers")
            qpos[robot.qpos_index], reached = dragged(qpos, robot, str(table["keypoint"]), place)
        found = keypoints_of(robot, qpos[None])
        return {
            "angles": qpos[robot.qpos_index].tolist(),
            "reached": reached,
            "robot": np.round(poses(robot, qpos[None], self._shapes), 4).ravel().tolist(),
            "points": [] if found is None else np.round(found[1], 4).ravel().tolist(),
        }


def _keyframes(table: Any, file: KeyframeFile) -> list[Keyframe]:
    """Return the keyframes of a request."""
    rows, joints = table.get("rows") if isinstance(table, dict) else None, len(file.robot.joint_names)
    if rows is None:
        return [*file.keyframes]
    if not isinstance(rows, list) or not 0 < len(rows) <= MOST:
        raise UsageError(f"rows are a list of 1 to {MOST} keyframes")
    try:
        keys = [Keyframe(row["angles"], float(row["seconds"]), float(row["pause"]), row["step"]) for row in rows]
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"a keyframe has angles, seconds, pause and step: {error}") from error
    if any(key.angles.shape != (joints,) or not isinstance(key.step, int | None) for key in keys):
        raise UsageError(f"a keyframe has {joints} angles, and a whole number as its step")
    return keys


def serve_keyframes(desk: KeyframeDesk, port: int = PORT) -> Served:
    """Open a port for the keyframe page; `forever` answers.

    Raises:
        UsageError: the port is taken, or may not be used.
    """
    routes = touch_routes(lambda _: desk, desk.ACTS)
    return serve(lambda nonce: Viewer((desk.take,)).page_with("keyframes", nonce), routes, port)

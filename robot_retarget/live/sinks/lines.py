"""Poses as lines of JSON: time [s], qpos, status, age [s] and, with a scene, the poses of its bodies around the robot."""

import json
from typing import IO

from robot_retarget.live.loop import LivePose, status_name


class LineSink:
    """Writes each pose at once."""

    def __init__(self, out: IO[str]) -> None:
        self._out = out

    def show(self, pose: LivePose) -> None:
        row = {"time": round(pose.time, 6), "qpos": pose.qpos.round(6).tolist()}
        row |= {"status": status_name(pose.status), "age": round(pose.age, 4)}
        row |= {"bodies": {name: p.round(6).tolist() for name, p in pose.bodies.items()}} if pose.bodies else {}
        self._out.write(json.dumps(row) + "\n")
        self._out.flush()

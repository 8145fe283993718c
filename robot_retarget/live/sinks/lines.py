"""Poses as lines of JSON: time [s], qpos, status and age [s]."""

import json
from typing import IO

from robot_retarget.live.loop import LivePose, status_name


class LineSink:
    """Writes each pose at once."""

    def __init__(self, out: IO[str]) -> None:
        self._out = out

    def show(self, pose: LivePose) -> None:
        row = {"time": round(pose.time, 6), "qpos": pose.qpos.round(6).tolist()}
        self._out.write(json.dumps(row | {"status": status_name(pose.status), "age": round(pose.age, 4)}) + "\n")
        self._out.flush()

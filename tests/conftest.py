"""Settings of all tests: properties are judged by their truth, not by how busy the machine is.

The solver runs on the virtual machine: machine code gives the same bits and takes seconds to compile. A shipped robot is
loaded once per process, and so is a clip that ships or is shared: nothing changes a robot or a motion. The processes that read untrusted files share one start.
"""

import os
import sys
from collections.abc import Iterator
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import forked
import pytest
from hypothesis import settings
from shared_files import SHARED

from robot_retarget import robot as robots
from robot_retarget.base.files import SAMPLES
from robot_retarget.base.untrusted import child
from robot_retarget.human import read
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Robot, catalog

settings.register_profile("unhurried", deadline=None, max_examples=50)
settings.load_profile("unhurried")
os.environ["CC"] = ""

SHIPPED = catalog.shipped_robots()
load, shipped = catalog.load_robot, cache(catalog.load_robot)


def load_robot(name: str | Path, limits: str | Path | None = None, servos: str | Path | None = None) -> Robot:
    """As in the package; a shipped robot with its own tables is the one that was loaded before."""
    return shipped(name) if name in SHIPPED and limits is None and servos is None else load(name, limits, servos)


CLIPS = SAMPLES, SHARED / "motions"
own, kept = read.read_motion, lru_cache(32)(read.read_motion)


def read_motion(path: str | Path, **how: Any) -> Motion:
    """As in the package; a clip as its file has it is the one that was read before."""
    at_hand = not how and any(Path(path).is_relative_to(folder) for folder in CLIPS)
    return kept(Path(path)) if at_hand else own(path, **how)


catalog.load_robot = robots.load_robot = load_robot
read.read_motion = read_motion
child.run = forked.script


@pytest.fixture(autouse=True)
def loud() -> Iterator[None]:
    """A command that ran quietly in this process leaves the next test its output."""
    yield
    if (console := sys.modules.get("robot_retarget.tools.cli.console")) is not None:
        console.set_quiet(False)

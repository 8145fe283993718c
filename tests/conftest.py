"""Settings of all tests: properties are judged by their truth, not by how busy the machine is.

The solver runs on the virtual machine: machine code gives the same bits and takes seconds to compile. A shipped robot is
loaded once per process: nothing changes a robot. The processes that read untrusted files share one start.
"""

import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import forked
import pytest
from hypothesis import settings

from robot_retarget import robot as robots
from robot_retarget.base.untrusted import child
from robot_retarget.robot import Robot, catalog

settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")
os.environ["CC"] = ""

SHIPPED = catalog.shipped_robots()
load, shipped = catalog.load_robot, cache(catalog.load_robot)


def load_robot(name: str | Path, limits: str | Path | None = None, servos: str | Path | None = None) -> Robot:
    """As in the package; a shipped robot with its own tables is the one that was loaded before."""
    return shipped(name) if name in SHIPPED and limits is None and servos is None else load(name, limits, servos)


catalog.load_robot = robots.load_robot = load_robot
child.run = forked.script


@pytest.fixture(autouse=True)
def loud() -> Iterator[None]:
    """A command that ran quietly in this process leaves the next test its output."""
    yield
    if (console := sys.modules.get("robot_retarget.tools.cli.console")) is not None:
        console.set_quiet(False)

"""LeRobot's own loop carries a performer to the emulated robot by the two plug-ins."""

# LeRobot is not among the packages of the tests: the cases skip without it.
# pyright: reportMissingImports=false

import os
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from robot_retarget.base.files import SAMPLES

os.environ.setdefault("HF_HUB_OFFLINE", "1")
pytest.importorskip("lerobot", reason="lerobot is not installed")

PLUGINS = Path(__file__).parents[2] / "plugins"


def plugin(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(PLUGINS / name)
    return sys.modules[name] if name in sys.modules else __import__(name)


def test_the_emulated_robot_follows_a_file_in_lerobots_own_loop(monkeypatch, tmp_path) -> None:
    from lerobot.processor import make_default_processors
    from lerobot.robots import make_robot_from_config
    from lerobot.scripts.lerobot_teleoperate import teleop_loop
    from lerobot.teleoperators import make_teleoperator_from_config

    bodies, people = (plugin(f"lerobot_{kind}_retarget", monkeypatch) for kind in ("robot", "teleoperator"))
    log = tmp_path / "play.npz"
    robot = make_robot_from_config(bodies.RetargetRobotConfig(id="a", calibration_dir=tmp_path, playback=log))
    human = make_teleoperator_from_config(
        people.RetargetTeleoperatorConfig(id="b", calibration_dir=tmp_path, source=str(SAMPLES / "wave.bvh"))
    )
    assert robot.action_features == human.action_features and set(robot.observation_features) == set(
        human.action_features
    )
    with robot, human:
        teleop_loop(human, robot, 60, *make_default_processors(), duration=6.0)
        seen, told = robot.get_observation(), human.get_action()
    off = np.array([seen[name] - told[name] for name in told])
    assert np.abs(off).max() < 0.15, "the servos are where the performer's robot is"
    with np.load(log) as found:
        phases = found["phases"][found["phase"]]
    assert {"approach", "play"} <= set(phases)


def test_a_robot_that_is_not_connected_takes_no_action(monkeypatch, tmp_path) -> None:
    from lerobot.utils.errors import DeviceNotConnectedError

    module = plugin("lerobot_robot_retarget", monkeypatch)
    robot = module.RetargetRobot(module.RetargetRobotConfig(id="a", calibration_dir=tmp_path, port="/dev/absent"))
    with pytest.raises(DeviceNotConnectedError, match="not connected"):
        robot.send_action({})
    with pytest.raises(DeviceNotConnectedError, match="absent"):
        robot.connect()

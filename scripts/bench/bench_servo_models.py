"""Play on each model of servo what was judged, on the emulator: `python scripts/bench/bench_servo_models.py [MODEL …]` prints a table.

Three links hang from a fixed body on servos of one model, each with a mass that at 0.1 m takes a fifth of the stall torque, and
swing by ±0.4 rad at 0.5 Hz. The figure is the largest rms difference of a joint between the judged and the played angle, without one step of its encoder.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.constants import g

import robot_retarget as rr
from robot_retarget.actuators.control_tables import MODELS, model_named
from robot_retarget.actuators.map import Limits, Servo, ServoMap, dump_map
from robot_retarget.servo.outcome import PlaybackOptions
from robot_retarget.servo.plan import goal_plan
from robot_retarget.servo.play import emulator_process, play

ARM = 0.1
"""Length of a link [m]."""
SHARE = 0.2
"""Torque of a level link over the stall torque."""


def bench(name: str, folder: Path) -> tuple[rr.Robot, ServoMap]:
    """Return three links on servos of a model, and their map."""
    model = model_named(name)
    motor = model.motor
    servos = tuple(Servo(f"j{k}", k, name, zero=model.centre, lower=-1.5, upper=1.5) for k in (1, 2, 3))
    limits = Limits(min_voltage=0.8 * motor.voltage, max_voltage=1.2 * motor.voltage, approach_time=0.5)
    servo_map = ServoMap("bench", servos, 1_000_000, limits)
    mass = SHARE * motor.stall_torque / (g * ARM)
    links = "".join(
        f'<body pos="0 {k} 1"><joint name="j{k}" axis="0 1 0" range="-1.5 1.5"/>'
        f'<geom type="sphere" size=".02" pos="0 0 -{ARM}" mass="{mass}"/></body>'
        for k in (1, 2, 3)
    )
    compiler = '<compiler angle="radian"/>'
    (folder / "bench.xml").write_text(f'<mujoco model="bench">{compiler}<worldbody>{links}</worldbody></mujoco>')
    (folder / "servos.toml").write_text(dump_map(servo_map))
    return rr.load_robot(folder / "bench.xml"), servo_map


def difference(name: str, folder: Path) -> float:
    """Return the largest rms difference of a joint between the judged and the played angle, without one step [rad]."""
    robot, servo_map = bench(name, folder)
    angles = 0.4 * np.sin(2 * np.pi * 0.5 * np.arange(61)[:, None] / 30 + np.arange(3))
    report = rr.simulate(
        rr.Trajectory(angles, 30.0, robot.joint_names, robot.name), robot, mode="pinned", draws=0, others=False
    )
    assert report.trajectory is not None and report.trajectory.goals is not None
    plan, times = goal_plan(report.trajectory, servo_map), report.trajectory.goals.times
    how = ("--physics", "--model", str(folder / "bench.xml"), "--lockstep", str(plan.rate))
    with emulator_process(servo_map, *how) as port:
        outcome = play(plan, servo_map, port, PlaybackOptions(lockstep=True), folder / "play.npz")
    assert outcome.exit_code == 0, outcome.reason
    with np.load(folder / "play.npz") as log:
        present = log["present"][log["phase"] == list(log["phases"]).index("play")]
    seen = np.stack([np.interp(report.series["time"], times, column) for column in present.T], axis=1)
    off = np.sqrt(((seen - report.series["measured"]) ** 2).mean(axis=0))
    return float((off - [1 / abs(servo.scale) for servo in servo_map.servos]).max())


def main() -> None:
    """Print a row for each model."""
    for name in sys.argv[1:] or MODELS:
        with tempfile.TemporaryDirectory() as folder:
            off = max(difference(name, Path(folder)), 0.0)
        print(f"| {name} | {model_named(name).protocol} | {np.degrees(off):.2f} |", flush=True)


if __name__ == "__main__":
    main()

"""Measure the balance feedback: survived pushes, falls in hard worlds, faults of the sensor, and a film of a push.

    python scripts/bench/bench_feedback.py pushes walk.npz --worlds 20     # impulse that 19 of 20 worlds survive, without and with feedback
    python scripts/bench/bench_feedback.py falls walk.npz --worlds 20      # falls in hard worlds: tilt, mass, delay, friction, backlash
    python scripts/bench/bench_feedback.py both walk.npz --worlds 10       # falls caused and prevented in two simulations that differ in contacts and servos
    python scripts/bench/bench_feedback.py soft */trajectory.npz --worlds 5    # the same on soft floors with sagging supply and backlash, beside the verdicts of `run`
    python scripts/bench/bench_feedback.py faults walk.npz                 # each fault of the sensor on the emulated robot
    python scripts/bench/bench_feedback.py lag walk.npz                    # lag of the fused tilt, and the loop on the emulated bus
    python scripts/bench/bench_feedback.py film walk.npz -o push.gif       # one push, without and with feedback

A push lasts 0.1 s and acts on the trunk in the middle of the motion; it is survived if no body other than a foot touches the floor within 1.8 s.
`stand` is the first pose of the first clip, held.
"""

import argparse
import copy
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from pushes import DIRECTIONS, pushed, standing, survived_impulses, worlds_at_push

import robot_retarget as rr
from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY, Balance, Imu
from robot_retarget.actuators.feedback import Fusion
from robot_retarget.actuators.goals import RATE, Goals
from robot_retarget.actuators.inertial import Reading, VirtualImu, calibrated
from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.errors import ServoError
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.feedback import with_feedback
from robot_retarget.judge.figures import fall_figures
from robot_retarget.judge.plant import Plant
from robot_retarget.judge.rollout import plant_of, rollouts
from robot_retarget.judge.worlds import BACKLASH, Spread, draws
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions
from robot_retarget.servo.plan import goal_plan
from robot_retarget.servo.play import emulator_process, play
from robot_retarget.trajectory import Trajectory, load_trajectory

HARD = Spread(
    mass=(0.8, 1.2), friction=(0.4, 0.4), delay=(0.04, 0.04), tilt=(-np.pi / 60, np.pi / 60), backlash=(1.0, 1.0)
)
"""Worlds at the bounds: mass ± 20 %, friction 0.4, delay 40 ms, floor tilted by up to 3° about both axes, all of the backlash."""
VARIED = HARD._replace(friction=(0.4, 1.0), delay=(0.0, 0.04))
"""Worlds up to those bounds, for two simulations."""
SOFT = Spread(
    mass=(1.0, 1.0),
    friction=(0.5, 1.0),
    stiffness=(1.0, 1.0),
    delay=(0.004, 0.02),
    tilt=(0.0, 0.0),
    floor=(0.012, 0.012),
)
"""Worlds as a robot at home has them: a carpet (12 ms), 11 to 12.4 V that sag, backlash of 0.1 to 0.4°, delays of 4 to 20 ms, friction of 0.5 to 1."""
LATER = 9.0
"""When a fault strikes that begins while the robot plays [s after the emulator's start]: approach and lean take 6 s."""
PATIENCE = 1.0
"""A pause of a busy machine is no fault of the bus up to this length [s]."""
HELD = 4.0
"""Duration of the stand in which sensors fail [s]."""
SWAY = 0.1
"""Amplitude of the roll for which the lag is measured [rad]."""
FILMED = 2.2
"""Duration of the film from the push on [s]."""
LIGHT = (0.6, 0.8)
"""Ambient and diffuse part of the headlight [-]: the model has no light."""
STRIDE, SIZE, COLOURS = 4, 240, 64
"""Goals per picture of the film, height and width of a picture [pixels], colours of its palette."""


@dataclass(frozen=True)
class Fault:
    """A fault of the sensor: how the emulated robot differs from the player's map."""

    options: tuple[str, ...] = ()
    """Of `servos emulate`."""
    sensor: Mapping[str, object] | None = None
    """Fields of the real `[imu]`."""


FAULTS = {
    "none": Fault(),
    "x with the wrong sign": Fault(("--fault", "flip x")),
    "y with the wrong sign": Fault(("--fault", "flip y")),
    "z with the wrong sign": Fault(("--fault", "flip z")),
    "mounting turned by 180°": Fault(sensor={"axes": ("x", "y", "z")}),
    "x and y exchanged": Fault(sensor={"axes": ("-y", "x", "z")}),
    "dead": Fault(("--fault", "silent 200")),
    "dead while playing": Fault(("--fault", f"after {LATER} silent 200")),
    "frozen": Fault(("--fault", "freeze")),
    "frozen while playing": Fault(("--fault", f"after {LATER} freeze")),
    "10 times the noise": Fault(sensor={"gyro_noise": 0.02, "accel_noise": 0.8}),
    "50 ms more delay": Fault(sensor={"delay": 0.058}),
    "bias of 1 rad/s": Fault(sensor={"gyro_bias": 1.0}),
}


def table(*columns: str) -> Callable[..., None]:
    """Print the head of a table; the result prints a row."""

    def row(*cells: object) -> None:
        print(f"| {' | '.join(map(str, cells))} |", flush=True)

    row(*columns)
    row(*["---"] * len(columns))
    return row


def pushes(plant: Plant, motions: Mapping[str, Trajectory], worlds: int) -> None:
    """The impulse in each direction that all but one in twenty worlds survive [N s]."""
    row = table("motion", "feedback", *DIRECTIONS)
    for name, motion in motions.items():
        for feedback in (False, True):
            starts = worlds_at_push(plant, motion, draws(worlds), feedback)
            found = [survived_impulses(starts, np.array(way))[worlds // 20] for way in DIRECTIONS.values()]
            row(name, "with" if feedback else "without", *(f"{x:.2f}" for x in found))


def falls(plant: Plant, motions: Mapping[str, Trajectory], worlds: int) -> None:
    """The number of hard worlds in which the robot falls, and of those in which it falls with or without feedback alone."""
    row = table("motion", "without feedback", "with feedback", "without alone", "with alone")
    total, loose = np.zeros(4, dtype=int), plant_of(plant.robot, "free", backlash=BACKLASH)
    for name, motion in motions.items():
        goals = compensated(plant, motion, "free")
        without, fed = (fell(loose, motion, g, worlds) for g in (goals, with_feedback(plant, motion, goals)))
        counts = np.array([without.sum(), fed.sum(), (without & ~fed).sum(), (fed & ~without).sum()])
        total += counts
        row(name, *counts)
    row("all", *total)


def both(plant: Plant, motions: Mapping[str, Trajectory], worlds: int, spread: Spread, paths: list[Path]) -> None:
    """Falls in the worlds of two simulations without and with feedback, and those that feedback prevents and causes."""
    row = table("simulation", "motion", "verdict", "margin [mm]", "falls without", "falls with", "prevented", "caused")
    loose = plant_of(plant.robot, "free", backlash=BACKLASH)
    for simulation, world in (("own", loose), ("second", second_simulation(loose))):
        total = np.zeros(4, dtype=int)
        for (name, motion), path in zip(motions.items(), paths, strict=True):
            goals = motion.goals or compensated(plant, motion, "free")
            tried = (replace(goals, feedback=None), with_feedback(plant, motion, goals))
            without, fed = (fell(world, motion, g, worlds, spread) for g in tried)
            counts = np.array([without.sum(), fed.sum(), (without & ~fed).sum(), (fed & ~without).sum()])
            total += counts
            row(simulation, name, *judged(path), *counts)
        row(simulation, "all", "", "", *total)


def judged(path: Path) -> tuple[str, str]:
    """The badge and the margin of balance [mm] in the report beside a trajectory; empty without one."""
    report = path.with_name("report.json")
    if not report.is_file():
        return "", ""
    found = json.loads(report.read_text(encoding="utf-8"))
    return found["badge"]["text"], f"{1000 * found['figures']['zmp_margin_m']:.1f}"


def second_simulation(plant: Plant) -> Plant:
    """Return the OP3 with other contacts and servos: elliptic cones, MuJoCo's soft default contacts, spinning friction; a plain
    position actuator with the gain of MuJoCo Menagerie and ToddlerBot's gears.
    """
    model, dofs = copy.copy(plant.model), plant.dofs
    model.opt.cone, model.opt.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 5
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
    model.geom_solref[:], model.geom_solimp[:] = (0.02, 1), (0.9, 0.95, 0.001, 0.5, 2)
    model.geom_condim[:], model.geom_friction[:, 1] = 4, 0.005
    model.dof_damping[dofs], model.dof_frictionloss[dofs], model.dof_armature[dofs] = 0.93, 0.134, 0.0012
    model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = 21.1, -21.1, 0
    model.actuator_forcerange[:] = -5, 5
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return replace(plant, model=model)


def fell(plant: Plant, motion: Trajectory, goals: Goals, worlds: int, spread: Spread = HARD) -> Bools:
    """Whether the robot falls in each drawn world (worlds,)."""
    found = rollouts(plant, motion, draws(worlds, spread=spread), command=goals)
    falls = [fall_figures(world, plant.robot, motion)["fall_s"] for world in found]
    return np.array([r.unstable is not None or at is not None for r, at in zip(found, falls, strict=True)])


def faults(plant: Plant, stand: Trajectory) -> None:
    """How playback on the emulated robot ends with each fault of the sensor."""
    report = rr.simulate(stand, plant.robot, mode="free", draws=0, feedback=True)
    servo_map, judged = plant.servo_map, report.trajectory
    assert servo_map is not None and judged is not None
    row = table("fault", "outcome", "largest addition [rad]")
    for name, fault in FAULTS.items():
        row(name, *outcome_with(fault, servo_map, judged))


def outcome_with(fault: Fault, servo_map: ServoMap, judged: Trajectory) -> tuple[str, str]:
    """The end of a playback with a faulted sensor, and the largest addition to the goals."""
    assert servo_map.imu is not None
    patient = replace(servo_map, limits=replace(servo_map.limits, watchdog=0.0, silence=PATIENCE))
    real = replace(servo_map, imu=replace(servo_map.imu, **dict(fault.sensor or {})))
    plan = goal_plan(judged, servo_map)
    with TemporaryDirectory() as folder, emulator_process(real, "--physics", *fault.options) as port:
        log = Path(folder) / "play.npz"
        try:
            ended = play(plan, patient, port, PlaybackOptions(end_pose=False), log)
        except ServoError as error:
            return f"refused: {str(error).partition(' (')[0]}", ""
        with np.load(log) as ticks:
            playing = ticks["phase"] == list(ticks["phases"]).index("play")
            sent = ticks["goal"][playing]
        added = np.abs(sent - plan.angles[: len(sent)]).max() if len(sent) else None
    if ended.ended is not PlaybackEnd.FINISHED:
        return f"stopped: {ended.reason}", "" if added is None else f"{added:.3f}"
    return "; ".join(["survived", *ended.warnings]), f"{added:.3f}"


def fusion_lag(imu: Imu, hertz: float) -> float:
    """The time by which the fused roll follows a rolling body [s]: sensor, rounding to readings and filter."""
    dt, cycles = 1 / RATE, 10
    times = np.arange(round(cycles / hertz / dt)) * dt
    roll, spin = SWAY * np.sin(2 * np.pi * hertz * times), SWAY * 2 * np.pi * hertz * np.cos(2 * np.pi * hertz * times)
    sensor, fusion, fused = VirtualImu(calibrated(imu), dt), Fusion(Balance().fusion), []
    for angle, speed in zip(roll, spin, strict=True):
        force = STANDARD_GRAVITY * np.array([0.0, np.sin(angle), np.cos(angle)])
        fused.append(fusion.step(sensor.read(Reading(np.array([speed, 0.0, 0.0]), force)), dt)[0])
    last = times > times[-1] / 2
    phase = np.angle(np.exp(-2j * np.pi * hertz * times[last]) @ np.array(fused)[last]) + np.pi / 2
    return -float(phase) / (2 * np.pi * hertz)


def lag(plant: Plant, stand: Trajectory) -> None:
    """Lag of the fused tilt by frequency, and how even the loop is with and without the sensor in its cycle."""
    servo_map = plant.servo_map
    assert servo_map is not None and servo_map.imu is not None
    row = table("sway [Hz]", "lag of the fused tilt [ms]")
    for hertz in (0.5, 1.0, 2.0, 4.0):
        row(hertz, f"{1000 * fusion_lag(servo_map.imu, hertz):.1f}")
    judged = rr.simulate(stand, plant.robot, mode="free", draws=0, feedback=True).trajectory
    assert judged is not None
    plan, names = goal_plan(judged, servo_map), ("rate_hz", "jitter_p99_ms", "late_p99_ms", "skipped_ticks")
    row = table("loop", *names)
    for name, played in (("without sensor", replace(plan, feedback=None)), ("with sensor", plan)):
        with emulator_process(servo_map, "--baud", str(servo_map.baud)) as port:
            ended = play(played, servo_map, port, PlaybackOptions(end_pose=False, test_lean=False))
        row(name, *(ended.figures.get(figure) for figure in names))


def film(plant: Plant, stand: Trajectory, impulse: Floats, path: Path) -> None:
    """Write a GIF of one push, without feedback on the left and with it on the right."""
    from PIL import Image

    films = [pictures(plant, stand, impulse, feedback) for feedback in (False, True)]
    joined = [Image.fromarray(np.hstack(pair)).quantize(COLOURS) for pair in zip(*films, strict=True)]
    pause = 1000 * STRIDE / RATE
    joined[0].save(path, save_all=True, append_images=joined[1:], duration=pause, loop=0, optimize=True)


def pictures(plant: Plant, stand: Trajectory, impulse: Floats, feedback: bool) -> list[np.ndarray]:
    """Pictures of a push in the first drawn world."""
    (start,) = worlds_at_push(plant, stand, draws(1), feedback)
    plant.model.vis.headlight.ambient[:], plant.model.vis.headlight.diffuse[:] = LIGHT
    renderer, camera, frames = mujoco.Renderer(plant.model, SIZE, SIZE), mujoco.MjvCamera(), []
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (0.17, 0, 0.15), 1.15, 120, -30
    for world in islice(pushed(start, impulse), 0, round(FILMED * start.goals.rate), STRIDE):
        renderer.update_scene(world.data, camera)
        frames.append(renderer.render().copy())
    renderer.close()
    return frames


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("what", choices=("pushes", "falls", "both", "soft", "faults", "lag", "film"))
    ap.add_argument("clips", nargs="+", type=Path, help="trajectories of a robot with a sensor, from `run`")
    ap.add_argument("--robot", default="op3")
    ap.add_argument("--servos", help="the servo map, with [imu] and [balance]; by default that beside the MJCF")
    ap.add_argument("--worlds", type=int, default=20)
    ap.add_argument("-o", "--out", type=Path, default=Path("push.gif"), help="of the film")
    ap.add_argument("--impulse", type=float, nargs=2, default=(1.28, 0.0), help="of the film, ahead and left [N s]")
    arg = ap.parse_args()
    plant = plant_of(rr.load_robot(arg.robot, servos=arg.servos), "free")
    motions = {
        path.parent.name if path.stem == "trajectory" else path.stem: load_trajectory(path) for path in arg.clips
    }
    first = next(iter(motions.values()))
    if arg.what in ("faults", "lag"):
        {"faults": faults, "lag": lag}[arg.what](plant, standing(first, HELD))
    elif arg.what in ("both", "soft"):
        both(plant, motions, arg.worlds, {"both": VARIED, "soft": SOFT}[arg.what], arg.clips)
    elif arg.what == "film":
        film(plant, standing(first), np.array([*arg.impulse, 0.0]), arg.out)
    else:
        {"pushes": pushes, "falls": falls}[arg.what](plant, {"stand": standing(first), **motions}, arg.worlds)


if __name__ == "__main__":
    main()

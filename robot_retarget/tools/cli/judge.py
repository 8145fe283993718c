"""`simulate`: a trajectory on simulated servos, and a verdict."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

import robot_retarget as rr
from robot_retarget.base.choices import Stand
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import argument, command, line_without, option, options
from robot_retarget.tools.cli.console import progress
from robot_retarget.tools.cli.formats import ColumnOptions, KnownOptions, options_of
from robot_retarget.tools.cli.run import save_judged, write_page

if TYPE_CHECKING:
    from robot_retarget.judge.cures import Origin


@options
class SimulateOptions(opt.JudgeOptions, opt.ServoOptions, opt.TrajectoryOptions):
    """Simulation of a trajectory, and the files to write."""

    mode: Stand = option(
        "pinned (the pelvis is held), free (standing on a floor); auto: free if solved with balance.", default="auto"
    )
    compensate: bool = option("Send goals that compensate lag and load, or the trajectory itself.", default=True)
    backlash: float = option("Backlash of every joint, to each side [rad]; an XM430 has 0.0044 (0.25°).", default=0.0)
    objects: Literal["carried", "free"] = option(
        "Moving bodies of the scene follow their path, or are free and held only by friction.", default="carried"
    )
    policy: Path | None = option(
        "A frozen controller that follows the trajectory: .npz, or .onnx with its contract in a file of the same folder or in its metadata.",
        default=None,
    )
    motion: Path | None = option(
        "The human motion of the trajectory, with which the motion under a policy is compared.",
        "--motion",
        "-m",
        default=None,
    )
    own_actuators: bool = option("The MJCF's actuators, no servos.", "--own-actuators", default=False)
    store: bool = option("Keep the judged goals in the trajectory's file, and write the report of it.", default=True)
    report_file: Path | None = option(
        "The report to write; by default report.json (free) or report.pinned.json in the folder of the trajectory.",
        "--report",
        default=None,
    )
    executed: Path | None = option("The motion as executed to write (.npz), for view and score.", default=None)
    thresholds: Path | None = option("TOML file with thresholds of the verdict.", default=None)
    page: Path | None = option("A page with charts to write (.html).", default=None)


@command(epilog="Example: robot-retarget simulate dance.npz --robot op3 --mode free")
def simulate(how: SimulateOptions, robot: opt.RobotOptions, printing: opt.PrintOptions) -> None:
    """Play a trajectory on simulated servos and pass a verdict.

    The goals that were judged are kept for `play`.
    """
    from robot_retarget.base.files import require_suffix, require_writable
    from robot_retarget.base.untrusted.documents import NAMES
    from robot_retarget.collision import warnings_of
    from robot_retarget.judge.rollout import mode_of
    from robot_retarget.judge.verdict import read_thresholds
    from robot_retarget.tools.view.film import loop

    page = how.page
    if page is not None:
        require_suffix(page, ".html", "--json prints the report as JSON")
    if how.executed is not None:
        require_suffix(how.executed, ".npz", "`export` writes trajectories in other formats")
    model, played = robot.load(how.servos, how.trajectory), rr.load_trajectory(how.trajectory)
    resolved = mode_of(played) if how.policy is None else "free"
    mode = resolved if how.mode == "auto" else how.mode
    where = how.report_file or how.trajectory.with_name(NAMES[mode])
    for path in filter(None, (*((how.trajectory, where) if how.store else ()), page, how.executed)):
        require_writable(path)
    warnings = warnings_of(played, model) if len(played) > 1 else None  # a single frame has no next one to warn of
    with progress() as begin:
        report = rr.simulate(
            played,
            model,
            mode=mode,
            drives=None if how.own_actuators else "auto",
            compensate=how.compensate,
            thresholds=None if how.thresholds is None else read_thresholds(how.thresholds),
            warnings=warnings,
            draws=how.draws,
            feedback=how.feedback,
            backlash=how.backlash,
            objects=how.objects,
            policy=how.policy,
            motion=how.motion,
            progress=begin("simulate"),
        )
    report = replace(report, origin=_origin(how.trajectory, robot.robot, played))
    if how.store:
        save_judged(report, how.trajectory, where)
    if how.executed is not None and report.executed is not None:
        report.executed.save(how.executed)
    if page is not None:
        write_page(report, report.trajectory or played, warnings, page, film=loop(model, played))
    printing.show(report.contract(), lambda _: console.show_report(report))
    raise typer.Exit(0 if report.verdict == "pass" else 1)


WRITTEN = ("--report", "--executed", "--page")
"""Options of `simulate` that name files to write."""


def _origin(path: Path, robot: str, trajectory: "rr.Trajectory") -> "Origin":
    """Return the files and commands of a simulation, as the cures of its report name them."""
    from robot_retarget.judge.cures import Origin

    words = line_without(WRITTEN, ("simulate", str(path), "--json", "--quiet", "-q", "--no-store"))
    return Origin(str(path), robot, trajectory.source or Origin.motion, judge=shlex.join(words))


# `warn`: collisions foreseen.


@options
class WarnedOptions(opt.TrajectoryOptions):
    """How far ahead to look, and what to write."""

    horizon: float | None = option(
        "How far ahead to look [s]; by default 0.1 along the frames of the file, 1/30 along the last step.",
        default=None,
    )
    planned: bool = option(
        "Follow the next frames of the file (recall and precision 1.0 on captured clips), or continue the last step, as in a "
        "stream (recall 0.96 to 1.0, precision 0.66 to 0.94).",
        "--planned/--last-step",
        default=True,
    )
    output: Path | None = option("A table of the events to write (.csv).", *opt.OUT, default=None)


@command(epilog="Example: robot-retarget warn dance.npz --robot op3 -o warnings.csv")
def warn(warned: WarnedOptions, robot: opt.RobotOptions, printing: opt.PrintOptions) -> None:
    """Predict collisions of a trajectory, frame by frame.

    With itself and with the bodies around it; each warning is compared with what happened.
    """
    from robot_retarget.base.files import require_suffix, require_writable
    from robot_retarget.collision import WarnOptions, figures_of, warnings_of, write_csv

    output = warned.output
    if output is not None:
        require_writable(output)
        require_suffix(output, ".csv", "--json prints the events as JSON")
    ahead = None if warned.horizon is None else WarnOptions(horizon=warned.horizon)
    trajectory = rr.load_trajectory(warned.trajectory)
    found = warnings_of(trajectory, robot.load(of=warned.trajectory), ahead, planned=warned.planned)
    if output is not None:
        write_csv(found.events, output)
    facts = {
        "events": [event.contract() for event in found.events],
        "figures": figures_of(found.events, len(found), found.fps),
    }
    printing.show(facts, console.show_warnings)
    if output is not None:
        console.note(f"wrote {output}")


# `score`: the figures by which retargeters are compared.


@options
class ScoreOptions(ColumnOptions, KnownOptions, opt.MapOptions, opt.ReadOptions):
    """The motion of a robot and of the human."""

    trajectory: Path = argument("File or folder with the motion of a robot.")
    motion: Path | None = option(
        "The human motion it comes from; without one, figures of the robot.", "--motion", "-m", default=None
    )
    rate: float | None = option("Frames per second of a file that says none, or says it wrong.", default=None)
    source_fps: float | None = option(
        "Frames per second of the motion file; overrides the file.", "--motion-fps", default=None
    )
    repair: bool = option("Repair defects of the motion, as solve does.", default=False)
    policy: Path | None = option(
        "A frozen controller, as in simulate: rank one trajectory, or all of a folder, by its falls.", default=None
    )
    draws: int = option("Number of random worlds for the controller, besides the nominal one.", default=2)
    output: Path | None = option("A JSON file to write.", *opt.OUT, default=None)


@command(epilog="Example: robot-retarget score dance.npz --robot op3 --motion dance.bvh")
def score(scored: ScoreOptions, robot: opt.RobotOptions, printing: opt.PrintOptions) -> None:
    """Score any known file of robot motion.

    Likeness to the human, contacts, feet, limits, smoothness, physics.
    """
    from robot_retarget.base.files import require_writable, write_text
    from robot_retarget.formats import import_motion

    if scored.output is not None:
        require_writable(scored.output)
    model = robot.load(of=scored.trajectory)
    if scored.policy is not None:
        facts, show = _ranked(scored.policy, scored, model), console.show_followed
    else:
        options = options_of(scored.joints, source_fps=scored.rate, quaternion=scored.quaternion)
        played = import_motion(scored.trajectory, model, scored.format, options)
        human = None if scored.motion is None else scored.read(scored.motion)
        found = rr.score(played, model, human, overrides=scored.map_file)
        facts, show = found.contract(), lambda _: console.show_score(found)
    if scored.output is not None:
        write_text(scored.output, console.as_json(facts) + "\n")
    printing.show(facts, show)


def _ranked(file: Path, scored: ScoreOptions, robot: "rr.Robot") -> dict[str, Any]:
    """Return trajectories by how the controller of a file follows them."""
    from robot_retarget.base.errors import UsageError
    from robot_retarget.judge.policy_files import read_policy
    from robot_retarget.judge.rollout import followed, ranked

    policy, where = read_policy(file), scored.trajectory
    files = sorted(where.rglob("*.npz")) if where.is_dir() else [where]
    if not files:
        raise UsageError(f"{where}: holds no trajectory (.npz)")
    with progress() as begin:
        bar, found = begin("follow"), []
        for k, path in enumerate(files):
            found.append(followed(rr.load_trajectory(path), robot, policy, scored.draws, str(path)))
            bar(k + 1, len(files))
    return {"policy": policy.name, "trajectories": [each.contract() for each in ranked(found)]}

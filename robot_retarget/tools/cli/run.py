"""`run` and `demo`: everything from a motion to a judged trajectory with its report."""

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from shutil import copyfile, rmtree
from typing import TYPE_CHECKING

import typer

import robot_retarget as rr
from robot_retarget.base.errors import UsageError
from robot_retarget.base.files import made_folder, replacing, write_text
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import NOTHING, command, line_without, option, options
from robot_retarget.tools.cli.console import progress

# The stages behind the commands: from files to files, with messages on the terminal.

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot_retarget.base.choices import Stand
    from robot_retarget.base.progress import Progress
    from robot_retarget.collision import Warnings
    from robot_retarget.judge.cures import Origin
    from robot_retarget.servo.outcome import PlaybackOutcome
    from robot_retarget.tools.view.film import AnimatedWebP, Film
    from robot_retarget.tools.view.picture import Picture, Unavailable

    Shown = Path | AnimatedWebP | Unavailable
    """A film in a file, a loop, or the reason why there is neither."""


RESULTS = (
    "trajectory.npz",
    "report.json",
    "report.html",
    "viewer.html",
    "warnings.csv",
    "strip.png",
    "video.mp4",
    "play.npz",
    "report.pinned.json",
)
"""Files of a folder of results, which belong together: those of an earlier run go when the new ones come."""
UNFINISHED, COMPLETE = ".unfinished", ".complete"
"""Names of the folder that holds results, until all are written and until all are in their place."""
WANTED = ".names"
"""File in a complete folder that lists its results."""


@dataclass(frozen=True)
class Filled:
    """A folder of results that is being filled."""

    place: Path
    """Where its files go."""
    earlier: tuple[str, ...]
    """Results of an earlier run in that place."""
    shown: set[str] = field(default_factory=set[str])
    """Files that are in their place before all are complete."""

    @property
    def path(self) -> Path:
        """Folder of the files until all are complete."""
        return self.place / UNFINISHED

    def written(self) -> list[str]:
        """The names of the files that were written, sorted."""
        return sorted(name for name in RESULTS if (self.path / name).exists())

    def show(self, name: str) -> Path:
        """Return where a file can be looked at now: in its place, unless results of an earlier run stand there."""
        if self.earlier:
            return self.path / name
        self.shown.add(name)
        with replacing(self.place / name) as scratch:
            copyfile(self.path / name, scratch)
        return self.place / name


@contextmanager
def filling(place: Path) -> Iterator[Filled]:
    """Fill a folder with results that replace earlier ones together, at the end or on Ctrl-C.

    A run that is killed leaves the earlier results, or, once all new files are complete, the new ones: the next run puts the rest
    of them in their place before it begins.

    Raises:
        OutputError: The folder cannot be made or written.
        KeyboardInterrupt: Ctrl-C; its text names the files that were written.
    """
    with made_folder(place):
        _put(place)
        filled = Filled(place, tuple(name for name in RESULTS if (place / name).exists()))
        rmtree(filled.path, ignore_errors=True)
        try:
            filled.path.mkdir()
            yield filled
            _replace(filled)
            if filled.earlier:
                console.note(f"replaced the results of an earlier run in {place}: {', '.join(filled.earlier)}")
        except KeyboardInterrupt as stopped:
            kept = _replace(filled)
            raise KeyboardInterrupt(f"kept {', '.join(kept)} in {place}" if kept else NOTHING) from stopped
        finally:
            rmtree(filled.path, ignore_errors=True)
            for name in filled.shown:
                (place / name).unlink(missing_ok=True)


def _replace(filled: Filled) -> list[str]:
    """Put the files in the place of earlier results; return their names."""
    if names := filled.written():
        write_text(filled.path / WANTED, "\n".join(names))
        filled.shown.clear()
        filled.path.rename(filled.place / COMPLETE)
    return _put(filled.place)


def _put(place: Path) -> list[str]:
    """Move complete files to their place; idempotent, so an interrupted move can be repeated. Return their names."""
    complete, names = place / COMPLETE, list[str]()
    if (complete / WANTED).exists():  # it goes last
        names = (complete / WANTED).read_text(encoding="utf-8").split("\n")
        for name in set(RESULTS) - set(names):
            (place / name).unlink(missing_ok=True)
        for name in names:
            if (complete / name).exists():
                (complete / name).replace(place / name)
    rmtree(complete, ignore_errors=True)
    return names


@options
class FolderOptions(opt.JudgeOptions, opt.FollowOptions):
    """How a folder of results is filled."""

    out: Path = option("Folder for the results.", *opt.OUT, default=Path("out"))
    video: bool = option("Make a film as well: video.mp4.", "--video", default=False)


def fill_folder(
    motion: "rr.Motion",
    robot: "rr.Robot",
    goals: opt.GraphOptions,
    how: FolderOptions,
    printing: opt.PrintOptions,
    play: bool = False,
) -> str:
    """Solve, simulate (free if balanced, else pinned), draw and write a folder; return the verdict.

    Args:
        play: play what passes on an emulated bus too, for robots that ship with a servo map.
    """
    from robot_retarget.tools.summary import describe_solution
    from robot_retarget.tools.view.web.viewer import view

    out, say = how.out, (lambda text: None) if printing.json else console.say
    say(f"{motion.source} to {robot.name}: {motion.duration:.3g} s of motion")
    with filling(out) as filled, progress() as begin:
        result = opt.solved(goals.describe(motion, robot), how, begin(f"retarget to {robot.name}"))
        found, target = describe_solution(result.solution, result.notes), filled.path
        viewer = view(result).save(target / "viewer.html")
        if not printing.json:
            console.show_solution(found)
        say(f"look at it while it is judged: {filled.show(viewer.name)}")
        report, warnings = _tried(result, target, how, _origin(out, robot), begin("simulate"))
        view(result, report=report).save(viewer)
        if not printing.json:
            console.show_report(report)
        outcome = played_on_emulated(robot.name, target) if play and report.verdict == "pass" else None
        if outcome is not None:
            report = report.with_playback(outcome.figures)
            report.save(target / "report.json")
            if not printing.json:
                console.show_playback(outcome.figures)
            say(f"{outcome.sentence}, on the emulated robot")
        pictures = _shown(result, target, how.video, begin)
        write_page(report, target / "trajectory.npz", warnings, target / "report.html", *pictures, viewer)
        files = filled.written()
    if printing.json:
        console.dump({"solution": found, "report": report.contract(), "folder": str(out), "files": files})
    say(f"wrote {', '.join(files)} in {out}")
    say(f"next: open {first_page(out, files)}")
    return report.verdict


def _origin(out: Path, robot: "rr.Robot") -> "Origin":
    """Return the files and commands of a run, as the cures of its report name them."""
    from robot_retarget.judge.cures import PROGRAM, Origin
    from robot_retarget.robot import shipped_robots

    name = robot.name if robot.name in shipped_robots() else str(robot.path)
    line = line_without(opt.OUT, ("--json", "--quiet", "-q", "--video", "--no-video"))
    return Origin(str(out / "trajectory.npz"), name, run=shlex.join([PROGRAM, *line]))


def _tried(
    result: "rr.Result", target: Path, how: opt.JudgeOptions, origin: "Origin", progress: "Progress"
) -> tuple["rr.Report", "Warnings | None"]:
    """In simulation: `trajectory.npz` with its goals, `report.json` and, of more than one frame, `warnings.csv`."""
    from robot_retarget.collision import write_csv

    warnings = result.warnings if len(result.trajectory) > 1 else None
    report = rr.simulate(result, warnings=warnings, draws=how.draws, feedback=how.feedback, progress=progress)
    report = replace(report, origin=origin)
    save_judged(report, target / "trajectory.npz", target / "report.json")
    if warnings is not None:
        write_csv(warnings.events, target / "warnings.csv")
    return report, warnings


def save_judged(report: "rr.Report", trajectory: Path, where: Path) -> None:
    """Write the trajectory with the goals that were judged, then its report; an error in writing leaves neither."""
    from robot_retarget.base.files import replacing

    assert report.trajectory is not None
    with replacing(where) as contract, replacing(trajectory) as judged:
        judged.write_bytes(report.trajectory.serialised())
        contract.write_text(report.text(), encoding="utf-8")


def judged_plain(
    trajectory: "rr.Trajectory", robot: "rr.Robot", mode: "Stand", rate: float, feedback: bool | None
) -> "rr.Trajectory":
    """A trajectory with goals that are itself, `rate` a second, once they have passed; `feedback` as in `simulate`.

    Raises:
        ServoError: they did not.
    """
    from robot_retarget.base.errors import ServoError
    from robot_retarget.judge.playback import Playback

    report = rr.simulate(
        trajectory, robot, mode=mode, compensate=False, playback=Playback(rate=rate), feedback=feedback
    )
    if report.verdict != "pass":
        raise ServoError(f"the trajectory without compensation does not pass: {'; '.join(report.reasons)}")
    assert report.trajectory is not None
    return report.trajectory


def played_on_emulated(robot: str, folder: Path) -> "PlaybackOutcome | None":
    """Play the folder's trajectory on an emulated bus with the robot's model behind it; None for a robot without a servo map."""
    from robot_retarget.actuators.map import load_map
    from robot_retarget.base.files import MODELS
    from robot_retarget.servo.play import play_emulated

    if not (MODELS / robot / "servos.toml").is_file():
        return None
    trajectory = rr.load_trajectory(folder / "trajectory.npz")
    return play_emulated(trajectory, load_map(robot), lockstep=True, log=folder / "play.npz")


def _shown(
    result: "rr.Result", target: Path, film: bool, begin: "Callable[[str], Progress]"
) -> "tuple[Picture | None, Shown]":
    """Draw the strip, and the film or a loop of few pictures; notes name what cannot be drawn."""
    from robot_retarget.tools.view.film import Film, loop, strip, video
    from robot_retarget.tools.view.picture import Picture

    what, path = (result.robot, result.trajectory), target / "video.mp4"
    figure = result.match.figure(result.motion)
    filmed = video(*what, path, *figure, progress=begin("film")) if film else None
    begin("pictures")
    picture = strip(*what, *figure)
    if isinstance(picture, Picture):
        picture.save(target / "strip.png")
    for sentence in {_note_of(drawn) for drawn in (filmed, picture) if drawn is not None} - {""}:
        console.note(sentence)
    shown = path if isinstance(filmed, Film) else loop(*what, *figure)
    return picture if isinstance(picture, Picture) else None, shown


def _note_of(drawn: "Film | Picture | Unavailable") -> str:
    """Return the note of a film or picture, or the reason for its lack."""
    from robot_retarget.tools.view.picture import Unavailable

    return drawn.reason if isinstance(drawn, Unavailable) else drawn.note


def write_page(
    report: "rr.Report",
    trajectory: "Path | rr.Trajectory",
    warnings: "Warnings | None",
    page: Path,
    strip: "Picture | None" = None,
    film: "Shown | None" = None,
    viewer: Path | None = None,
) -> None:
    """Write the report's page; what hinders it is said."""
    from robot_retarget.tools.view.page import save_page
    from robot_retarget.tools.view.picture import Unavailable

    drawn = save_page(report, trajectory, page, warnings=warnings, strip=strip, film=film, viewer=viewer)
    if isinstance(drawn, Unavailable):
        console.note(drawn.reason)


def require_source(trajectory: "rr.Trajectory", motion: "rr.Motion", force: bool) -> None:
    """Require that a trajectory comes from a motion, unless forced.

    Raises:
        UsageError: it comes from another motion.
    """
    from robot_retarget.base.errors import TrajectoryError

    try:
        trajectory.require_source(motion.source, motion.source_sha256)
    except TrajectoryError as error:
        if not force:
            raise UsageError(f"{error}; --force accepts it") from error


def first_page(out: Path, files: Sequence[str]) -> str:
    """Name the page of a folder of results that shows the rest: the report, which needs matplotlib, else the viewer."""
    if "report.html" in files:
        return f"{out / 'report.html'} in a browser; it leads to {out / 'viewer.html'}"
    return f"{out / 'viewer.html'} in a browser"


def is_robot_name(name: str) -> bool:
    """Return whether a name is that of a model file or a shipped robot, or at least not that of a file or folder."""
    from robot_retarget.robot import shipped_robots
    from robot_retarget.robot.catalog import MODEL_FILES, XACRO

    path = Path(name)
    known = path.suffix.lower() in (*MODEL_FILES, XACRO) or name.lower() in shipped_robots()
    return known or (not path.suffix and not path.exists())


def shipped_clip(name: str) -> Path:
    """The file of a sample clip by its name."""
    from robot_retarget.base.errors import known
    from robot_retarget.base.files import SAMPLES

    clips = {path.stem: path for path in sorted(SAMPLES.glob("*.bvh"))}
    if name not in clips:
        raise UsageError(f"no shipped clip {name!r}; {known(clips, typed=name)}")
    return clips[name]


@command(epilog="Example: robot-retarget run dance.bvh --robot op3 --out dance")
def run(
    clip: opt.ClipOptions,
    robot: opt.DefaultRobotOptions,
    servos: opt.ServoOptions,
    goals: opt.GraphOptions,
    how: FolderOptions,
    printing: opt.PrintOptions,
) -> None:
    """Retarget a motion, warn, simulate and report.

    Writes trajectory.npz, report.json, report.html, viewer.html, warnings.csv and strip.png.
    """
    verdict = fill_folder(clip.load(), robot.load(servos.servos), goals, how, printing)
    raise typer.Exit(0 if verdict == "pass" else 1)


@options
class DemoOptions(FolderOptions):
    """Which shipped clip is shown on which robot."""

    clip: str = option("A shipped clip.", default="wave")
    robot: str = option(f"{opt.ROBOT}.", "--robot", "-r", default="op3")
    out: Path = option("Folder for the results.", *opt.OUT, default=Path("demo"))
    video: bool = option("Make a film as well.", default=True)


@command(epilog="Example: robot-retarget demo --out demo")
def demo(how: DemoOptions, printing: opt.PrintOptions) -> None:
    """Run a shipped clip on a shipped robot, and emulated servos.

    Solved, simulated, shown and played.
    """
    motion = opt.ReadOptions().read(shipped_clip(how.clip))
    verdict = fill_folder(motion, opt.load(how.robot), opt.GraphOptions(), how, printing, play=True)
    if verdict != "pass" and not printing.json:
        console.say("not played: the verdict is fail")

"""A clip on a robot, from its file to its exports. Solving, judging and export call the functions of the shell commands, with the same arguments."""

import json
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import make_archive
from tempfile import TemporaryDirectory, mkdtemp
from threading import Lock
from time import monotonic
from typing import Any, cast, get_args

import numpy as np

import robot_retarget as rr
from robot_retarget.base.choices import Balance, Legs, Preset
from robot_retarget.base.errors import FileError, RobotRetargetError, UsageError, known
from robot_retarget.base.files import write_text
from robot_retarget.base.untrusted.documents import NAMES, read_json
from robot_retarget.collision import warnings_of
from robot_retarget.edit.cuts import trimmed
from robot_retarget.edit.touchup import Session, graph_of
from robot_retarget.formats import FORMATS
from robot_retarget.graph.edits import Edit, edited, read_edits, write_edits
from robot_retarget.human.match import read_map
from robot_retarget.judge.cures import PROGRAM, Origin
from robot_retarget.judge.rollout import mode_of, report_beside
from robot_retarget.tools.cli.run import save_judged
from robot_retarget.tools.view.web.editor import TakeEditor
from robot_retarget.tools.view.web.take import Take, human_of, take_of
from robot_retarget.tools.view.web.viewer import Viewer
from robot_retarget.trajectory import Trajectory

ALLOWED: dict[str, tuple[str, ...]] = {
    "balance": get_args(Balance), "legs": get_args(Legs), "favour": ("balanced", "directions", "distances"),
    "speed": ("1", "0.8", "0.6"), "fps": ("",), "trim": ("",), "feedback": ("", "off"), "objects": ("carried", "free"),
}  # fmt: skip
"""Choices of a project and their values on the page, the default first; cures set other values of `speed`, `fps` and `trim`."""
FREE = {"speed", "fps", "trim"}
"""Choices whose value can be a number, or two with a colon."""
STORED = "project.json"
"""File of a project: motion, robot, choices and dropped kinds of edges."""
FLAGS = {"--no-feedback": ("feedback", "off")}
"""Choices that options without a value set in the command of a cure."""


class StoppedError(RobotRetargetError):
    """The user or a newer work stopped a step."""


@dataclass
class Work:
    """The steps of a project in one thread, from the queue to their end."""

    state: str = "waiting"
    """`waiting`, `opening`, `solving`, `solved`, `judging`, `judged`, `stopped` or `failed`."""
    share: float = 0.0
    began: float = 0.0
    stop: bool = False
    error: str = ""

    @property
    def busy(self) -> bool:
        """Whether the work waits or runs."""
        return self.state in ("waiting", "opening", "solving", "judging")

    def left(self) -> float | None:
        """Return the remaining time [s], estimated from the finished share; None up to a share of 0.05."""
        passed = monotonic() - self.began
        return round(passed * (1 / self.share - 1), 1) if self.share > 0.05 else None


class Project:
    """A clip on a robot.

    Args:
        key: name of the project in requests of the page.
        clip: the file of the motion, and the motion.
        model: the argument of `load_robot`, and the robot.
        name: name of the robot on the page and in the folder of the project.
        changed: the project calls it after every change of the page's content.
    """

    def __init__(
        self,
        key: str,
        clip: tuple[Path, rr.Motion],
        model: tuple[str, rr.Robot],
        name: str,
        changed: Callable[[], None],
    ) -> None:
        self.key, self.name, self._changed = key, name, changed
        (self.motion_file, self.motion), (self.model, self.robot) = clip, model
        self.place: Path = self.motion_file.with_name(f"{self.motion_file.stem}-{name}")
        self.choices: dict[str, str] = {name: values[0] for name, values in ALLOWED.items()}
        self.dropped: list[str] = []
        """Kinds of edges that are off."""
        self._before = self.choices, self.dropped
        self.work: Work = Work()
        self.version: int = 0
        """Number of changes of the shown take and of the state."""
        self.editor: TakeEditor | None = None
        self.notes, self.kinds = self.motion.notes, tuple[str, ...]()
        self.lock = Lock()

    # Files of the project.

    @property
    def trajectory_file(self) -> Path:
        """Path of the solved trajectory."""
        return self.place / "trajectory.npz"

    @property
    def map_file(self) -> Path | None:
        """Path of the keypoint map; None without a file."""
        return path if (path := self.place / "map.toml").exists() else None

    @property
    def touched(self) -> tuple[Path, Path]:
        """Paths of the touch-ups, and of the trajectory with them."""
        return self.place / "EDITS.toml", self.place / "mended.npz"

    def _store(self, work: Work) -> None:
        """Write the file from which the studio opens the project at its next start."""
        named = {"motion": self.motion_file.name, "robot": self.name, "model": self.model}
        with self.lock:
            self._go_on(work)
            write_text(self.place / STORED, json.dumps(named | {"choices": self.choices, "dropped": self.dropped}))

    # Steps. `reopen`, `solve` and `judge` run in a thread of the pool and set the state of their work.

    def open(self) -> None:
        """Stop the present work, drop the result, and show the human next to the standing robot.

        Raises:
            MatchError: the motion is not human, or the robot no humanoid.
        """
        human = human_of(rr.match(self.motion, self.robot, self.map_file), self.motion)
        self.waits()
        self.place.mkdir(exist_ok=True)
        self.editor, self.notes = None, self.motion.notes
        self._show(self._take(np.repeat(self.robot.standing()[None], len(self.motion), axis=0), human))

    def _take(self, qpos: np.ndarray, human: Any) -> Take:
        names = self.robot.joint_names, self.robot.name
        return Take(self.robot, Trajectory(qpos, self.motion.fps, *names, source=self.motion_file.name), human)

    def solve(self, work: Work) -> None:
        """Solve the clip as `solve`, `edit retime` and `edit cut` do. Before a first result without a map, a draft is shown."""
        robot, motion, choices, over = self.robot, self.motion, self.choices, self.map_file
        self._reach(work, "solving")
        before = None if self.editor is None else self.editor.take.trajectory
        if before is None and over is None:
            self._draft(work)
        fps, preset = float(choices["fps"]) if choices["fps"] else None, cast(Preset, choices["favour"])
        graph = rr.describe(motion, robot, overrides=over, preset=preset, fps=fps)
        graph = edited(graph, [Edit("drop", {"kind": kind}) for kind in self.dropped])
        how: dict[str, Any] = {"balance": choices["balance"], "progress": self._progress(work)}
        result = rr.solve(graph, legs=cast(Legs, choices["legs"]), **how)
        trajectory = (take := rr.view(result).takes[0]).trajectory
        if choices["speed"] != "1":
            trajectory = rr.sequence([trajectory], robot, speed=float(choices["speed"]), **how).trajectory
        if choices["trim"]:
            trajectory = trimmed(trajectory, *map(float, choices["trim"].split(":")))
        if trajectory is not take.trajectory:
            take = take_of(trajectory, robot, motion, overrides=over)
        self._go_on(work)
        trajectory.save(self.trajectory_file)
        self._store(work)
        alike = before is not None and len(before) == len(trajectory)
        self.notes, self._before = result.notes, (choices, self.dropped)
        self._edit(replace(take, before=before if alike else None))
        self._reach(work, "solved")

    def _edit(self, take: Take) -> TakeEditor:
        """Show a take that touch-ups can change."""
        graph = graph_of(self.motion, self.robot, take.trajectory, self.map_file)
        self.kinds = tuple(graph.kinds)
        self.editor = TakeEditor(take, Session(graph, take.trajectory, *self.touched))
        return self.editor

    def reopen(self, work: Work) -> None:
        """Show the stored trajectory with its touch-ups and its verdict; solve the clip if none is stored.

        Raises:
            FileError, TrajectoryError, GraphError: a stored file cannot be read.
        """
        path, robot = self.trajectory_file, self.robot
        if not path.is_file() or not (self.place / STORED).is_file():
            self._store(work)
            return self.solve(work)
        self._reach(work, "opening")
        stored = read_json(self.place / STORED, FileError)
        self.choose(stored["choices"])
        self.dropped = stored["dropped"]
        self._before = self.choices, self.dropped
        editor = self._edit(take_of(rr.load_trajectory(path, robot), robot, self.motion, overrides=self.map_file))
        edits, mended = self.touched
        if mended.is_file() and mended.stat().st_mtime_ns > path.stat().st_mtime_ns:
            path = mended
            for edit in read_edits(edits):
                editor.act("edit", edit.values)
        report = report_beside(path, rr.load_trajectory(path, robot), robot)
        if report is not None:
            editor.take = replace(editor.take, report=replace(report, origin=self._origin(path)))
        self._reach(work, "judged" if report else "solved")

    def _origin(self, path: Path) -> Origin:
        return Origin(str(path), self.model, str(self.motion_file), judge=shlex.join(self._judging()))

    def _draft(self, work: Work) -> None:
        """Show the result of the stream's solver, which is causal and takes milliseconds a frame."""
        motion, first = self.motion, self.take
        qpos, shown = np.array(first.trajectory.qpos), monotonic()
        for frame, pose in enumerate(rr.stream(self.robot, motion, native=False)):
            qpos[frame:] = pose
            self._progress(work)(0, 1)
            if monotonic() - shown > DRAFT or frame + 1 == len(motion):
                shown = monotonic()
                self._show(self._take(qpos.copy(), first.human))

    def judge(self, work: Work) -> None:
        """Simulate the shown trajectory as `simulate` does, and store goals and report.

        Raises:
            UsageError: the project has no solved trajectory.
        """
        editor, choices = self._solved(), self.choices
        self._reach(work, "judging")
        played = editor.take.trajectory
        warnings = warnings_of(played, self.robot) if len(played) > 1 else None
        how: dict[str, Any] = {"objects": choices["objects"], "feedback": False if choices["feedback"] else None}
        how |= {"mode": mode_of(played), "warnings": warnings, "progress": self._progress(work)}
        report = rr.simulate(played, self.robot, **how)
        path = self.written(editor)
        report = replace(report, origin=self._origin(path))
        save_judged(report, path, path.with_name(NAMES[mode_of(played)]))
        with editor.lock:
            editor.take = replace(editor.take, report=report)
        self._reach(work, "judged")

    def _solved(self) -> TakeEditor:
        if self.editor is None:
            raise UsageError("nothing is solved yet")
        return self.editor

    def written(self, editor: TakeEditor) -> Path:
        """Return the file of the shown trajectory; save touch-ups first."""
        if editor.session is None or not editor.session.edits:
            return self.trajectory_file
        return editor.session.save()[1]

    # Changes by the page.

    def choose(self, choices: Mapping[str, Any]) -> None:
        """Set choices.

        Raises:
            UsageError: a choice or its value is unknown.
        """
        for name, value in choices.items():
            if name not in ALLOWED:
                raise UsageError(f"no choice {name!r}; {known(ALLOWED, typed=name)}")
            if str(value) not in ALLOWED[name] and not (name in FREE and _numbers(str(value))):
                raise UsageError(f"{name}: {known(ALLOWED[name], typed=value)}, got {value!r}")
        self.choices = self.choices | {name: str(value) for name, value in choices.items()}

    def cure(self, command: str) -> None:
        """Set the choices in the command of a cure; its speed multiplies the present speed."""
        found = choices_in(command)
        if "speed" in found:
            found["speed"] = f"{float(found['speed']) * float(self.choices['speed']):.3g}"
        self.choose(found)

    def keep_kinds(self, dropped: list[str]) -> None:
        """Replace the list of dropped kinds of edges, and write it to `edges.toml`."""
        self.dropped = [str(kind) for kind in dropped]
        write_edits([Edit("drop", {"kind": kind}) for kind in self.dropped], self.place / "edges.toml")

    def mend(self, body: str, keypoint: str, where: Any) -> None:
        """Replace a keypoint of the `human` (the name of a joint) or `robot` (the name of a body) in the map file.

        Raises:
            UsageError: `body` is another word.
            MatchError: the keypoint, joint or body is unknown; the file stays unchanged.
        """
        import tomlkit

        if body not in ("human", "robot"):
            raise UsageError("a keypoint is the human's or the robot's")
        tables = {key: dict(table) for key, table in read_map(self.map_file).items()} if self.map_file else {}
        tables.setdefault(body, {})[keypoint] = str(where) if body == "human" else [str(where), 0.0, 0.0, 0.0]
        with TemporaryDirectory() as scratch:
            tried = write_text(Path(scratch) / "map.toml", tomlkit.dumps(tables))
            rr.match(self.motion, self.robot, tried)
            write_text(self.place / "map.toml", tried.read_text(encoding="utf-8"))

    # Views and exports.

    @property
    def take(self) -> Take:
        """The shown take."""
        return self._shown if self.editor is None else self.editor.take

    def _show(self, take: Take) -> None:
        self._shown = take
        self.version += 1
        self._changed()

    def waits(self) -> Work:
        """Stop the present work; return a new one that waits."""
        self.work.stop = True
        self.work = Work()
        self._changed()
        return self.work

    def _reach(self, work: Work, state: str) -> None:
        self._go_on(work)
        work.state, work.share, work.began = state, 0.0, monotonic()
        self.version += 1
        self._changed()

    def _go_on(self, work: Work) -> None:
        """Return if the work may continue.

        Raises:
            StoppedError: the work was stopped.
        """
        if work.stop:
            raise StoppedError("stopped")

    def ended(self, work: Work, error: BaseException) -> None:
        """End the present work with an error.

        After a stop the state is `solved`, or `stopped` without a result, and the choices of the shown result return. After
        another error the state is `failed`, with the text of the error.
        """
        if work is not self.work:
            return
        if isinstance(error, StoppedError):
            work.state = "stopped" if self.editor is None else "solved"
            self.choices, self.dropped = self._before  # those of the shown result
        else:
            mistake = isinstance(error, RobotRetargetError)
            work.state = "failed"
            work.error = str(error) if mistake else f"a defect of robot-retarget: {type(error).__name__}: {error}"
        self._changed()

    def _progress(self, work: Work) -> Callable[[int, int], None]:
        def told(done: int, total: int) -> None:
            self._go_on(work)
            work.share = max(work.share, done / max(total, 1))
            self._changed()

        return told

    def line(self) -> dict[str, Any]:
        """Return the row of the project in the page's list."""
        work, report = self.work, self.editor and self.editor.take.report
        stale = self.editor is not None and self.editor.take.stale
        return {
            "key": self.key, "clip": self.motion_file.name, "robot": self.name,
            "state": work.state, "busy": work.busy, "share": round(work.share, 3), "left": work.left(), "error": work.error,
            "version": self.version, "badge": report.badge.contract() if report and not stale else None,
            "reasons": [*report.reasons, *report.unlike][:1] if report and not stale else [],
        }  # fmt: skip

    def export(self, format: str) -> tuple[Path, str]:
        """Write the shown trajectory, with its judged goals, in a format; `viewer` writes its page.

        Returns:
            The file in a new temporary folder, a zip for several files, and its name.

        Raises:
            UsageError: the project has no solved trajectory, the format is unknown, or it does not support the robot.
        """
        take = self._solved().take
        kind, name = FORMATS.get(format), f"{self.motion_file.stem}-{self.name}"
        scratch = Path(mkdtemp(prefix="robot-retarget-"))
        if format == "viewer":
            return Viewer((take,)).save(scratch / f"{name}.html"), f"{name}.html"
        folder = scratch / name
        folder.mkdir()
        target = folder / f"{name}{kind.suffix if kind else ''}"
        judged = take.report.trajectory if take.report and not take.stale else None
        rr.export(judged or take.trajectory, take.robot, format, target)
        if [*folder.iterdir()] == [target] and target.is_file():
            return target.rename(scratch / target.name), target.name
        return Path(make_archive(str(folder), "zip", folder)), f"{name}.zip"

    def commands(self) -> list[str]:
        """Return the shell commands that write the same files."""
        choices, session = self.choices, self.editor and self.editor.session
        path, (changes, mended) = str(self.trajectory_file), map(str, self.touched)
        robot, over = ["--robot", self.model], ["--map", str(self.map_file)] if self.map_file else []
        edges = ["--edges", str(self.place / "edges.toml")] if self.dropped else []
        how = _given(choices, "balance", "legs", "favour", "fps")
        lines = [["solve", str(self.motion_file), *robot, *over, *edges, *how, "-o", path]]
        if choices["speed"] != "1":
            more = ["--speed", choices["speed"], *_given(choices, "balance")]
            lines.append(["edit", "retime", path, *robot, *more, "-o", path])
        if choices["trim"]:
            lines.append(["edit", "cut", path, *robot, "--trim", choices["trim"], "-o", path])
        if session and session.edits:
            made = ["--motion", str(self.motion_file), "--edges", changes, *over]
            lines.append(["edit", "mend", path, *robot, *made, "-o", mended])
            path = mended
        csv = str(Path(path).with_suffix(".csv"))
        lines += [["simulate", path, *self._judging()], ["export", path, *robot, "--format", "csv", "-o", csv]]
        return [shlex.join(["mkdir", "-p", str(self.place)]), *(shlex.join([PROGRAM, *line]) for line in lines)]

    def _judging(self) -> list[str]:
        more = ["--no-feedback"] if self.choices["feedback"] else []
        return ["--robot", self.model, *more, *_given(self.choices, "objects")]


DRAFT = 0.7
"""Least interval between two poses of a draft on the page [s]."""


def _given(choices: Mapping[str, str], *names: str) -> list[str]:
    """Return the command-line options of choices that differ from their defaults."""
    return [word for name in names if choices[name] != ALLOWED[name][0] for word in (f"--{name}", choices[name])]


def choices_in(command: str) -> dict[str, str]:
    """Return the choices in the command of a cure; an empty table if it has other options only."""
    words = shlex.split(command.partition(" && ")[0])
    found = {name: words[words.index(f"--{name}") + 1] for name in ALLOWED if f"--{name}" in words[:-1]}
    return found | dict(FLAGS[word] for word in words if word in FLAGS)


def _numbers(text: str) -> bool:
    """Return whether a text is a number ≥ 0, or two with a colon."""
    try:
        return all(float(part) >= 0 for part in text.split(":")) and text.count(":") < 2
    except ValueError:
        return False

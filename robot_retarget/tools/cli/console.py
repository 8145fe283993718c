"""Output for people: tables, notes, and errors without tracebacks."""

import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import degrees
from operator import itemgetter
from time import monotonic
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bars
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from robot_retarget.base.errors import printable
from robot_retarget.base.progress import Progress

if TYPE_CHECKING:
    from robot_retarget.judge.report import Report
    from robot_retarget.scores.score import Score


class _Console(Console):
    """Prints text literally: names in files of others are neither markup nor control sequences of the terminal."""

    def __init__(self, **how: Any):
        super().__init__(highlight=False, markup=False, **how)

    def render(self, *what: Any, **how: Any) -> Iterable[Segment]:
        """Yield the segments of something printable; those of other programs' text without control characters."""
        for part in super().render(*what, **how):
            yield part if part.control else Segment(printable(part.text), part.style)

    def on_broken_pipe(self) -> None:
        """Leave a reader that is gone to the end of the command, which has an exit code for it."""
        raise

    def print(self, *objects: Any, **options: Any) -> None:
        """Print without the control characters of names from files, which a terminal would obey."""
        super().print(*(printable(each) if isinstance(each, str) else each for each in objects), **options)


# Piped output is wide, so that a row of a table stays one line.
_WIDTH = None if sys.stdout.isatty() else 200
out: Console = _Console(width=_WIDTH)
_ARGUMENT = re.compile(r"\b(legs|balance|mode|format|fps) '([^']+)'")
err: Console = _Console(stderr=True, soft_wrap=True)
"""Errors."""
side: Console = _Console(stderr=True, soft_wrap=True)
"""Remarks and progress."""


def set_quiet(quiet: bool) -> None:
    """Print errors only, and the JSON of `--json`."""
    out.quiet = side.quiet = quiet


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print rows under headings; numbers stand to the right."""
    grid = Table(title=printable(title), title_justify="left", title_style="bold", box=None, pad_edge=False)
    for k, column in enumerate(columns):
        numbers = bool(rows) and all(isinstance(row[k], int | float) for row in rows)
        grid.add_column(column, justify="right" if numbers else "left", overflow="fold")
    for row in rows:
        grid.add_row(*[Text(printable(_cell(value))) for value in row])
    out.print(grid)
    out.print()


def say(text: str) -> None:
    """Print a sentence."""
    out.print(text)


def begin(command: str) -> None:
    """Print the first words of a command, on a terminal: the libraries that it needs take a second to load."""
    if side.is_terminal:
        side.print(f"{command} …", style="dim")


def note(text: str) -> None:
    """Print a note to stderr, so that piped output stays clean."""
    side.print(f"note: {in_options(text)}", style="dim")


def to_stderr(text: str) -> None:
    """Print a sentence to stderr."""
    side.print(text)


def in_options(text: str) -> str:
    """A sentence of the package in the words of the command line: its `legs 'stand'` is `--legs stand` here."""
    return _ARGUMENT.sub(r"--\1 \2", text)


def show_motion(facts: dict[str, Any]) -> None:
    """Print what `describe_motion` found."""
    turned = "positions and rotations" if facts["rotations"] else "positions only"
    say(f"{facts['source']}: {facts['frames']} frames at {facts['fps']:g} fps ({facts['duration_s']:g} s), {turned}")
    if not facts["human"]:
        say(f"not a human motion: {facts['reason']}")
    else:
        say(f"a human of {facts['stature_m']:.2f} m, legs {facts['leg_m']:.2f} m, {facts['joints']} joints\n")
        rows = [
            (k, v["joint"], f"{v['sure']} ({v['confidence']:.2f})", v["why"]) for k, v in facts["keypoints"].items()
        ]
        table("Keypoints", ("keypoint", "joint", "sure", "because"), rows)
        _missing(facts)
    for body in facts.get("scene", ()):
        size = " × ".join(f"{edge:g}" for edge in body["size_m"])
        touches = "; ".join(f"{t['part']} {t['from_s']:g} to {t['to_s']:g} s" for t in body["touches"])
        say(f"{body['name']}: {body['shape']} {size} m, {body['moves']}, touched by {touches or 'nothing'}")
    for sentence in facts["notes"]:
        say(f"note: {sentence}")
    if facts["human"]:
        say(f"\nnext: robot-retarget run {facts['source']} --robot op3")


def show_robot(facts: dict[str, Any]) -> None:
    """Print what `describe_robot` found."""
    from robot_retarget.robot import shipped_robots

    say(f"{facts['name']}: {len(facts['joints'])} hinges, {facts['root']}, {facts['mass_kg']:g} kg ({facts['path']})\n")
    bounds = ("lower", "upper", "max_speed")
    rows = [(k, *(degrees(v[bound]) for bound in bounds), v["max_torque"]) for k, v in facts["joints"].items()]
    table("Joints", ("joint", "lower [°]", "upper [°]", "speed [°/s]", "torque [N m]"), rows)
    if not facts["humanoid"]:
        say(f"no humanoid: {facts['reason']}")
        return
    rows = [(k, v["body"], v["offset_m"], v["confidence"], v["why"]) for k, v in facts["keypoints"].items()]
    table("Keypoints", ("keypoint", "body", "offset [m]", "sure", "because"), rows)
    _missing(facts)
    name = facts["name"] if facts["name"] in shipped_robots() else facts["path"]
    say(f"\nnext: robot-retarget run MOTION.bvh --robot {name}")


def show_solution(facts: dict[str, Any]) -> None:
    """Print what `describe_solution` found."""
    from robot_retarget.scores.figure import shown

    ended = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in facts["status"].items())
    say(f"solved {facts['frames']} frames at {facts['solved_per_second']} a second: {ended}")
    mean, most = (f"{100 * facts[f'distance_error_{which}']:.1f} %" for which in ("mean", "max"))
    frame, step = facts["distance_error_max_frame"], shown(facts["largest_step_rad"], "rad")
    say(f"distances off by {mean} of their paths, {most} at frame {frame}; largest step {step}")
    for sentence in facts["notes"]:
        note(sentence)


def show_graph(facts: dict[str, Any]) -> None:
    """Print what `describe_graph` found, and `describe_stress` where it was solved."""
    say(f"{facts['robot']}: {facts['frames']} frames at {facts['fps']:g} a second")
    rows = [
        (name, k["edges"], k["present"], k["interval"], k["priority"], "hard" if k["hard"] else "soft")
        for name, k in facts["kinds"].items()
    ]
    table("Kinds of edges", ("kind", "edges", "a frame", "target", "priority", ""), rows)
    if "stress" in facts:
        table("Stress, a frame on the mean", ("kind", "stress"), list(facts["stress"].items()))
        rows = [
            (e["edge"], e["target"], e["measured"], e["error"], e["priority"], e["frame"]) for e in facts["worst_edges"]
        ]
        table("Edges that lost most", ("edge", "target", "measured", "error", "priority", "frame"), rows)


def show_report(report: "Report") -> None:
    """Print a report: verdict, reasons, limits and other figures."""
    from robot_retarget.judge.report_text import cured, facts, headline, judged_lines

    colour = {"pass": "green", "fail": "red"}.get(report.badge.level, "yellow")
    out.print(f"\nverdict: [bold {colour}]{report.badge.text}[/]", markup=True)
    say(headline(report))
    for reasons, what, command in cured(report):
        for reason in reasons:
            say(f"  {reason}")
        if command:
            out.print(f"    what helps: {what}\n      {command}", soft_wrap=True)
    lines = judged_lines(report)
    broken = [line[1:] for line in lines if not line.held]
    if broken:
        table("\nExceeded", ("what", "is", "at most"), broken)
    say(f"{len(lines) - len(broken)} of {len(lines)} limits kept")
    table("\nFigures", ("what", "value", "meaning"), facts(report.figures))
    for sentence in report.figures["notes"]:
        note(sentence)


PLAYED = {
    "tracking_rms_rad": ("tracking error of all joints (rms)", "rad"),
    "worst_joint": ("joint that follows worst", ""),
    "worst_joint_rms_rad": ("its tracking error (rms)", "rad"),
    "largest_current_a": ("largest current of a servo", "A"),
    "hottest_c": ("hottest servo at the end", "°C"),
    "rate_hz": ("goals sent", "a second"),
    "jitter_p99_ms": ("tick jitter (p99)", "ms"),
    "late_p99_ms": ("tick delay (p99)", "ms"),
    "skipped_ticks": ("skipped ticks", ""),
    "lost_replies": ("lost servo replies", ""),
}
"""Figures of a playback that a person reads: words and unit."""


def show_playback(figures: dict[str, Any]) -> None:
    """Print the figures of a playback, with the limited joints and their ticks."""
    from robot_retarget.scores.figure import shown

    rows = [
        (what, value if isinstance(value, str) else shown(value, unit))
        for name, (what, unit) in PLAYED.items()
        if (value := figures.get(name)) is not None
    ]
    rows += [(f"{joint} was limited", f"{n} ticks") for joint, n in figures.get("limited", {}).items()]
    unnoticed = figures.get("jams_unnoticed")
    rows += [("moved too little to notice a jam", ", ".join(unnoticed))] if unnoticed else []
    if rows:
        table("Played", ("what", "value"), rows)


def show_warnings(facts: dict[str, Any]) -> None:
    """Print the events of a trajectory's warnings, a line each."""
    events, figures = facts["events"], facts["figures"]
    frames, fps = figures["frames"], figures["fps"]
    say(f"{figures['events']} warnings in {frames} frames at {fps:g} fps, {figures['contacts']} ended in contact")
    figures_of = itemgetter("first_warning", "predicted_contact", "contact", "lead_s", "depth_m")
    rows = [(" – ".join(event["pair"]), *figures_of(event)) for event in events]
    if rows:
        columns = ("pair", "first warning", "predicted contact", "contact", "lead (s)", "depth foreseen (m)")
        table("", columns, rows)


STREAMED = {
    "frames": ("frames solved", ""),
    "seconds": ("length of the stream", "s"),
    "dropped": ("frames dropped for newer ones", ""),
    "late": ("late frames", ""),
    "held": ("poses without a new frame", ""),
    "latency_p50_ms": ("latency from frame to pose, median", "ms"),
    "latency_p99_ms": ("latency, 99th percentile", "ms"),
    "latency_max_ms": ("latency, maximum", "ms"),
}
"""Figures of a live stream that a person reads: words and unit."""


def show_stream(figures: dict[str, Any]) -> None:
    """Print on the side what went through a stream, and each kind of fault with its number."""
    lines = [
        f"{what}: {value:g} {unit}".rstrip()
        for name, (what, unit) in STREAMED.items()
        if (value := figures.get(name)) is not None
    ]
    lines += [f"{kind}: {times} times" for kind, times in figures["faults"].items()]
    for line in lines:
        to_stderr(line)


def show_score(score: "Score") -> None:
    """Print the figures that apply, a line each; figures that do not are named at the end."""
    from robot_retarget.scores.score import FIGURES

    say(f"{score.source} on {score.robot}: {score.frames} frames at {score.fps:g} frames per second")
    found = {name: value for name, value in score.figures.items() if value is not None}
    rows = [
        (name, f"{v:.{FIGURES[name].digits}f}", FIGURES[name].unit, FIGURES[name].what) for name, v in found.items()
    ]
    table("", ("figure", "value", "unit", "meaning"), rows)
    if missing := [name for name in score.figures if name not in found]:
        say(f"do not apply: {', '.join(missing)}")
    for sentence in score.notes:
        note(sentence)


def show_followed(facts: Mapping[str, Any]) -> None:
    """Print trajectories by how a controller follows them, a line each."""
    rows = [
        (row["name"], f"{row['falls']} of {row['worlds']}", f"{row['error_rad']:.3f}") for row in facts["trajectories"]
    ]
    table("", ("trajectory", f"falls under {facts['policy']}", "joints off the plan (rms) [rad]"), rows)


def dump(value: Any, side: bool = False) -> None:
    """Print a value as JSON; on stderr if stdout carries other data."""
    print(printable(as_json(value), "\\u{:04x}".format), file=sys.stderr if side else None)


def as_json(value: Any) -> str:
    """A value as indented JSON."""
    return json.dumps(value, indent=1, ensure_ascii=False)


def _missing(facts: dict[str, Any]) -> None:
    if facts["missing"]:
        say(f"missing: {', '.join(facts['missing'])}")
    for sentence in facts["remarks"]:
        say(f"note: {sentence}")


def _cell(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else "-" if value is None else str(value)


# Progress bars with the time left, on stderr if that is a terminal.


def _bars(share: ProgressColumn) -> Bars:
    """Return bars with a description, the completed share and the time left."""
    columns = TextColumn("{task.description}"), BarColumn(), share, TimeRemainingColumn()
    return Bars(*columns, console=side, transient=True, disable=side.quiet or not side.is_terminal)


@contextmanager
def progress() -> Iterator[Callable[[str], Progress]]:
    """Yield a function that begins a stage, in place of the one before, and returns the receiver of its progress."""
    with _bars(TaskProgressColumn()) as bars:
        bar = bars.add_task("")

        def begin(stage: str) -> Progress:
            bars.reset(bar, description=stage, total=None)
            return lambda done, total: bars.update(bar, completed=done, total=total)

        yield begin


LINES = 30.0
"""Interval of lines of progress where no terminal shows a bar [s]."""


@contextmanager
def tally(total: int, stopping: Callable[[], bool]) -> Iterator[Callable[[bool], None]]:
    """Show a bar over independent pieces, or lines without a terminal: number done, number failed, rate, time left.

    Yields a function that reports whether a piece succeeded.
    """
    began, failed, done, told = monotonic(), 0, 0, monotonic()
    with _bars(TextColumn("{task.completed:.0f}/{task.total:.0f}")) as bars:
        bar = bars.add_task("clips", total=total)

        def report(well: bool) -> None:
            nonlocal failed, done, told
            done, failed = done + 1, failed + (not well)
            rate = done / max(monotonic() - began, 1e-9)
            description = f"{rate:.2f} clips/s, {failed} failed" + (", finishing" if stopping() else "")
            bars.update(bar, completed=done, description=description)
            if not side.is_terminal and (done == total or monotonic() - told >= LINES):
                told = monotonic()
                to_stderr(f"{done}/{total} clips, {description}, {(total - done) / rate:.0f} s left")

        yield report

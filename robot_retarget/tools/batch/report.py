"""Everything that a run writes at its end: summary, lists of filters, pictures of examples."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import RobotRetargetError, UsageError
from robot_retarget.base.files import folder, replacing, write_csv, write_text
from robot_retarget.base.pages import rendered
from robot_retarget.base.untrusted.arrays import save_npz
from robot_retarget.base.untrusted.pickles import dump_pickle, load_pickle
from robot_retarget.formats import FORMATS, FormatOptions
from robot_retarget.formats.robot_motion import RobotMotion, robot_motion
from robot_retarget.scores.score import FIGURES
from robot_retarget.tools.batch.filters import Chosen, Filter, choose
from robot_retarget.tools.batch.task import DONE, Job, Row, robot_of
from robot_retarget.tools.view.page import STYLE
from robot_retarget.trajectory import load_trajectory

# `summary.html`: a table to sort and search, histograms, reasons, and clips to look at. No script from elsewhere: it opens offline.

TEMPLATE = Path(__file__).with_name("summary.html")
SHOWN = (
    "limb_deg_mean", "near_err", "contact_recall", "skate_cm_s", "self_pen_max_cm", "ground_pen_max_cm",
    "float_med_cm", "speed_p99", "jerk_rms", "root_residual", "zmp_out_pct", "torque_over_pct", "flight_pct",
)  # fmt: skip
"""Figures of the page; `summary.csv` has all."""
BINS, WIDTH, HEIGHT = 24, 220, 70
"""Of a histogram: bars, and its size [pixels]."""


@dataclass(frozen=True)
class ClipCard:
    """A clip with its pictures, named relative to the page."""

    row: Row
    why: str
    strip: str | None
    viewer: str | None


def save_page(rows: Sequence[Row], chosen: Sequence[Chosen], cards: Sequence[ClipCard], path: Path) -> Path:
    """Write the page, whole or not at all."""
    states = Counter(row.state for row in rows)
    reasons = reasons_of(chosen)
    histograms = {name: found for name in SHOWN if (found := _histogram(rows, name))}
    page = rendered(
        TEMPLATE,
        style=STYLE.read_text(encoding="utf-8"),
        headline=f"{len(rows)} clips × robots: " + ", ".join(f"{n} {state}" for state, n in sorted(states.items())),
        frames=f"{sum(row.frames for row in rows):,} frames",
        filters=[_filter(one) for one in chosen],
        width=WIDTH,
        height=HEIGHT,
        histograms=[*histograms.values()],
        cards=cards,
        columns=["clip", "robot", "state", "frames", *histograms],
        rows=[
            {
                "values": [row.clip, row.robot, row.state, row.frames, *(row.figures.get(name) for name in histograms)],
                "why": reasons.get(row.key, []),
                "message": row.message,
            }
            for row in rows
        ],
        units={name: FIGURES[name].unit for name in histograms},
    )
    return write_text(path, page)


def _filter(one: Chosen) -> tuple[str, str, list[str]]:
    """Return a filter's name, how many clips pass it, and each reason of the others with the number of clips."""
    total = len(one.passed) + len(one.rejected)
    counts = Counter(kind for _, reasons in one.rejected for kind in {_kind(reason) for reason in reasons})
    return one.filter.name, f"{len(one.passed)} of {total}", [f"{kind}: {n}" for kind, n in counts.most_common()]


def _kind(reason: str) -> str:
    """Return a reason without its value: the figure and its bound, or the state of a clip that failed."""
    bound = re.sub(r"^(\S+) \S+ (.*?)is (above|below)", r"\1 \3", reason)
    return bound if " is " in reason else reason.partition(":")[0]


def reasons_of(chosen: Sequence[Chosen]) -> dict[tuple[str, str], list[str]]:
    """Return, by robot and clip that was solved, each reason with the filters that leave it out."""
    found: dict[tuple[str, str], dict[str, list[str]]] = {}
    for one in chosen:
        for row, reasons in one.rejected:
            for reason in reasons if row.state == DONE else ():
                found.setdefault(row.key, {}).setdefault(reason, []).append(one.filter.name)
    return {
        key: [f"{reason}: {', '.join(names)}" if len(chosen) > 1 else reason for reason, names in by_reason.items()]
        for key, by_reason in found.items()
    }


def examples_of(rows: Sequence[Row], chosen: Sequence[Chosen], count: int) -> list[tuple[Row, str]]:
    """Return clips to look at: one for each of the `count` commonest reasons, and `count` that every filter lets through."""
    kinds = Counter(_kind(reason) for one in chosen for _, reasons in one.rejected for reason in reasons)
    shown: dict[tuple[str, str], tuple[Row, str]] = {}
    for kind, _ in kinds.most_common():
        pairs = ((row, why) for one in chosen for row, reasons in one.rejected for why in reasons if _kind(why) == kind)
        fresh = next((pair for pair in pairs if pair[0].state == DONE and pair[0].key not in shown), None)
        if fresh is not None and len(shown) < count:
            shown[fresh[0].key] = fresh
    out = {row.key for one in chosen for row, _ in one.rejected}
    passed = [(row, "every filter lets it through") for row in rows if row.state == DONE and row.key not in out]
    return [*shown.values(), *passed[:count]]


def _histogram(rows: Sequence[Row], name: str) -> dict[str, object] | None:
    """Return a figure's histogram, its bars as shares of the tallest; None for a figure without values."""
    values = np.array([v for row in rows if (v := row.figures.get(name)) is not None], dtype=float)
    if not values.size:
        return None
    low, high = (float(end) for end in np.percentile(values, [1, 99]))
    counts, _ = np.histogram(values.clip(low, high), BINS, (low, high if high > low else low + 1))
    range_ = f"{low:.3g} … {high:.3g}, median {np.median(values):.3g}"
    figure = FIGURES[name]
    return {"name": name, "what": figure.what, "unit": figure.unit, "shares": counts / counts.max(), "range": range_}


# The results as a table: `summary.csv`.

FACTS = ("robot", "clip", "state", "message", "frames", "fps", "path", "output_sha256")


def save_csv(rows: Iterable[Row], path: Path) -> Path:
    """A line for each clip on each robot: facts, then figures, in the order of the table."""
    lines = (
        [*(getattr(r, fact) for fact in FACTS), *("" if (v := r.figures.get(name)) is None else v for name in FIGURES)]
        for r in rows
    )
    return write_csv(path, (*FACTS, *FIGURES), lines)


LISTS, PICTURES = "lists", "pictures"


def write_reports(rows: Sequence[Row], filters: Sequence[Filter], job: Job, pictures: int) -> list[Chosen]:
    """Write `summary.csv`, `summary.html`, `lists/` and `pictures/` into the folder of results.

    Args:
        pictures: how many clips that are left out, and how many that pass, get a strip and a viewer.
    """
    out = job.out
    save_csv(rows, out / "summary.csv")
    chosen = [choose(rows, one) for one in filters]
    for one in chosen:
        _save_lists(one, folder(out / LISTS))
    shown = [_pictured(row, why, job) for row, why in examples_of(rows, chosen, pictures)]
    save_page(rows, chosen, shown, out / "summary.html")
    return chosen


def _save_lists(one: Chosen, target: Path) -> None:
    """The outputs that pass, a path a line, and the others with their reasons."""
    write_text(target / f"{one.filter.name}.txt", "".join(f"{row.robot}/{row.clip}.npz\n" for row in one.passed))
    rejected = ((row.robot, row.clip, "; ".join(reasons)) for row, reasons in one.rejected)
    write_csv(target / f"{one.filter.name}_rejected.csv", ("robot", "clip", "reasons"), rejected)


def _pictured(row: Row, why: str, job: Job) -> ClipCard:
    """Draw a strip and a viewer of a row."""
    from robot_retarget.tools.view.film import strip
    from robot_retarget.tools.view.picture import Picture
    from robot_retarget.tools.view.web.take import Take
    from robot_retarget.tools.view.web.viewer import Viewer
    from robot_retarget.trajectory import load_trajectory

    name = next(name for name in job.robots if robot_of(name, job.settings.limits).name == row.robot)
    robot, target = robot_of(name, job.settings.limits), folder(job.out / PICTURES)
    stem = f"{row.robot}-{row.clip.replace('/', '-')}"
    try:
        trajectory = load_trajectory(job.out / row.robot / f"{row.clip}.npz")
        Viewer((Take(robot, trajectory),)).save(target / f"{stem}.html")
        picture = strip(robot, trajectory, count=6, height=240)
    except RobotRetargetError:
        return ClipCard(row, why, None, None)
    if isinstance(picture, Picture):
        picture.save(target / f"{stem}.png")
    drawn = f"{PICTURES}/{stem}.png" if isinstance(picture, Picture) else None
    return ClipCard(row, why, drawn, f"{PICTURES}/{stem}.html")


# All clips of a robot in one file, as trainers load them.

FOLDER = "packed"


def pack_all(rows: Sequence[Row], job: Job, format: str) -> str:
    """Write one file of a packed format for each robot; returns their paths.

    Raises:
        UsageError: the robot does not suit the format, or its clips differ in their frame rate.
    """
    written = list[Path]()
    for name in job.robots:
        robot = robot_of(name, job.settings.limits)
        done = [row for row in rows if row.robot == robot.name and row.state == DONE]
        if not done:
            continue
        motions = []
        for row in done:
            trajectory = load_trajectory(job.out / row.robot / f"{row.clip}.npz")
            kind = FORMATS[format]
            motions.append(
                (row.clip, robot_motion(trajectory, robot, FormatOptions(), kind.fps, kind.ordered, kind.name))
            )
        target = folder(job.out / FOLDER) / f"{robot.name}-{format}{FORMATS[format].suffix}"
        with replacing(target) as scratch:
            PACKED[format](motions, scratch)
        written.append(target)
    return ", ".join(map(str, written)) or "nothing: no clip is done"


Motions = Sequence[tuple[str, RobotMotion]]


def _locomujoco(motions: Motions, path: Path) -> None:
    """LocoMuJoCo's Trajectory of several clips: tracks one after the other, `split_points` where each begins."""
    rates = {motion.fps for _, motion in motions}
    if len(rates) > 1:
        raise UsageError(
            f"one frame rate a file: the clips have {', '.join(f'{rate:g}' for rate in sorted(rates))}; use --fps"
        )
    parts = [_arrays(motion, path) for _, motion in motions]
    lengths = [len(motion) for _, motion in motions]
    every: dict[str, Any] = dict(parts[0])
    for key in TRACKS:
        every[key] = np.concatenate([part[key] for part in parts])
    every["split_points"] = np.concatenate([[0], np.cumsum(lengths)])
    save_npz(path, **every)


TRACKS = ("qpos", "qvel", "xpos", "xquat", "cvel", "subtree_com", "site_xpos", "site_xmat")


def _arrays(motion: RobotMotion, path: Path) -> dict[str, Any]:
    """The arrays of one clip, as its format writes them."""
    single = path.with_name(f"{path.name}.one.npz")
    try:
        FORMATS["locomujoco"].write(motion, single)
        with np.load(single, allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
    finally:
        single.unlink(missing_ok=True)


def _phc(motions: Motions, path: Path) -> None:
    """PHC's dictionary of clips by name, which SONIC and ASAP load too."""
    clips: dict[str, Any] = {}
    for name, motion in motions:
        FORMATS["phc"].write(motion, path)
        clips[name] = next(iter(load_pickle(path).values()))
    path.write_bytes(dump_pickle(clips))


PACKED: dict[str, Callable[[Motions, Path], None]] = {"locomujoco": _locomujoco, "phc": _phc}
"""By format; a new packed form is a function and a line here."""

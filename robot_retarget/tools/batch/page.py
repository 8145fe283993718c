"""`summary.html`: a table to sort and search, histograms, and the best and the worst clips. No script from elsewhere: it opens offline."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_retarget.base.files import write_text
from robot_retarget.base.pages import rendered
from robot_retarget.scores.table import FIGURES
from robot_retarget.tools.batch.filters import Chosen
from robot_retarget.tools.batch.task import DONE, Row

TEMPLATE = Path(__file__).with_name("summary.html")
SHOWN = (
    "physics_score", "limb_deg_mean", "near_err", "contact_recall", "skate_cm_s", "self_pen_max_cm", "ground_pen_max_cm",
    "float_med_cm", "speed_p99", "jerk_rms", "root_residual", "zmp_out_pct", "torque_over_pct", "flight_pct",
)  # fmt: skip
"""Figures of the page; `summary.csv` has all."""
BINS, WIDTH, HEIGHT = 24, 220, 70
"""Of a histogram: bars, and its size [pixels]."""


@dataclass(frozen=True)
class ClipCard:
    """A clip with its pictures, named relative to the page."""

    row: Row
    strip: str | None
    viewer: str | None


def save_page(
    rows: Sequence[Row], chosen: Sequence[Chosen], extremes: Sequence[ClipCard], duplicates: int, path: Path
) -> Path:
    """Write the page, whole or not at all."""
    states = Counter(row.state for row in rows)
    frames = sum(row.frames for row in rows)
    page = rendered(
        TEMPLATE,
        headline=f"{len(rows)} clips × robots: " + ", ".join(f"{n} {state}" for state, n in sorted(states.items())),
        frames=f"{frames:,} frames; {duplicates} pairs of near-duplicates",
        filters=[_filter(one) for one in chosen],
        width=WIDTH,
        height=HEIGHT,
        histograms=[found for name in SHOWN if (found := _histogram(rows, name))],
        extremes=extremes,
        columns=["robot", "clip", "state", "frames", *SHOWN, "message"],
        rows=[[r.robot, r.clip, r.state, r.frames, *(r.figures.get(n) for n in SHOWN), r.message] for r in rows],
        units={name: FIGURES[name].unit for name in SHOWN},
    )
    return write_text(path, page)


def _filter(one: Chosen) -> tuple[str, str, str]:
    """Return a filter's name, how many clips pass it, and the commonest first reasons of the others."""
    total = len(one.passed) + len(one.rejected)
    first = Counter(reasons[0].split(" ")[0] for _, reasons in one.rejected).most_common(3)
    return one.filter.name, f"{len(one.passed)} of {total}", ", ".join(f"{name} {count}" for name, count in first)


def _histogram(rows: Sequence[Row], name: str) -> dict[str, object] | None:
    """Return a figure's histogram, its bars as shares of the tallest; None where it does not apply."""
    values = np.array([v for row in rows if (v := row.figures.get(name)) is not None], dtype=float)
    if not values.size:
        return None
    low, high = (float(end) for end in np.percentile(values, [1, 99]))
    counts, _ = np.histogram(values.clip(low, high), BINS, (low, high if high > low else low + 1))
    range_ = f"{low:.3g} … {high:.3g}, median {np.median(values):.3g}"
    figure = FIGURES[name]
    return {"name": name, "what": figure.what, "unit": figure.unit, "shares": counts / counts.max(), "range": range_}


def extremes_of(rows: Sequence[Row], count: int) -> list[Row]:
    """The worst and the best rows by their physics score, `count` of each."""
    scored = [row for row in rows if row.state == DONE and row.figures.get("physics_score") is not None]
    ordered = sorted(scored, key=lambda row: (row.figures["physics_score"], row.key))
    return ordered if len(ordered) <= 2 * count else [*ordered[:count], *ordered[-count:]]

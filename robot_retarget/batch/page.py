"""`summary.html`: a table to sort and search, histograms, and the best and the worst clips. No script from elsewhere: it opens offline."""

import html
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np

from robot_retarget.batch.filters import Chosen
from robot_retarget.batch.manifest import Row
from robot_retarget.batch.task import DONE
from robot_retarget.files import replacing
from robot_retarget.score.table import FIGURES

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
    page = Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        headline=html.escape(
            f"{len(rows)} clips × robots: " + ", ".join(f"{n} {state}" for state, n in sorted(states.items()))
        ),
        frames=f"{frames:,} frames; {duplicates} pairs of near-duplicates",
        filters="".join(_filter(one) for one in chosen),
        histograms="".join(_histogram(rows, name) for name in SHOWN),
        extremes="".join(_extreme(one) for one in extremes),
        columns=_json(["robot", "clip", "state", "frames", *SHOWN, "message"]),
        rows=_json([[r.robot, r.clip, r.state, r.frames, *(r.figures.get(n) for n in SHOWN), r.message] for r in rows]),
        units=_json({name: FIGURES[name].unit for name in SHOWN}),
    )
    with replacing(path) as scratch:
        scratch.write_text(page, encoding="utf-8")
    return path


def _json(value: object) -> str:
    """JSON without `<`, which could end the script around it."""
    return json.dumps(value, ensure_ascii=False).replace("<", "\\u003c")


def _filter(one: Chosen) -> str:
    total = len(one.passed) + len(one.rejected)
    first = Counter(reasons[0].split(" ")[0] for _, reasons in one.rejected).most_common(3)
    why = ", ".join(f"{html.escape(name)} {count}" for name, count in first)
    return f"<tr><td>{html.escape(one.filter.name)}</td><td>{len(one.passed)} of {total}</td><td>{why}</td></tr>"


def _histogram(rows: Sequence[Row], name: str) -> str:
    """An SVG of a figure's values; empty where none applies."""
    values = np.array([v for row in rows if (v := row.figures.get(name)) is not None], dtype=float)
    if not values.size:
        return ""
    low, high = (float(end) for end in np.percentile(values, [1, 99]))
    counts, _ = np.histogram(values.clip(low, high), BINS, (low, high if high > low else low + 1))
    step, tall = WIDTH / BINS, counts.max()
    bars = "".join(
        f'<rect x="{k * step:.1f}" y="{HEIGHT * (1 - n / tall):.1f}" width="{step - 1:.1f}" height="{HEIGHT * n / tall:.1f}"/>'
        for k, n in enumerate(counts)
    )
    unit = f" [{FIGURES[name].unit}]" if FIGURES[name].unit else ""
    said = f"{low:.3g} … {high:.3g}, median {np.median(values):.3g}"
    return (
        f'<figure title="{html.escape(FIGURES[name].what)}"><figcaption>{name}{html.escape(unit)}</figcaption>'
        f'<svg width="{WIDTH}" height="{HEIGHT}">{bars}</svg><small>{said}</small></figure>'
    )


def _extreme(shown: ClipCard) -> str:
    row = shown.row
    title = html.escape(f"{row.clip} on {row.robot}")
    link = f'<a href="{html.escape(shown.viewer)}">{title}</a>' if shown.viewer else title
    picture = f'<img src="{html.escape(shown.strip)}" alt="{title}">' if shown.strip else ""
    value = row.figures.get("physics_score")
    return f"<div><p>{link}: {'-' if value is None else f'{value:g}'} points</p>{picture}</div>"


def extremes_of(rows: Sequence[Row], count: int) -> list[Row]:
    """The worst and the best rows by their physics score, `count` of each."""
    scored = [row for row in rows if row.state == DONE and row.figures.get("physics_score") is not None]
    ordered = sorted(scored, key=lambda row: (row.figures["physics_score"], row.key))
    return ordered if len(ordered) <= 2 * count else [*ordered[:count], *ordered[-count:]]

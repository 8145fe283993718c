"""The report's charts, drawn by matplotlib as SVG: sharp at any size, printable, and quiet without a line of script."""

import io
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats, intervals
from robot_retarget.base.errors import install_line
from robot_retarget.collision import Warnings
from robot_retarget.judge.report import Report
from robot_retarget.tools.view.picture import Unavailable

INK, FAINT, GRID = "#1f2933", "#9aa5b1", "#e4e7eb"
WANTED, MEASURED, PLAIN, ALARM = FAINT, "#0b7285", "#e8890c", "#c92a2a"
NAMES = {INK: "ink", FAINT: "axis", GRID: "line", MEASURED: "measured", PLAIN: "plain", ALARM: "fail"}
"""Colours that the page replaces in its dark theme, and its names for them."""
LOADS = [(0.0, "#e8890c00"), (0.6, "#e8890ccc"), (1.0, "#c92a2aff")]
"""Colours of torques from none to the limit; the ground of the page shows through the first."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9,
    "text.color": INK,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
}
WIDTH = 10.4
"""Of every chart [inches]."""
JOINTS = 6
"""Number of joints with curves, the worst first."""
ANGLES = ("wanted", "plain", "measured")
"""Series of angles of a report."""
PAIRS = 14
"""Number of pairs of links in the timeline, the earliest first."""


def tracking(report: Report) -> str:
    """Wanted, plain and measured angles of the joints that were worst without compensation."""
    series, names = report.series, report.joint_names
    worst = np.argsort(-_plain_rms(report))[: min(JOINTS, len(names))]

    def draw(figure: Any) -> None:
        rows = (len(worst) + 1) // 2
        grid = figure.subplots(rows, 2, sharex=True, squeeze=False)
        for axes, joint in zip(grid.ravel(), worst, strict=False):
            time, angles = series["time"], {kind: np.degrees(series[kind][:, joint]) for kind in ANGLES}
            axes.plot(time, angles["wanted"], color=WANTED, lw=3.2, label="wanted")
            if report.figures["compensated"]:
                axes.plot(time, angles["plain"], color=PLAIN, lw=1, label="plain playback")
            axes.plot(time, angles["measured"], color=MEASURED, lw=1.3, label="measured")
            axes.set_title(f"{names[joint]} [°]")
        for axes in grid.ravel()[len(worst) :]:
            axes.set_axis_off()
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=3)

    return _svg("tracking", 1.45 * ((len(worst) + 1) // 2) + 0.6, draw)


def _plain_rms(report: Report) -> Floats:
    """(n,) rms errors [rad] without compensation, over the frames that were reached."""
    error = report.series["plain"] - report.series["wanted"]
    return np.sqrt(np.nansum(error**2, axis=0) / max(int(np.isfinite(error).all(axis=1).sum()), 1))


def errors(report: Report) -> str:
    """The rms error of every joint, with and without compensation."""
    joints = report.figures["joints"]
    names = list(joints)
    plain = _plain_rms(report)
    order = {name: k for k, name in enumerate(report.joint_names)}

    def draw(figure: Any) -> None:
        axes, place = figure.subplots(), np.arange(len(names))
        if report.figures["compensated"]:
            axes.bar(
                place,
                np.degrees([plain[order[n]] for n in names]),
                0.72,
                color=PLAIN,
                alpha=0.45,
                label="plain playback",
            )
        axes.bar(place, np.degrees([joints[n]["rms_rad"] for n in names]), 0.44, color=MEASURED, label="as played")
        axes.set_xticks(place, names, rotation=55, ha="right", rotation_mode="anchor")
        axes.set_ylabel("rms error [°]")
        axes.grid(axis="x", visible=False)
        axes.margins(x=0.01)
        figure.legend(loc="outside upper right", ncols=2)

    return _svg("errors", 2.5, draw)


def torques(report: Report) -> str:
    """How much of its bound each servo gives, over time."""
    from matplotlib.colors import LinearSegmentedColormap

    bounds, names = report.series["bounds"], report.joint_names
    known = [names.index(joint) for joint in report.figures["joints"] if np.isfinite(bounds[names.index(joint)])]
    share = np.abs(report.series["torque"][:, known]) / bounds[known]

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        time = report.series["time"]
        span = (time[0], time[-1] if len(time) > 1 else 1.0, len(known) - 0.5, -0.5)
        heat = LinearSegmentedColormap.from_list("loads", LOADS)
        image = axes.imshow(share.T, aspect="auto", extent=span, vmin=0, vmax=1, cmap=heat, interpolation="nearest")
        axes.set_yticks(range(len(known)), [names[k] for k in known])
        axes.set_xlabel("time [s]")
        axes.grid(visible=False)
        bar = figure.colorbar(image, ax=axes, pad=0.01, aspect=30)
        bar.set_label("torque / limit")
        bar.outline.set_visible(False)

    return _svg("torques", 0.19 * len(known) + 0.9, draw) if known and len(share) else ""


def balance(report: Report) -> str:
    """The centre of mass and the zero moment point over the soles, and how far inside they stay."""
    series = report.series
    if "com" not in series:
        return ""

    time, fall = series["state_time"], report.figures.get("fall_s")
    standing = (time >= 0) & (time < (np.inf if fall is None else fall))

    def draw(figure: Any) -> None:
        plan, margin = figure.subplots(1, 2, width_ratios=(1, 1.25))
        _floor_plan(plan, {name: series[name][standing] for name in ("soles", "down", "zmp", "com")})
        for name, colour, label in (
            ("zmp_margin", PLAIN, "zero moment point"),
            ("com_margin", MEASURED, "centre of mass"),
        ):
            margin.plot(time, 100 * np.where(standing, series[name], np.nan), color=colour, lw=1.2, label=label)
        margin.axhline(0, color=ALARM, lw=1)
        if fall is not None:
            margin.axvline(fall, color=ALARM, lw=1, ls="--")
            margin.text(fall, 1, " fell", color=ALARM, transform=margin.get_xaxis_transform(), va="top")
        seen = 100 * np.concatenate([series[name][standing] for name in ("com_margin", "zmp_margin")])
        margin.set_ylim(max(np.nanmin(seen, initial=0) - 1, -15), np.nanmax(seen, initial=1) + 1)
        margin.set_title("margin to the edge of the support [cm]")
        margin.set_xlabel("time [s]")
        margin.legend(loc="lower right", ncols=2)

    return _svg("balance", 3.4, draw)


def _floor_plan(axes: Any, series: Any) -> None:
    """Draw the support polygons, the zero moment point and the centre of mass, seen from above."""
    from matplotlib.collections import PolyCollection
    from scipy.spatial import ConvexHull, QhullError

    outlines, last = [], None
    for soles, down in zip(series["soles"][::5], series["down"][::5].astype(bool), strict=True):
        try:
            corners = soles[down]
            outline = corners[ConvexHull(corners).vertices]
        except (QhullError, ValueError):
            continue
        if last is None or outline.shape != last.shape or np.abs(outline - last).max() > 0.004:
            outlines.append(100 * outline)
            last = outline
    axes.add_collection(PolyCollection(outlines, facecolors="#0b72850f", edgecolors="#0b728566", linewidths=0.8))
    axes.plot(*(100 * series["zmp"]).T, color=PLAIN, lw=0.8, label="zero moment point")
    axes.plot(*(100 * series["com"]).T, color=MEASURED, lw=1.6, label="centre of mass")
    axes.set_aspect("equal", adjustable="box")
    if outlines:
        every = np.concatenate(outlines)
        low, high = every.min(0) - 2, every.max(0) + 2
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
    axes.set_title("from above [cm]")


def timeline(report: Report, warnings: Warnings | None) -> str:
    """Draw the warnings of each pair, its contacts in the plan, and the start of its contacts on the servos."""
    if warnings is None or not warnings.flagged.any():
        return ""
    shown = np.flatnonzero(warnings.flagged.any(axis=0))
    shown = shown[np.argsort(warnings.flagged[:, shown].argmax(axis=0), kind="stable")][:PAIRS]

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        for row, pair in enumerate(shown):
            for flags, colour, alpha in ((warnings.flagged, PLAIN, 0.55), (warnings.touching, ALARM, 1.0)):
                bars = [
                    (first / warnings.fps, (stop - first) / warnings.fps) for first, stop in intervals(flags[:, pair])
                ]
                axes.broken_barh(bars, (row - 0.36, 0.72), color=colour, alpha=alpha, lw=0)
            at = [time for links, time in report.touches if links == frozenset(warnings.pairs[pair])]
            axes.plot(at, [row] * len(at), "v", color=ALARM, ms=4.5, mew=0)
        axes.set_yticks(range(len(shown)), [" – ".join(warnings.pairs[pair]) for pair in shown])
        axes.set_ylim(len(shown) - 0.4, -0.6)
        axes.set_xlim(0, max(len(warnings) - 1, 1) / warnings.fps)
        axes.set_xlabel("time [s]")
        axes.grid(axis="y", visible=False)

    return _svg("timeline", 0.24 * len(shown) + 0.8, draw)


def _svg(name: str, height: float, draw: Callable[[Any], None]) -> str:
    """What `draw` puts on a figure, as an `<svg>` element for a page; ids are the chart's own."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with matplotlib.rc_context({**STYLE, "svg.hashsalt": name, "svg.id": name}):
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    return _themed(text.getvalue()[text.getvalue().index("<svg") :])


def _themed(svg: str) -> str:
    """The element with its colours under the page's names, so that a theme can replace them."""

    def named(found: re.Match[str]) -> str:
        name = NAMES.get(found[2])
        return f"{found[1]}: var(--{name}, {found[2]})" if name else found[0]

    return re.sub(r"(fill|stroke): (#[0-9a-f]{6})\b", named, svg)


def without_matplotlib() -> Unavailable | None:
    """Return why curves cannot be drawn, if they cannot."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        return Unavailable(f"curves need matplotlib: {install_line('plots')}")
    return None

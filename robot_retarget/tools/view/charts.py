"""The report's charts, drawn by matplotlib as SVG: sharp at any size, printable, and quiet without a line of script."""

import io
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_retarget.base.arrays import Floats, intervals
from robot_retarget.base.errors import install_line
from robot_retarget.collision import Warnings
from robot_retarget.judge.report import Report
from robot_retarget.tools.view.picture import Unavailable

if TYPE_CHECKING:
    from robot_retarget.servo.predict import Prediction

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
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
}
WIDTH = 4.7
"""Width of every chart [inches]: a telephone shows it at its own size, and a wide page shows two in a row."""
LETTERS = 40
"""Longest line of a name next to a chart [letters]: about half of its width."""
LINE = 0.19
"""Height of a name [inches]."""
LETTER = 0.07
"""Mean width of its letters, 0.56 of their height of 9 points [inches]."""
MARGIN, BELOW = 0.18, 0.42
"""Around a chart, and below it: two lines of text and their ticks [inches]. matplotlib finds margins by drawing a chart twice more."""
CURVES = 6
"""Number of joints with curves, the worst first."""
ANGLES = ("wanted", "plain", "measured")
"""Series of angles of a report."""
TIMELINE_PAIRS = 14
"""Number of pairs of links in the timeline, the earliest first."""


KEYS = {
    "wanted": ("axis", "wanted"), "plain": ("plain", "plain playback"), "measured": ("measured", "as played"),
    "zmp": ("plain", "zero moment point"), "com": ("measured", "centre of mass"),
    "warned": ("plain", "warned"), "touch": ("fail", "contact in the plan; triangle: contact on the servos begins"),
}  # fmt: skip
"""Colour of the page and meaning, for every series."""


class Chart(NamedTuple):
    """A picture and its name."""

    name: str
    svg: str


def tracking(report: Report) -> list[Chart]:
    """Wanted, plain and measured angles of the joints that were worst without compensation."""
    series, names = report.series, report.joint_names

    def chart(joint: int) -> Chart:
        def draw(axes: Any) -> None:
            for kind, colour, width in zip(ANGLES, (WANTED, PLAIN, MEASURED), (3.2, 1, 1.3), strict=True):
                if kind != "plain" or report.figures["compensated"]:
                    axes.plot(series["time"], np.degrees(series[kind][:, joint]), color=colour, lw=width)
            axes.set_xlabel("time [s]")

        return Chart(f"{names[joint]} [°]", _svg(f"tracking-{joint}", 1.5, draw))

    return [chart(joint) for joint in np.argsort(-_plain_rms(report))[:CURVES].tolist()]


def _plain_rms(report: Report) -> Floats:
    """(n,) rms errors [rad] without compensation, over the frames that were reached."""
    error = report.series["plain"] - report.series["wanted"]
    return np.sqrt(np.nansum(error**2, axis=0) / max(int(np.isfinite(error).all(axis=1).sum()), 1))


def loads(report: Report) -> list[Chart]:
    """The rms error of every joint, with and without compensation, and how much of its bound its servo gives over time."""
    return [_errors(report), *_torques(report)]


def _errors(report: Report) -> Chart:
    joints, plain = report.figures["joints"], dict(zip(report.joint_names, _plain_rms(report), strict=True))

    def draw(axes: Any) -> None:
        place = np.arange(len(joints))
        if report.figures["compensated"]:
            axes.barh(place, np.degrees([plain[name] for name in joints]), 0.72, color=PLAIN, alpha=0.45)
        axes.barh(place, np.degrees([own["rms_rad"] for own in joints.values()]), 0.44, color=MEASURED)
        _named(axes, list(joints))
        axes.grid(axis="y", visible=False)

    return Chart("rms error [°]", _svg("errors", _height(list(joints)), draw))


def _torques(report: Report) -> list[Chart]:
    from matplotlib.colors import LinearSegmentedColormap

    bounds, names = report.series["bounds"], report.joint_names
    known = [names.index(joint) for joint in report.figures["joints"] if np.isfinite(bounds[names.index(joint)])]
    share, shown = np.abs(report.series["torque"][:, known]) / bounds[known], [names[k] for k in known]
    if not share.size:
        return []

    def draw(axes: Any) -> None:
        time = report.series["time"]
        span = (time[0], time[-1] if len(time) > 1 else 1.0, len(known) - 0.5, -0.5)
        heat = LinearSegmentedColormap.from_list("loads", LOADS)
        image = axes.imshow(share.T, aspect="auto", extent=span, vmin=0, vmax=1, cmap=heat, interpolation="nearest")
        _named(axes, shown)
        axes.set_xlabel("time [s]")
        axes.grid(visible=False)
        axes.figure.colorbar(image, ax=axes, pad=0.02, aspect=30).outline.set_visible(False)

    return [Chart("torque / limit", _svg("torques", _height(shown), draw))]


def _height(names: list[str]) -> float:
    """Height of a chart with a row for each name [inches]."""
    return LINE * sum(len(_lines(name)) for name in names) + 0.6


def _lines(name: str) -> list[str]:
    return [name[k : k + LETTERS] for k in range(0, len(name), LETTERS)]


def _named(axes: Any, names: list[str]) -> None:
    """Write a name next to each row, the first at the top."""
    axes.set_yticks(range(len(names)), ["\n".join(_lines(name)) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)


def balance(report: Report) -> list[Chart]:
    """The centre of mass and the zero moment point over the soles, and how far inside them they stay."""
    series = report.series
    if "com" not in series:
        return []
    time, fall = series["state_time"], report.figures.get("fall_s")
    standing = (time >= 0) & (time < (np.inf if fall is None else fall))

    def margin(axes: Any) -> None:
        for name, colour in (("zmp_margin", PLAIN), ("com_margin", MEASURED)):
            axes.plot(time, 100 * np.where(standing, series[name], np.nan), color=colour, lw=1.2)
        axes.axhline(0, color=ALARM, lw=1)
        if fall is not None:
            axes.axvline(fall, color=ALARM, lw=1, ls="--")
            axes.text(fall, 1, "fell ", color=ALARM, transform=axes.get_xaxis_transform(), va="top", ha="right")
        seen = 100 * np.concatenate([series[name][standing] for name in ("com_margin", "zmp_margin")])
        axes.set_ylim(max(np.nanmin(seen, initial=0) - 1, -15), np.nanmax(seen, initial=1) + 1)
        axes.set_xlabel("time [s]")

    def plan(axes: Any) -> None:
        _floor_plan(axes, {name: series[name][standing] for name in ("soles", "down", "zmp", "com")})

    drawn = ("from above", "balance", plan), ("margin to the edge of the support", "margin", margin)
    return [Chart(f"{name} [cm]", _svg(own, 3.4, draw)) for name, own, draw in drawn]


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
    axes.plot(*(100 * series["zmp"]).T, color=PLAIN, lw=0.8)
    axes.plot(*(100 * series["com"]).T, color=MEASURED, lw=1.6)
    axes.set_aspect("equal", adjustable="box")
    if outlines:
        every = np.concatenate(outlines)
        low, high = every.min(0) - 2, every.max(0) + 2
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])


def timeline(report: Report, warnings: Warnings | None) -> list[Chart]:
    """Draw the warnings of each pair, its contacts in the plan, and the start of its contacts on the servos."""
    if warnings is None or not warnings.flagged.any():
        return []
    shown = np.flatnonzero(warnings.flagged.any(axis=0))
    shown = shown[np.argsort(warnings.flagged[:, shown].argmax(axis=0), kind="stable")][:TIMELINE_PAIRS]

    def draw(axes: Any) -> None:
        for row, pair in enumerate(shown):
            links, fps = warnings.pairs[pair], warnings.fps
            for flags, colour, alpha in ((warnings.flagged, PLAIN, 0.55), (warnings.touching, ALARM, 1.0)):
                bars = [(first / fps, (stop - first) / fps) for first, stop in intervals(flags[:, pair])]
                axes.broken_barh(bars, (row, 0.4), color=colour, alpha=alpha, lw=0)
            at = [time for touching, time in report.touches if touching == frozenset(links)]
            axes.plot(at, [row + 0.2] * len(at), "v", color=ALARM, ms=4.5, mew=0)
            axes.annotate(" – ".join(links), (0, row - 0.05), (4, 0), textcoords="offset points", va="bottom")
        axes.set_yticks([])
        axes.set_ylim(len(shown) - 0.5, -0.7)
        axes.set_xlim(0, max(len(warnings) - 1, 1) / warnings.fps)
        axes.set_xlabel("time [s]")

    return [Chart("", _svg("timeline", 0.34 * len(shown) + 0.6, draw))]


def predictions(found: Sequence["Prediction"], rate: float) -> Chart:
    """Draw measured and predicted angles of the joints that are predicted worst, above each other."""
    worst = sorted(found, key=lambda one: -one.error)[:CURVES]

    def draw(axes: Any) -> None:
        for k, one in enumerate(worst):
            middle, scale = one.measured.mean(), max(np.ptp(one.measured), 1e-3)
            times = np.arange(len(one.measured)) / rate
            for curve, colour in ((one.goals, WANTED), (one.predicted, PLAIN), (one.measured, MEASURED)):
                axes.plot(times, (curve - middle) / scale - 1.4 * k, color=colour, linewidth=0.9)
            text = f"{one.joint} {np.degrees(one.error):.2f}°"
            axes.annotate(text, (0, 0.55 - 1.4 * k), xycoords=("axes fraction", "data"), color=INK)
        axes.set_yticks([])
        axes.set_xlabel("time [s]; grey: goals, orange: predicted, blue: measured; largest errors first (rms)")

    return Chart("predicted and measured", _svg("predictions", 0.8 * len(worst) + 0.6, draw))


def _svg(name: str, height: float, draw: Callable[[Any], None]) -> str:
    """What `draw` puts on axes, as an `<svg>` element for a page; ids are the chart's own."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with matplotlib.rc_context({**STYLE, "svg.hashsalt": name, "svg.id": name}):
        figure = Figure(figsize=(WIDTH, height))
        FigureCanvasSVG(figure)
        draw(axes := figure.subplots())
        lines = [line for label in axes.get_yticklabels() for line in label.get_text().split("\n")]
        left, right = MARGIN + LETTER * max(map(len, lines), default=0), WIDTH - MARGIN * len(figure.axes)
        bottom = (BELOW if axes.get_xlabel() else BELOW / 2) / height
        figure.subplots_adjust(left / WIDTH, bottom, right / WIDTH, 1 - MARGIN / 2 / height)
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

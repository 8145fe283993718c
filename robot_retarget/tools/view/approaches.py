"""How near pairs of links came, and how near they were about to come: curves of D, the distance and α."""

from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import OutputError, install_line, known
from robot_retarget.base.files import replacing
from robot_retarget.collision.warn import Warnings
from robot_retarget.tools.view.picture import Unavailable

MOST = 8
"""Pairs shown, the earliest flagged first."""
FORMATS = ("jpg", "pdf", "png", "svg")
NEEDS_MATPLOTLIB = f"curves need matplotlib: {install_line('plots')}"


def require_drawable(path: str | Path) -> None:
    """Refuse a picture that cannot be drawn before long work is done for it.

    Raises:
        OutputError: the file's suffix is not that of a picture.
    """
    suffix = Path(path).suffix.lower().removeprefix(".")
    if suffix not in FORMATS:
        raise OutputError(f"cannot draw {path}: {suffix or 'no suffix'} is no picture format; {known(FORMATS)}")


def plot_warnings(warnings: Warnings, path: str | Path) -> Path | Unavailable:
    """Draw D, the distance now and α over time for the pairs that were flagged.

    Raises:
        OutputError: the picture cannot be written, or its suffix is not that of a picture.
    """
    require_drawable(path)
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        return Unavailable(NEEDS_MATPLOTLIB)
    shown = np.flatnonzero(warnings.flagged.any(axis=0))
    if not shown.size:
        return Unavailable("no pair was flagged: there is nothing to draw")
    shown = shown[np.argsort(warnings.flagged[:, shown].argmax(axis=0), kind="stable")][:MOST]
    figure = Figure(figsize=(10, 2.2 * len(shown) + 0.6), layout="constrained")
    FigureCanvasAgg(figure)
    rows = np.atleast_1d(figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0])
    for axes, pair in zip(rows, shown.tolist(), strict=True):
        _curves(axes, warnings, pair)
    legend = {
        label: handle for axes in figure.axes for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(legend.values(), legend.keys(), loc="outside upper center", fontsize="small", ncols=len(legend))
    rows[-1].set_xlabel("time [s]")
    with replacing(path) as scratch:
        figure.savefig(scratch, dpi=110)
    return Path(path)


def _curves(axes: Any, warnings: Warnings, pair: int) -> None:
    """One pair: distances to the left, α to the right, flagged stretches shaded, contacts dark."""
    times = np.arange(len(warnings)) / warnings.fps
    frame = 1 / warnings.fps
    for what, colour, label in ((warnings.flagged, "#f4c9a8", "flagged"), (warnings.touching, "#c0392b", "touching")):
        edges = np.diff(what[:, pair].astype(int), prepend=0, append=0)
        for start, stop in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
            axes.axvspan(start * frame, stop * frame, color=colour, alpha=0.5, linewidth=0, label=label)
    axes.plot(times, warnings.distance[:, pair], color="#2c3e50", label="distance now")
    axes.plot(times, warnings.ahead[:, pair], color="#2980b9", label="D")
    axes.axhline(0, color="black", linewidth=0.5)
    axes.set_ylabel("[m]")
    axes.set_title(" – ".join(warnings.pairs[pair]), fontsize="medium", loc="left")
    right = axes.twinx()
    right.plot(times, warnings.alpha[:, pair], color="#7f8c8d", linewidth=0.8, label="α")
    right.set_ylabel("α [steps]")

"""The look of the reproduced figures; nothing here computes."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

INK, BLUE, RED, GREY = "#20242c", "#1f5fbf", "#c8412f", "#9aa3b0"
MAPS = ("Blues", "Oranges", "Greens", "Purples")
plt.rcParams.update(
    {
        "font.size": 9,
        "axes.titlesize": 9,
        "axes.edgecolor": GREY,
        "axes.labelcolor": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "axes.titlecolor": INK,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "savefig.bbox": "tight",
        "savefig.dpi": 110,
    }
)


def sheet(columns: int, rows: int = 1, size: tuple[float, float] = (3.1, 3.1)) -> tuple[Figure, np.ndarray]:
    """A figure with (rows, columns) axes."""
    figure, axes = plt.subplots(rows, columns, figsize=(size[0] * columns, size[1] * rows), squeeze=False)
    return figure, axes


def save(figure: Figure, path: Path) -> None:
    """Write a small PNG and forget the figure."""
    figure.tight_layout()
    figure.savefig(path, pil_kwargs={"optimize": True})
    plt.close(figure)


def bare(axis: Axes, title: str, box: tuple[float, float, float, float] | None = None) -> None:
    """Equal axes without ticks."""
    axis.set_title(title)
    axis.set_aspect("equal")
    axis.set_xticks([])
    axis.set_yticks([])
    for spine in axis.spines.values():
        spine.set_visible(box is not None)
        spine.set_color("#d5dae1")
    if box is not None:
        axis.set_xlim(box[0], box[1])
        axis.set_ylim(box[2], box[3])


def shades(count: int, name: str = "Blues") -> np.ndarray:
    """Colours from pale (first frame) to full (last frame)."""
    return matplotlib.colormaps[name](np.linspace(0.25, 0.95, count))


def tracks(axis: Axes, x: np.ndarray, names: Sequence[int], size: float = 26) -> None:
    """Trajectories (T, V, 2) as dots that darken with time, each object in its own colour."""
    for place, vertex in enumerate(names):
        axis.plot(x[:, vertex, 0], x[:, vertex, 1], color="#e3e7ed", lw=1, zorder=1)
        axis.scatter(
            x[:, vertex, 0], x[:, vertex, 1], s=size, c=shades(len(x), MAPS[place % len(MAPS)]), zorder=2, lw=0
        )


def rocks(axis: Axes, centres: Iterable[np.ndarray], radius: float) -> None:
    """Obstacles with the ring that must stay empty."""
    for centre in centres:
        axis.add_patch(Circle((centre[0], centre[1]), radius, fc="#f3ece3", ec="#d9b98c", ls="--", lw=0.8, zorder=0))
        axis.plot(*centre, "o", color="#a86b21", ms=5, zorder=3)


def links_between(axis: Axes, x: np.ndarray, pairs: Iterable[tuple[int, int]], every: int = 1) -> None:
    """Thin lines between pairs in every few frames."""
    for frame in range(0, len(x), every):
        for a, b in pairs:
            axis.plot(*x[frame, [a, b]].T, color="#b9c3d0", lw=0.7, zorder=1)


def bones(axis: Axes, x: np.ndarray, parents: np.ndarray, color: str = INK, lw: float = 1.8) -> None:
    """A stick figure (V, 2)."""
    for joint, parent in enumerate(parents):
        if parent >= 0:
            axis.plot(*x[[parent, joint]].T, color=color, lw=lw, solid_capstyle="round", zorder=2)


def dot(axis: Axes, at: np.ndarray, color: str, size: float = 6, label: str | None = None) -> None:
    """One point."""
    axis.plot(at[0], at[1], "o", color=color, ms=size, zorder=4, label=label, mec="white", mew=0.6, ls="none")


def limb(
    axis: Axes, shoulder: np.ndarray, wrist: np.ndarray, color: object, upper: float = 0.273, lower: float = 0.258
) -> None:
    """An arm of two bones in the plane, bent outward at the elbow."""
    reach = wrist - shoulder
    length = np.linalg.norm(reach)
    along = (length**2 + upper**2 - lower**2) / (2 * length)
    aside = np.sqrt(max(upper**2 - along**2, 0.0))
    elbow = shoulder + (along * reach + aside * np.array([-reach[1], reach[0]])) / length
    axis.plot(
        *np.stack([shoulder, elbow, wrist]).T, color=color, lw=3.5, solid_capstyle="round", solid_joinstyle="round"
    )


def ring(axis: Axes, centre: np.ndarray, radius: float, color: str, text: str = "", strong: bool = True) -> None:
    """A circle, filled or faint, with a word beside its centre."""
    place = (float(centre[0]), float(centre[1]))
    if strong and text:
        axis.add_patch(Circle(place, radius, fc=color, alpha=0.15, ec="none"))
    axis.add_patch(Circle(place, radius, fc="none", ec=color, lw=1.2 if strong else 0.8, alpha=1.0 if strong else 0.35))
    if text:
        axis.plot(*place, ".", color=color, ms=4)
        axis.text(place[0] + 0.07, place[1] + 0.07, text, color=color, fontsize=9 if strong else 8)

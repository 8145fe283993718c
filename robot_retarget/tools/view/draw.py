"""Pictures without OpenGL: the outline of the box of every geom, far ones first."""

from collections.abc import Callable
from functools import partial

import numpy as np
from PIL import Image, ImageDraw
from scipy.spatial import ConvexHull, QhullError

from robot_retarget.base.arrays import Floats
from robot_retarget.tools.view.picture import Pixels
from robot_retarget.tools.view.staging import (
    FIELD_OF_VIEW,
    FIGURE,
    LINK,
    METAL,
    Colour,
    Staging,
    camera_axes,
    geom_corners,
    stick_figure,
    visible,
)

PAPER = (247, 249, 252)
GROUND = (228, 232, 237)
EDGE = (60, 66, 74)
FINE = 2
"""Drawn this many times larger, then made smaller: smooth edges."""

Shape = tuple[float, Callable[[], None]]
"""Its distance [m], and a function that draws it."""


class Sketch:
    """Draws the moments of one staging."""

    def __init__(self, staging: Staging, width: int, height: int):
        self._figure = stick_figure(staging)
        self._staging, self._size = staging, (width * FINE, height * FINE)
        model = staging.robot.model
        geoms = visible(model)
        material = model.geom_matid[geoms]
        own = np.asarray(model.geom_rgba[geoms, :3], float)
        painted = np.asarray(model.mat_rgba, float).reshape(-1, 4)[material, :3] if model.nmat else own
        self._colours = np.where((material >= 0)[:, None], painted, own)
        self._corners = geom_corners(staging.robot, staging.qpos)

    def frame(self, k: int) -> Pixels:
        """The k-th moment."""
        image = Image.new("RGB", self._size, PAPER)
        pen = ImageDraw.Draw(image)
        self._ground(pen, k)
        shapes = self._boxes(pen, k) + self._limbs(pen, k) + self._links(pen, k)
        for _, paint in sorted(shapes, key=lambda shape: -shape[0]):
            paint()
        return np.asarray(image.resize((self._size[0] // FINE, self._size[1] // FINE), Image.Resampling.LANCZOS))

    @property
    def _scale(self) -> float:
        """Pixels per metre at a distance of one metre."""
        return self._size[1] / 2 / np.tan(np.radians(FIELD_OF_VIEW / 2))

    def _project(self, points: Floats, k: int) -> tuple[Floats, Floats]:
        """Pixels (…, 2) and depths (…) [m] of world points (…, 3), as a camera at the staging's place sees them."""
        staging = self._staging
        right, up, ahead = camera_axes(staging.azimuth)
        seen = points - (staging.targets[k] - staging.distance * ahead)
        depth = np.maximum(seen @ ahead, 0.05 * staging.distance)
        flat = np.stack([seen @ right, -(seen @ up)], -1) * (self._scale / depth)[..., None]
        return flat + np.array(self._size) / 2, depth

    def _ground(self, pen: ImageDraw.ImageDraw, k: int) -> None:
        """A disc of floor under both."""
        staging = self._staging
        angle = np.linspace(0, 2 * np.pi, 60)
        wide = staging.aspect * staging.height * 0.9
        disc = np.stack([wide * np.cos(angle), wide * np.sin(angle), 0 * angle], 1)
        middle = staging.targets[k] * [1, 1, 0] + [0, 0, staging.floor]
        pen.polygon([tuple(p) for p in self._project(middle + disc, k)[0]], fill=GROUND)

    def _boxes(self, pen: ImageDraw.ImageDraw, k: int) -> list[Shape]:
        corners, depth = self._project(self._corners[k], k)
        fills = (255 * (0.35 + 0.6 * np.clip(self._colours, 0, 1))).astype(int)
        return [
            (float(d.mean()), partial(_box, pen, c, tuple(fill)))
            for c, d, fill in zip(corners, depth, fills.tolist(), strict=True)
        ]

    def _limbs(self, pen: ImageDraw.ImageDraw, k: int) -> list[Shape]:
        points, depth = self._project(self._staging.human[k], k)
        return [
            self._capsule(pen, points[[a, b]], depth[[a, b]], radius, FIGURE)
            for (a, b), radius in zip(self._figure.limbs, self._figure.radii, strict=True)
        ]

    def _links(self, pen: ImageDraw.ImageDraw, k: int) -> list[Shape]:
        points, depth = self._project(self._staging.links[k], k)
        radius = LINK * self._staging.height
        return [self._capsule(pen, ends, far, radius, METAL) for ends, far in zip(points, depth, strict=True)]

    def _capsule(self, pen: ImageDraw.ImageDraw, ends: Floats, depth: Floats, radius: float, colour: Colour) -> Shape:
        """Between two ends (2, 2) [pixels] at depths (2,) [m]."""
        wide = radius * self._scale / depth[0]
        return float(depth.mean()), partial(_limb, pen, ends[0], ends[1], wide, colour)


def _box(pen: ImageDraw.ImageDraw, corners: Floats, fill: tuple[int, ...]) -> None:
    try:
        outline = corners[ConvexHull(corners).vertices]
    except QhullError:  # seen edge on, or without extent
        return
    pen.polygon([tuple(p) for p in outline], fill=fill, outline=EDGE, width=FINE)


def _limb(pen: ImageDraw.ImageDraw, start: Floats, end: Floats, radius: float, colour: Colour) -> None:
    fill = tuple(int(255 * v) for v in colour[:3])
    pen.line([tuple(start), tuple(end)], fill=fill, width=max(round(2 * radius), 1))
    for x, y in (start, end):
        pen.ellipse([x - radius, y - radius, x + radius, y + radius], fill=fill)

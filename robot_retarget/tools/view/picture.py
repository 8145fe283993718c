"""Images, and the value that explains a missing image."""

import io
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_retarget.base.errors import install_line
from robot_retarget.base.files import replacing

Pixels = NDArray[np.uint8]
"""(H, W, 3) red, green, blue."""

INK = (38, 42, 48)
QUALITY = 60
"""Of still pictures in a page as WebP, 0 … 100: a fourth of the bytes of a PNG, without visible blocks."""


@dataclass(frozen=True)
class Unavailable:
    """A missing picture, with the reason."""

    reason: str


@dataclass(frozen=True, eq=False)
class Picture:
    """An image with a note on how it was made."""

    pixels: Pixels
    note: str = ""

    @property
    def webp(self) -> bytes:
        """The image as a small WebP file, for a page."""
        from PIL import Image

        data = io.BytesIO()
        Image.fromarray(self.pixels).save(data, "WEBP", quality=QUALITY)
        return data.getvalue()

    def save(self, path: str | Path) -> Path:
        """Write it as the path's suffix says, PNG as a rule, whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        from PIL import Image

        with replacing(path) as scratch:
            Image.fromarray(self.pixels).save(scratch)
        return Path(path)


def without_pillow() -> Unavailable | None:
    """Return why images cannot be labelled and written, if they cannot."""
    try:
        import PIL.ImageDraw  # noqa: F401
    except ImportError:
        return Unavailable(f"pictures need Pillow: {install_line('video')}")
    return None


def labelled(pixels: Pixels, text: str, rows: int = 24) -> Pixels:
    """Return the image with a line of text in its lower left corner; `rows` such lines have the height of the image."""
    from PIL import Image, ImageDraw

    image = Image.fromarray(pixels)
    size = max(image.height // rows, 11)
    ImageDraw.Draw(image).text((size * 0.8, image.height - size * 0.7), text, INK, font(size), anchor="ls")
    return np.asarray(image)


@cache
def font(size: float) -> Any:
    """Pillow's own font of a height [pixels]."""
    from PIL import ImageFont

    return ImageFont.load_default(size)

"""Arrays as small PNG pictures inside a page."""

from __future__ import annotations

import base64
import io
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]  # (h, w) index into a palette, (h, w, 3) RGB or (h, w, 4) RGBA; row 0 at the top
Palette = NDArray[np.uint8]  # (n, 3) RGB or (n, 4) RGBA, n up to 256

_EFFORT: Final = 6  # of zlib: more takes ten times as long and saves 2 %
_BAR: Final = 0.25  # of a picture's width: a scale bar is no longer
_STEPS: Final = (5.0, 2.0, 1.0)


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture as templates show it (``macros.html``, ``picture``).

    ``alt`` says in words what there is to see. ``bar_percent`` of the picture's width are ``bar_text`` (such as
    ``5 m``); 0 for a picture without scale.
    """

    uri: str
    width_px: int
    height_px: int
    alt: str
    bar_percent: float = 0.0
    bar_text: str = ""


def picture(pixels: Pixels, alt: str, palette: Palette | None = None, pixel_m: float | None = None) -> Picture:
    """A picture with a scale bar; ``pixel_m`` is the side of a pixel in metres, None for no scale."""
    height, width = pixels.shape[:2]
    length_m = 0.0 if pixel_m is None else bar_m(_BAR * width * pixel_m)
    percent = 0.0 if pixel_m is None else 100.0 * length_m / (width * pixel_m)
    text = f"{length_m:g} m" if length_m >= 1.0 else f"{100.0 * length_m:g} cm"
    return Picture(png_uri(pixels, palette), width, height, alt, round(percent, 3), text if percent else "")


def png_uri(pixels: Pixels, palette: Palette | None = None) -> str:
    """The picture as a ``data:`` URI."""
    return data_uri(png(pixels, palette))


def data_uri(file: bytes) -> str:
    """A PNG file as a ``data:`` URI."""
    return "data:image/png;base64," + base64.b64encode(file).decode()


def png(pixels: Pixels, palette: Palette | None = None) -> bytes:
    """A PNG file; equal pixels give equal bytes. Raises ValueError when shape and palette do not fit."""
    from PIL import Image

    mode = {(): "P", (3,): "RGB", (4,): "RGBA"}.get(pixels.shape[2:]) if pixels.ndim > 1 else None
    if pixels.dtype != np.uint8 or pixels.size == 0 or mode is None or (mode == "P") != (palette is not None):
        raise ValueError(
            "a picture is (h, w) uint8 with a palette, or (h, w, 3) or (h, w, 4) uint8 without one, "
            f"found {pixels.dtype} {pixels.shape} {'with' if palette is not None else 'without'} a palette"
        )
    image = Image.frombytes(mode, (pixels.shape[1], pixels.shape[0]), np.ascontiguousarray(pixels).tobytes())
    options: dict[str, bytes] = {}
    if palette is not None:
        image.putpalette(palette[:, :3].tobytes())
        options = {"transparency": palette[:, 3].tobytes()} if palette.shape[1] == 4 else {}
    stream = io.BytesIO()
    image.save(stream, "PNG", compress_level=_EFFORT, **options)
    return stream.getvalue()


def bar_m(longest_m: float) -> float:
    """How long a scale bar is: the greatest of 1, 2 or 5 times a power of ten that is no longer."""
    power = 10.0 ** math.floor(math.log10(longest_m))
    return next(step * power for step in _STEPS if step * power <= longest_m * (1.0 + 1e-9))

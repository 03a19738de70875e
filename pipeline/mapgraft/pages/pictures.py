"""Arrays as small PNG pictures inside a page."""

from __future__ import annotations

import base64
import math
import struct
import zlib
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]  # (h, w) index into a palette, (h, w, 3) RGB or (h, w, 4) RGBA; row 0 at the top
Palette = NDArray[np.uint8]  # (n, 3) RGB or (n, 4) RGBA, n up to 256

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_PALETTE, _RGB, _RGBA = 3, 2, 6  # colour types of the PNG specification
_NO_FILTER: Final = 0  # before each row; areas of one colour need none
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
    length_m = 0.0 if pixel_m is None else _bar_m(_BAR * width * pixel_m)
    percent = 0.0 if pixel_m is None else 100.0 * length_m / (width * pixel_m)
    text = f"{length_m:g} m" if length_m >= 1.0 else f"{100.0 * length_m:g} cm"
    return Picture(png_uri(pixels, palette), width, height, alt, round(percent, 3), text if percent else "")


def png_uri(pixels: Pixels, palette: Palette | None = None) -> str:
    """The picture as a ``data:`` URI."""
    return "data:image/png;base64," + base64.b64encode(png(pixels, palette)).decode()


def png(pixels: Pixels, palette: Palette | None = None) -> bytes:
    """A PNG file; equal pixels give equal bytes. Raises ValueError when shape and palette do not fit."""
    colours = {2: 1, 3: pixels.shape[-1]}.get(pixels.ndim, 0) if pixels.size else 0
    kind = {1: _PALETTE, 3: _RGB, 4: _RGBA}.get(colours)
    if pixels.dtype != np.uint8 or kind is None or (kind == _PALETTE) != (palette is not None):
        raise ValueError(
            "a picture is (h, w) uint8 with a palette, or (h, w, 3) or (h, w, 4) uint8 without one, "
            f"found {pixels.dtype} {pixels.shape} {'with' if palette is not None else 'without'} a palette"
        )
    height, width = pixels.shape[:2]
    packed = palette is not None and len(palette) <= 16
    samples = _in_halves(pixels) if packed else pixels.reshape(height, -1)
    rows = np.full((height, 1 + samples.shape[1]), _NO_FILTER, np.uint8)
    rows[:, 1:] = samples
    head = struct.pack(">IIBBBBB", width, height, 4 if packed else 8, kind, 0, 0, 0)
    data = zlib.compress(rows.tobytes(), _EFFORT)
    chunks = [(b"IHDR", head), *_palette_chunks(palette), (b"IDAT", data), (b"IEND", b"")]
    return _SIGNATURE + b"".join(_chunk(name, data) for name, data in chunks)


def _in_halves(pixels: Pixels) -> Pixels:
    """Two pixels to a byte, for palettes of at most 16 colours."""
    even = np.pad(pixels, ((0, 0), (0, pixels.shape[1] % 2)))
    return np.bitwise_or(np.left_shift(even[:, ::2], np.uint8(4)), even[:, 1::2])


def _palette_chunks(palette: Palette | None) -> list[tuple[bytes, bytes]]:
    if palette is None:
        return []
    chunks = [(b"PLTE", np.ascontiguousarray(palette[:, :3], np.uint8).tobytes())]
    if palette.shape[1] == 4:
        chunks.append((b"tRNS", np.ascontiguousarray(palette[:, 3], np.uint8).tobytes()))
    return chunks


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def _bar_m(longest_m: float) -> float:
    """The greatest of 1, 2 or 5 times a power of ten that is no longer."""
    power = 10.0 ** math.floor(math.log10(longest_m))
    return next(step * power for step in _STEPS if step * power <= longest_m * (1.0 + 1e-9))

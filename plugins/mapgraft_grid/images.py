"""Gray images from files: PGM by ourselves, everything else by OpenCV."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError

_TOKEN: Final = re.compile(rb"(?:\s|#[^\n]*\n)*([0-9]+)")
_PNG: Final = b"\x89PNG\r\n\x1a\n"
_TINT: Final = 0.125  # of the largest value: how far the colours of a gray may lie apart


class Gray(NamedTuple):
    """An image, top row first: the mean of its colours scaled to 0 … 255, and the same rounded, and where it is opaque.

    ``levels`` (h, w) float64, ``raw`` (h, w) uint8, ``opaque`` (h, w) bool. ``coloured`` is the share of the pixels
    whose colours differ so much that a person would not call them gray.
    """

    levels: NDArray[np.float64]
    raw: NDArray[np.uint8]
    opaque: NDArray[np.bool_]
    coloured: float = 0.0


def read_gray(path: Path, most_pixels: int, *, asked_by: str = "") -> Gray:
    """The image in a file, which the file ``asked_by`` names, if one does.

    Raises MapError when it is missing, no image, or has more than ``most_pixels``.
    """
    named = f", which {asked_by} names," if asked_by else ""
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise MapError(f"the map image {path}{named} is not a file")
        data = path.read_bytes()
    except OSError as fault:
        raise MapError(f"the map image {path}{named} cannot be read: {fault.strerror}") from fault
    if data[:2] in (b"P2", b"P5"):
        levels = _pgm(path.name, data, most_pixels)
        return _gray(levels, np.ones(levels.shape, np.bool_))
    return _decoded(path.name, data, most_pixels)


def _gray(levels: NDArray[np.float64], opaque: NDArray[np.bool_]) -> Gray:
    return Gray(levels, np.round(levels).astype(np.uint8), opaque)


def _pgm(name: str, data: bytes, most_pixels: int) -> NDArray[np.float64]:
    at, header = 2, []
    for _ in range(3):
        token = _TOKEN.match(data, at)
        if not token or len(token[1]) > 18:
            raise MapError(f"the map image {name} is no PGM image: its header is incomplete")
        header.append(int(token[1]))
        at = token.end()
    width, height, largest = header
    _require_size(name, width, height, most_pixels)
    if not 0 < largest < 65536:
        raise MapError(f"the map image {name} must have a largest gray in 1 … 65535, found {largest}")
    if data[:2] == b"P2":
        values = _plain(name, data[at:], width * height)
    else:
        dtype = np.dtype(">u2" if largest > 255 else "u1")
        if len(data) - at - 1 < width * height * dtype.itemsize:
            raise MapError(f"the map image {name} is cut short: {width} × {height} pixels were announced")
        values = np.frombuffer(data, dtype, width * height, at + 1).astype(np.float64)
    if values.max(initial=0) > largest:
        raise MapError(f"the map image {name} has grays above its largest, {largest}: it is damaged")
    return (values * (255.0 / largest)).reshape(height, width)


def _plain(name: str, text: bytes, count: int) -> NDArray[np.float64]:
    """The grays of a P2 image, which are written as decimal numbers."""
    words = re.sub(rb"#[^\n]*", b"", text).split()
    if len(words) < count or not all(word.isdigit() and len(word) < 6 for word in words[:count]):
        raise MapError(f"the map image {name} is cut short or damaged: {count} grays were announced")
    return np.array(words[:count], np.float64)


def _decoded(name: str, data: bytes, most_pixels: int) -> Gray:
    if data[:8] == _PNG and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
        _require_size(name, width, height, most_pixels)
    import cv2

    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        image = None
    if image is None:
        raise MapError(f"the map image {name} is no image that can be read: use PGM or PNG")
    _require_size(name, image.shape[1], image.shape[0], most_pixels)
    if image.dtype not in (np.uint8, np.uint16):
        raise MapError(f"the map image {name} must have 8 or 16 bits per colour, found {image.dtype}: use PGM or PNG")
    largest = 255.0 if image.dtype == np.uint8 else 65535.0
    colours = image.reshape(image.shape[0], image.shape[1], -1)
    opaque: NDArray[np.bool_] = np.ones(colours.shape[:2], np.bool_)
    if colours.shape[2] in (2, 4):
        opaque = np.asarray(colours[..., -1] == largest)
        colours = colours[..., :-1]
    spread = colours.max(axis=2) - colours.min(axis=2)
    coloured = float(np.count_nonzero(opaque & (spread > _TINT * largest))) / spread.size
    return _gray(colours.mean(axis=2) * (255.0 / largest), opaque)._replace(coloured=coloured)


def _require_size(name: str, width: int, height: int, most_pixels: int) -> None:
    if width < 1 or height < 1 or width * height > most_pixels:
        raise MapError(
            f"the map image {name} has {width} × {height} pixels, from 1 to {most_pixels:,} can be read "
            "(limits.grid_cells)"
        )

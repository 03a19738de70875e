"""Along which directions the walls of a map run, and by how much one map must be turned to run like another."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft_grid.grid_map import FREE, OCCUPIED, Classes

BINS: Final = 360  # over half a turn
SOFT_CELLS: Final = 2.0  # by which cells are smoothed before their slopes are taken
_GATHERED: Final = 2.5  # times that, around each cell
_SLOPED: Final = 0.2  # of the greatest slope: less is no border
_SMOOTH_BINS: Final = 3.0
_APART_BINS: Final = 12
_LEAST: Final = 0.55  # of the best turn's correlation
_MOST: Final = 4  # turns of half a turn
_FLAT: Final = 0.08  # of the correlation, above its mean: less says nothing

Histogram = NDArray[np.float64]  # (BINS,) how much wall runs in each direction, of unit sum


def histogram(classes: Classes, smooth_cells: float = SOFT_CELLS) -> Histogram:
    """How much wall and how much border of free space runs in each direction in [0, π).

    Directions are those of the structure tensor, the slopes' products gathered over some cells around: single slopes of
    a line of cells run along the cells, not along the line.
    """
    import cv2

    out = np.zeros(BINS)
    for mask in (classes == OCCUPIED, classes == FREE):
        soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), smooth_cells)
        gx, gy = cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1)
        size = np.hypot(gx, gy)
        some = size > _SLOPED * float(size.max(initial=0.0))
        xx, yy, xy = (
            cv2.GaussianBlur(product, (0, 0), _GATHERED * smooth_cells)[some] for product in (gx * gx, gy * gy, gx * gy)
        )
        angle = 0.5 * np.arctan2(2.0 * xy, xx - yy) % math.pi
        weight = np.sqrt(np.hypot(xx - yy, 2.0 * xy))  # nothing where walls of all directions meet
        part = np.bincount((angle * (BINS / math.pi)).astype(np.int64) % BINS, weight, BINS)
        out += part / max(part.sum(), 1e-9)
    reach = np.arange(BINS)
    reach = np.minimum(reach, BINS - reach)
    kernel = np.fft.rfft(np.exp(-0.5 * (reach / _SMOOTH_BINS) ** 2))
    smooth = np.maximum(np.fft.irfft(np.fft.rfft(out) * kernel, BINS), 0.0)
    return np.asarray(smooth / max(smooth.sum(), 1e-12), np.float64)


def turns(target: Histogram, source: Histogram) -> list[float] | None:
    """Yaws (rad, in [0, π)) that turn the source's walls along the target's, best first; None where nothing tells."""
    spectrum = np.fft.rfft(target) * np.conj(np.fft.rfft(source))
    agreement = np.fft.irfft(spectrum, BINS) / math.sqrt(float((target**2).sum() * (source**2).sum()))
    if agreement.max() - agreement.mean() < _FLAT:
        return None
    found: list[int] = []
    for place in np.argsort(-agreement, kind="stable").tolist():
        if agreement[place] < _LEAST * agreement.max() or len(found) == _MOST:
            break
        if all(min((place - other) % BINS, (other - place) % BINS) >= _APART_BINS for other in found):
            found.append(place)
    return [place * math.pi / BINS for place in found]

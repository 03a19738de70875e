"""Hough spectra and axis projections of occupied points (Carpin 2008, sections 3 and 4)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def hough_spectrum(points: NDArray[np.float64], angles_rad: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """How concentrated the points are on lines of each direction: Σ over rho of the squared votes.

    ``points`` (n, 2) in cells, centred, none further than ``reach`` from the origin; ``angles_rad`` (k,) directions of
    the lines' normals. Returns (k,). The bins of rho are one cell wide.
    """
    spectrum = np.zeros(angles_rad.size)
    votes = np.zeros(2 * reach + 3, np.int64)
    for k in range(angles_rad.size):
        c, s = math.cos(angles_rad[k]), math.sin(angles_rad[k])
        votes[:] = 0
        for i in range(points.shape[0]):
            votes[math.floor(points[i, 0] * c + points[i, 1] * s + 0.5) + reach + 1] += 1
        total = 0.0
        for j in range(votes.size):
            total += float(votes[j]) * float(votes[j])
        spectrum[k] = total
    return spectrum


@njit(cache=True)
def axis_spectra(points: NDArray[np.float64], cosine: float, sine: float, reach: int) -> NDArray[np.float64]:
    """The projections of the turned points on both axes: the X-spectrum and the Y-spectrum.

    ``points`` (n, 2) in cells, centred, none further than ``reach`` from the origin. Returns (2, 2·reach + 3); entry
    ``reach + 1`` is the origin. Votes are shared between the two nearest bins, so that peaks can be interpolated.
    """
    spectra = np.zeros((2, 2 * reach + 3))
    for i in range(points.shape[0]):
        x = cosine * points[i, 0] - sine * points[i, 1] + reach + 1
        y = sine * points[i, 0] + cosine * points[i, 1] + reach + 1
        j, k = math.floor(x), math.floor(y)
        spectra[0, j] += 1.0 - (x - j)
        spectra[0, j + 1] += x - j
        spectra[1, k] += 1.0 - (y - k)
        spectra[1, k + 1] += y - k
    return spectra

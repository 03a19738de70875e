"""How certain a found placement of one grid on another is: the covariance of its x, y and yaw."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points, Transform
from mapgraft.contracts.merging import Covariance
from mapgraft_grid.grid_map import OCCUPIED, Classes
from mapgraft_grid.kernels.walls import partners

WALL_MIN_M: Final = 2.0  # with less wall of both maps on each other nothing is said
MOST_CELLS: Final = 4_000  # occupied cells of the source that are asked
DESIGN_EFFECT: Final = 10.0  # neighbouring cells err together: so many count as one (5 to 20 are usual for grids)
PATCH_M: Final = 2.0  # walls this near each other are bent together
CLEARLY_ACROSS: Final = 0.35  # a wall less than 20° off a direction tells nothing along it: grids are ragged
YAW_CAP_RAD: Final = math.pi / math.sqrt(3.0)  # standard deviation of a yaw of which nothing is known

Rows = NDArray[np.float64]  # (k, 3) how x, y and yaw · lever move pieces of wall along their normals


class Lattice(NamedTuple):
    """A grid of classes in metres: the size of its cells and its lower-left corner."""

    classes: Classes
    unit_m: float
    origin_m: NDArray[np.float64]


class Certainty(NamedTuple):
    """The covariance of a placement, and the translation's greatest standard deviation with its direction in [0, π).

    That is the standard deviation of where the walls lie that both maps have, not of where the source's origin lies.
    """

    covariance: Covariance
    sigma_max_m: float
    degenerate_dir_rad: float


def certainty(target: Lattice, source: Lattice, T: Transform, search_m: float, search_rad: float) -> Certainty | None:
    """How certain ``T_target_source`` is if it is the right placement; None with less than 2 m of wall to tell from.

    Every occupied cell of the source with a parallel piece of wall of the target beside it is one equation: how far
    both are apart along the wall's normal. What the equations tell is taken from the normals of both maps (these err
    independently), and a direction only from walls clearly across it, so that a ragged wall does not pass for
    structure along it. The covariance is the sum of

    - the inverse of that information, over the variance of the distances and divided by the design effect; what the
      walls do not tell has the extent of the target as its standard deviation,
    - how much the equations of patches of 2 m contradict each other beyond that (maps bend; Liang and Zeger 1986),
    - the square of how far off the placement is that fits these walls best, and
    - what the search may miss, ``search_m`` and ``search_rad``.

    It is (6, 6) of x, y, z, roll, pitch, yaw in the target's frame; z, roll and pitch are zero. Cells of both must be
    of about one size.
    """
    occupied = np.flatnonzero(source.classes == OCCUPIED)
    step = 1 + occupied.size // MOST_CELLS
    cells = np.stack(np.divmod(occupied[::step], source.classes.shape[1]), axis=1)
    found = _pairs(target, source, T, cells)
    if len(found) * step * target.unit_m < WALL_MIN_M:
        return None
    places, apart_m = found[:, :2] * target.unit_m + target.origin_m, found[:, 6] * target.unit_m
    centre = places.mean(axis=0)
    arms = places - centre
    lever_m = math.sqrt(float((arms**2).sum(axis=1).mean()))
    ours, theirs = (np.column_stack((n, _cross(arms, n) / lever_m)) for n in (found[:, 2:4], found[:, 4:6]))
    extent_m = target.unit_m * math.hypot(*target.classes.shape)
    cap_m = np.array([extent_m, extent_m, YAW_CAP_RAD * lever_m])
    each = step / (float(np.mean(apart_m**2)) + target.unit_m**2 / 6.0) / DESIGN_EFFECT  # both are rounded to cells
    unscale = np.diag((1.0, 1.0, 1.0 / lever_m))
    here = unscale @ _spread(places, ours, theirs, apart_m, each, cap_m) @ unscale
    here += np.diag((search_m, search_m, search_rad)) ** 2
    values, vectors = np.linalg.eigh(here[:2, :2])
    direction_rad = math.atan2(vectors[1, 1], vectors[0, 1]) % math.pi
    return Certainty(_of_translation(here, centre, T), math.sqrt(values[1]), direction_rad)


def _spread(
    places: Points, ours: Rows, theirs: Rows, apart_m: NDArray[np.float64], each: float, cap_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The covariance (3, 3) of x, y and yaw · lever that equations of that weight each leave, but for the search."""
    told, clear = _told(ours, theirs)
    model = np.linalg.inv(each * told + np.diag(cap_m**-2))
    off = model @ (each * clear.T @ apart_m)
    rest = _by_patch(places, each * clear * (apart_m - clear @ off)[:, None]) @ model
    out: NDArray[np.float64] = model + rest.T @ rest + np.outer(off, off)
    return out


def _pairs(target: Lattice, source: Lattice, T: Transform, cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """The rows of ``partners``, the pieces' places in the target's cells."""
    shift = (T.apply(source.origin_m[None])[0] - target.origin_m) / target.unit_m
    ratio = source.unit_m / target.unit_m  # turned and, where the cells differ a little, stretched
    c, s = ratio * math.cos(T.yaw_rad), ratio * math.sin(T.yaw_rad)
    out: NDArray[np.float64] = partners(target.classes, source.classes, cells, OCCUPIED, c, s, shift[0], shift[1])
    return out


def _cross(arms: Points, normals: Points) -> NDArray[np.float64]:
    """How far a small turn moves what lies at the arms along the normals."""
    out: NDArray[np.float64] = arms[:, 0] * normals[:, 1] - arms[:, 1] * normals[:, 0]
    return out


def _told(ours: Rows, theirs: Rows) -> tuple[NDArray[np.float64], Rows]:
    """Σ of the rows' products (3, 3) and our rows, without what ragged walls would tell along themselves."""
    product = ours.T @ theirs
    _, vectors = np.linalg.eigh(product + product.T)
    a, b = ours @ vectors, theirs @ vectors
    clear = np.minimum(abs(a), abs(b)) >= CLEARLY_ACROSS
    told = (vectors * np.maximum(0.0, (a * b * clear).sum(axis=0))) @ vectors.T
    return told, (a * clear) @ vectors.T


def _by_patch(places: Points, values: Rows) -> Rows:
    """The sums of the values over the patches of 2 m in which their places (k, 2) lie."""
    patches = np.floor(places / PATCH_M).astype(np.int64)
    _, patch = np.unique(patches, axis=0, return_inverse=True)
    sums = np.zeros((int(patch.max()) + 1, 3))
    np.add.at(sums, patch.ravel(), values)
    return sums


def _of_translation(here: NDArray[np.float64], centre: NDArray[np.float64], T: Transform) -> Covariance:
    """The (6, 6) covariance of T from that (3, 3) of where it brings what lies at the centre."""
    jacobian = np.zeros((6, 3))
    jacobian[0, 0] = jacobian[1, 1] = jacobian[5, 2] = 1.0
    jacobian[:2, 2] = centre[1] - T.y_m, T.x_m - centre[0]  # turning about the centre moves the origin
    out = jacobian @ here @ jacobian.T
    symmetric: Covariance = (out + out.T) / 2.0
    return symmetric

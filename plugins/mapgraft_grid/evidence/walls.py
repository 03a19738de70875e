"""Whether two maps say the same, and have their walls where the other has walls: kappa, contradiction, recall."""

from __future__ import annotations

import math

from mapgraft.contracts import Anew, Comparison, Measurement
from mapgraft_grid.evidence.joint import BLOCK_M, Standing, standing_of
from mapgraft_grid.similarity import kappa


class Contradiction:
    """The share of both maps' walls that lie in free space of the other, more than 0.25 m from any wall of it.

    The value is NaN without any wall where both maps know something. The support is the number of blocks of 0.25 m that
    hold such walls. Details: ``own_m`` and ``donor_m``, the length of the walls of either that are contradicted;
    ``good_patches`` and ``bad_patches``, how many patches of 2 m speak for and against.
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _contradiction)


class Recall:
    """The share of both maps' walls that have a wall of the other within 0.25 m, where both maps know something.

    The value is NaN without any wall there. The support is the number of blocks of 0.25 m that hold walls. Details:
    ``own`` and ``donor``, the share of either; ``common_m``, the length of the walls that both have, and ``own_m`` and
    ``donor_m``, that of all walls there.
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _recall)


class Kappa:
    """Cohen's κ of the classes where both maps know something: their agreement beyond that of unrelated maps.

    The value is NaN where one class is all there is. The support is the number of jointly known cells (about 0.1 m).
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _kappa)


def _kappa(comparison: Comparison) -> Measurement:
    table = standing_of(comparison, "kappa").table
    return Measurement("kappa", kappa(table), "1", int(table.sum()), "higher")


def _contradiction(comparison: Comparison) -> Measurement:
    found = standing_of(comparison, "contradiction")
    details = {
        "own_m": found.against_m[0],
        "donor_m": found.against_m[1],
        "good_patches": float(found.good),
        "bad_patches": float(found.bad),
    }
    value = _share(sum(found.against_m), sum(found.walls_m))
    return Measurement("contradiction", value, "1", _blocks(found), "lower", details)


def _recall(comparison: Comparison) -> Measurement:
    found = standing_of(comparison, "recall")
    details = {
        "own": _share(found.near_m[0], found.walls_m[0]),
        "donor": _share(found.near_m[1], found.walls_m[1]),
        "common_m": sum(found.near_m) / 2.0,
        "own_m": found.walls_m[0],
        "donor_m": found.walls_m[1],
    }
    value = _share(sum(found.near_m), sum(found.walls_m))
    return Measurement("recall", value, "1", _blocks(found), "higher", details)


def _share(part_m: float, whole_m: float) -> float:
    return part_m / whole_m if whole_m > 0.0 else math.nan


def _blocks(found: Standing) -> int:
    return round(sum(found.walls_m) / BLOCK_M)

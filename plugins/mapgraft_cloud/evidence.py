"""Metrics of point clouds: what both maps have, and what one has where the other saw through."""

from __future__ import annotations

import math
from collections.abc import Callable

from mapgraft.contracts import Comparison, ConfigError, Measurement, Step
from mapgraft_cloud.agreement import Agreement
from mapgraft_cloud.cloud_map import as_map
from mapgraft_cloud.surface import SPACING_M

Measure = Callable[[Agreement, bool], Measurement]  # whether one of the maps knows free space

_FEWEST_PLACES = 20  # on surfaces: fewer tell nothing


class CloudOverlap:
    """The share of both maps' surfaces, where the other map looked, that the other map has too, within 0.3 m.

    With ``aligned`` (both z axes point up) only walls count: floors and ceilings agree everywhere. Where a map knows no
    free space, it looked where something of it lies within 1 m. The support is the number of such places, one per
    0.25 m. NaN with fewer than 20. Details: ``own_m2`` and ``donor_m2``, the shared surface of either map.
    """

    def __init__(self, *, aligned: bool = True) -> None:
        self._aligned = _flag("cloud_overlap", aligned)

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, self._aligned, _overlap)


class CloudContradiction:
    """The share of both maps' surfaces that the other map saw through, of what it saw through or has too.

    With ``aligned`` only walls count. The support is the number of such places, one per 0.25 m. NaN with fewer than 20,
    and where neither map knows any free space. Details: ``own_m2`` and ``donor_m2``, what was seen through of either.
    """

    def __init__(self, *, aligned: bool = True) -> None:
        self._aligned = _flag("cloud_contradiction", aligned)

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, self._aligned, _contradiction)


class Anew:
    """Measures anew whenever it is asked; what costs much is kept with the two maps."""

    __slots__ = ("_aligned", "_comparison", "_measure")

    def __init__(self, comparison: Comparison, aligned: bool, measure: Measure) -> None:
        self._comparison, self._aligned, self._measure = comparison, aligned, measure

    def update(self, step: Step) -> Measurement:
        own, donor = as_map(self._comparison.target), as_map(self._comparison.donor)
        found = own.agreed(donor, self._aligned)
        return self._measure(found, own.has_free_space or donor.has_free_space)


def _overlap(found: Agreement, _: bool) -> Measurement:
    details = {"own_m2": found.own.shared_m2, "donor_m2": found.donor.shared_m2}
    return _share("cloud_overlap", found.shared_m2, found.covered_m2, "higher", details)


def _contradiction(found: Agreement, sees: bool) -> Measurement:
    details = {"own_m2": found.own.through_m2, "donor_m2": found.donor.through_m2}
    whole = found.through_m2 + found.shared_m2 if sees else 0.0
    return _share("cloud_contradiction", found.through_m2, whole, "lower", details)


def _share(name: str, part_m2: float, whole_m2: float, better: str, details: dict[str, float]) -> Measurement:
    support = round(2.0 * whole_m2 / SPACING_M**2)
    value = part_m2 / whole_m2 if support >= _FEWEST_PLACES else math.nan
    return Measurement(name, value, "1", support, "higher" if better == "higher" else "lower", details)


def _flag(name: str, value: bool) -> bool:
    if not isinstance(value, bool):
        raise ConfigError(f"aligned of {name} must be true or false, found {value!r}")
    return value

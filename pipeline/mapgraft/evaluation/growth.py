"""What the receiver of a pair comes to know by further mapping."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

from mapgraft.evaluation.building import Pair


@dataclass(frozen=True, slots=True)
class Growth:
    """``walls_m`` is the length of the donor's walls that the receiver has come to know, None where there is no truth.

    ``integrated_s`` is what each further scan took to be mapped, without any merge.
    """

    walls_m: float | None
    integrated_s: tuple[float, ...]


def grow(pair: Pair) -> Growth:
    """Map the further scans of a pair on a copy of the receiver's layer."""
    map_type, truth = pair.receiver.map_type, pair.truth
    layer = map_type.decode(map_type.encode(pair.receiver.layer))
    integrated_s = []
    for observation in pair.further:
        began_s = perf_counter()
        map_type.integrate(layer, observation)
        integrated_s.append(perf_counter() - began_s)
    if truth is None:
        return Growth(None, tuple(integrated_s))
    return Growth(truth.new_walls_m(pair.receiver.map, map_type.view(layer)), tuple(integrated_s))

"""What the two maps have come to know of each other since the donor was placed: no match has used it."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from mapgraft.contracts import Comparison, Measurement, Step, Transform
from mapgraft_lines.evidence.standing import ACROSS_M, PATCH_M, votes
from mapgraft_lines.line_map import LineMap, as_map
from mapgraft_lines.scene import judged, scene_of
from mapgraft_lines.segments import cell_keys
from mapgraft_lines.table import Keys

BLOCK_M: Final = 0.5  # what lies in one block is seen or missed together: it counts once
VOTES_MIN: Final = 2  # pieces: fewer decide nothing

Blocks = dict[tuple[int, int], bool]  # (x, y) of a block → whether it agrees


class News:
    """The share of blocks of 0.5 m that speak against the donor's place, on evidence newer than the placement.

    A piece of a wall of either map speaks where both maps know something now and did not both when the donor was
    placed: for it when a wall of the other explains it, against it when it stands in the other's free space. A block
    speaks as most of its pieces do, with 2 or more. Of the receiver's map only what it has seen itself counts. When the
    merge is registered anew only what is newer than that speaks; what was counted before stays.

    NaN as long as no block speaks; the support is their number. Details: ``agreed`` and ``against`` (blocks),
    ``agreed_m``, and ``places``, in how many patches of 2 m a block speaks against.
    """

    def track(self, comparison: Comparison) -> NewsTracker:
        return NewsTracker(comparison)


class NewsTracker:
    """The blocks that have spoken, from both maps as they are now and what they knew at the placement."""

    __slots__ = ("_T", "_before", "_comparison", "_known", "_now")

    def __init__(self, comparison: Comparison) -> None:
        self._comparison = comparison
        self._T: Transform = comparison.T_receiver_donor
        self._known = _jointly_known(*self._maps())
        self._before: Blocks = {}
        self._now: Blocks = {}

    def update(self, step: Step) -> Measurement:
        if step.donor_changed and self._comparison.T_receiver_donor != self._T:
            self._T = self._comparison.T_receiver_donor
            self._before = {**self._before, **self._now}
            self._known = _jointly_known(*self._maps())
        self._now = self._heard()
        return _measured({**self._before, **self._now})

    def _maps(self) -> tuple[LineMap, LineMap]:
        return _own_part(as_map(self._comparison.target)), as_map(self._comparison.donor)

    def _heard(self) -> Blocks:
        target, donor = self._maps()
        fresh = np.setdiff1d(_jointly_known(target, donor), self._known, assume_unique=True)
        if not len(fresh) or not len(target.walls) or not len(donor.walls):
            return {}
        told = judged(scene_of(target, "receiver"), scene_of(donor, "donor"), ACROSS_M)
        points = np.concatenate([part[0] for part in told])
        index = np.floor(points / target.cell_m).astype(np.int64)
        new = np.isin(cell_keys(index[:, 0], index[:, 1]), fresh)
        blocks, agreed, against = votes(points[new], np.concatenate([part[1] for part in told])[new], BLOCK_M)
        spoke = (agreed + against >= VOTES_MIN) & (agreed != against)
        return {
            (x, y): yes for (x, y), yes in zip(blocks[spoke].tolist(), (agreed > against)[spoke].tolist(), strict=True)
        }


def _own_part(map_: LineMap) -> LineMap:
    """What the map's own source has seen."""
    if map_.received.is_empty:
        return map_
    if "own part" not in map_.kept:
        map_.kept["own part"] = LineMap(map_.cell_m, map_.own, reading=map_.reading)
    part: LineMap = map_.kept["own part"]
    return part


def _jointly_known(target: LineMap, donor: LineMap) -> Keys:
    return np.intersect1d(target.known_keys(), donor.known_keys(), assume_unique=True)


def _measured(blocks: Blocks) -> Measurement:
    agreed = sum(blocks.values())
    against = [block for block, agrees in blocks.items() if not agrees]
    per = round(PATCH_M / BLOCK_M)
    details = {
        "agreed": float(agreed),
        "against": float(len(against)),
        "agreed_m": agreed * BLOCK_M,
        "places": float(len({(x // per, y // per) for x, y in against})),
    }
    value = len(against) / len(blocks) if blocks else math.nan
    return Measurement("line_news", value, "1", len(blocks), "lower", details)

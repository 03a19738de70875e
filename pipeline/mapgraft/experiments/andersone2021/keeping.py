"""One merge kept in three ways: what the metrics see, what an update costs, and what a revert leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from time import perf_counter

import numpy as np

from mapgraft.comparison import Compared
from mapgraft.config import ReversalName
from mapgraft.contracts import Contribution, Map, MapType, Match, Metric, Observation, Step
from mapgraft.evaluation.building import Pair
from mapgraft.evaluation.scored import measured
from mapgraft.experiments.andersone2021.outcome import Cost, Kept, Leftovers
from mapgraft.experiments.andersone2021.raster import UNKNOWN, left_masks, raster_of
from mapgraft.experiments.andersone2021.settings import STRATEGIES
from mapgraft.reversal import Reversal, new_reversal

ID = "merge"
ROUNDS = 3  # of timing; the quickest counts


@dataclass(frozen=True, slots=True, eq=False)
class Graft:
    """A pair with the match that was accepted and the contribution that the fuser made of it."""

    pair: Pair
    match: Match
    contribution: Contribution

    @property
    def map_type(self) -> MapType:
        return self.pair.receiver.map_type

    def merged(self, strategy: ReversalName) -> Reversal:
        """The receiver's map with the donor in it, as it is right after the merge."""
        reversal = self._mapped(strategy)
        reversal.merge(ID, self.contribution)
        return reversal

    def never_merged(self) -> Reversal:
        """The receiver's map after the further scans, had there been no merge."""
        reversal = self._mapped("ledger")
        for observation in self.pair.further:
            reversal.observe(observation)
        return reversal

    def comparison(self, reversal: Reversal) -> Compared:
        """What metrics see of the merge with the receiver's map kept in that way."""
        return Compared(
            self.map_type,
            reversal.subject,
            self.contribution.T_receiver_donor,
            self.match,
            self.contribution.layer,
            lambda: (reversal.compared_layer(), reversal.compared()),
        )

    def _mapped(self, strategy: ReversalName) -> Reversal:
        reversal = new_reversal(strategy, self.map_type)
        for observation in self.pair.receiver.observations:
            reversal.observe(observation)
        return reversal


def kept_every_way(graft: Graft, metrics: Mapping[str, Metric]) -> dict[ReversalName, Kept]:
    """Keep one merge in every way, map on, measure, and take it out again."""
    never = graft.never_merged()
    costs = time_updates(graft)
    return {strategy: _kept(graft, strategy, metrics, never, costs[strategy]) for strategy in STRATEGIES}


def _kept(graft: Graft, strategy: ReversalName, metrics: Mapping[str, Metric], never: Reversal, cost: Cost) -> Kept:
    reversal = graft.merged(strategy)
    comparison = graft.comparison(reversal)
    trackers = {name: metric.track(comparison) for name, metric in metrics.items()}
    initial = measured({name: tracker.update(Step()) for name, tracker in trackers.items()})
    for observation in graft.pair.further:
        reversal.observe(observation)
    end = measured({name: tracker.update(Step()) for name, tracker in trackers.items()})
    began_s = perf_counter()
    exactness = reversal.revert(ID)
    reversal.fused()
    revert_s = perf_counter() - began_s
    return Kept(strategy, initial, end, cost, exactness, revert_s, _leftovers(graft.map_type, reversal, never))


def _leftovers(map_type: MapType, reverted: Reversal, never: Reversal) -> Leftovers:
    identical = map_type.encode(reverted.compared_layer()) == map_type.encode(never.compared_layer())
    return compare(map_type, reverted.fused(), never.fused(), identical=identical)


def compare(map_type: MapType, reverted: Map, never: Map, *, identical: bool) -> Leftovers:
    """Hold a map after a revert against the one that never merged, cell by cell as viewers see them."""
    after, before = raster_of(map_type, reverted).joined(raster_of(map_type, never))
    left = {name: int(mask.sum()) for name, mask in left_masks(after, before).items()}
    return Leftovers(
        known=int((before.classes != UNKNOWN).sum()),
        lost=left["lost"],
        alien=left["alien"],
        changed=left["changed"],
        touched=sum(left.values()),
        identical=identical,
    )


def time_updates(graft: Graft, rounds: int = ROUNDS) -> dict[ReversalName, Cost]:
    """What the further scans cost with the merge kept in each way.

    The ways take turns scan by scan, each scan beginning with another one, so that whatever slows the machine slows
    all of them; of several rounds the quickest counts.
    """
    times_s = np.full((len(STRATEGIES), rounds, len(graft.pair.further), 3), np.inf)
    for turn in range(rounds):
        reversals = [graft.merged(strategy) for strategy in STRATEGIES]
        for reversal in reversals:  # the maps of before the first update are there already
            reversal.fused()
            reversal.compared()
        for scan, shift in product(range(len(graft.pair.further)), range(len(STRATEGIES))):
            which = (scan + turn + shift) % len(STRATEGIES)
            times_s[which, turn, scan] = _timed(reversals[which], graft.pair.further[scan])
    quickest_s: Sequence[Sequence[float]] = times_s.min(axis=1).sum(axis=1).tolist()
    return {strategy: Cost(*took_s) for strategy, took_s in zip(STRATEGIES, quickest_s, strict=True)}


def _timed(reversal: Reversal, observation: Observation) -> tuple[float, float, float]:
    """Seconds of one update, of the robot's map with it, and of the map that metrics look at."""
    began_s = perf_counter()
    reversal.observe(observation)
    updated_s = perf_counter()
    reversal.fused()
    viewed_s = perf_counter()
    reversal.compared()
    return updated_s - began_s, viewed_s - updated_s, perf_counter() - viewed_s

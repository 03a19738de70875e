"""What one robot does about its own merges that contradict others: it tries them out, and remembers why they went."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from mapgraft.attempt import Meeting
from mapgraft.contracts import MapError, Transform
from mapgraft.errors import PluginError
from mapgraft.graph.chains import Similarity, seen_from
from mapgraft.graph.claims import MOST_SUPPORT, Claim, Claims, Edge, Source
from mapgraft.graph.consistency import Explanation
from mapgraft.graph.held import Layers
from mapgraft.graph.loops import Loop
from mapgraft.graph.trial import try_out
from mapgraft.merge import Merge
from mapgraft.refusals import NEAR_M, NEAR_RAD
from mapgraft.registration import displacement
from mapgraft.standing import Ending, Standing

PLACE_M: Final = 0.5  # transforms closer than about this need no trial of their own
PLACE_RAD: Final = 0.1
PER_DOUBLING: Final = 4  # trials while the own map doubles

Named = tuple[Edge, int, tuple[int, int]]


@dataclass(slots=True)
class Contradictions:
    """The own merges that lie in loops that do not close.

    ``_tried`` tells by merge what it was tried on, so that the same is not tried twice; ``_because`` by reverted merge
    the claims that it contradicted, loop by loop: when none of these loops stands any more, nothing is refused.
    """

    standing: Standing
    _tried: dict[str, tuple[object, ...]] = field(default_factory=dict)
    _because: dict[str, tuple[str, list[frozenset[Named]]]] = field(default_factory=dict)

    def settle(self, explanation: Explanation) -> None:
        """Merges that contradict nothing any more need no trial."""
        in_question = {edge.donor.name for edge in explanation.told if edge.receiver == self.standing.own.me}
        for merge in self.standing.by_donor.values():
            if merge.trial is not None and merge.donor not in in_question:
                merge.trial = None
                self._tried.pop(merge.merge_id, None)

    def try_out(self, claim: Claim, explanation: Explanation, layers: Layers, stamp_ns: int) -> None:
        """Measure an own merge on both maps as they are now, against where the claims that it contradicts put it."""
        merge = self.standing.by_donor.get(claim.donor.name)
        if merge is None or merge.decided_by_person or merge.unwatched or self.standing.reversal.subject != "own":
            return
        rivals = [loop.without(claim) for loop in explanation.loops if not loop.consistent and claim in loop.claims]
        key = self._key(merge, rivals)
        if self._tried.get(merge.merge_id) == key or (meeting := self._meeting(merge, claim.donor, layers)) is None:
            return
        self._tried[merge.merge_id] = key
        attempts, about_m = self.standing.attempts, merge.site.about_m
        try:
            merge.trial = try_out(attempts, merge.tools, meeting, merge.match, _apart(rivals), about_m)
        except MapError:
            merge.trial = None
        except PluginError as error:
            self.standing.complain(error, stamp_ns, merge.donor, merge=merge)

    def _key(self, merge: Merge, rivals: Iterable[Similarity]) -> tuple[object, ...]:
        grown = int(PER_DOUBLING * math.log2(1 + self.standing.reversal.version))
        places = sorted({_place(rival.T_target_source) for rival in rivals})
        return merge.provenance, merge.corrections, grown, _place(merge.match.T_receiver_donor), tuple(places)

    def _meeting(self, merge: Merge, donor: Source, layers: Layers) -> Meeting | None:
        if merge.meeting is not None:
            return merge.meeting
        sent = layers.sent(donor)
        if sent is None or sent.provenance != merge.provenance:
            return None
        try:
            return self.standing.attempts.meet(merge.tools, self.standing.own.receive(sent))
        except (MapError, PluginError):
            return None

    def reverted(self, merge: Merge, stood: Claim, loops: Iterable[Loop]) -> None:
        """An own merge was taken out because of others: remember which, of the ``loops`` with its claim as it stood."""
        mine = [loop for loop in loops if not loop.consistent and stood in loop.claims]
        others = [frozenset(_named(one) for one in loop.claims if one.edge != stood.edge) for loop in mine]
        self._because[merge.merge_id] = (merge.donor, others)

    def lift(self, claims: Claims) -> None:
        """Where every loop that spoke against a merge has lost a claim, its place is no longer refused."""
        standing = {_named(claim) for claim in claims.active()}
        for merge_id, (donor, loops) in list(self._because.items()):
            if not any(loop <= standing for loop in loops):
                self.standing.attempts.refusals.lift(donor, merge_id)
                del self._because[merge_id]


def is_contradicted(claim: Claim, me: Source, ended: Ending, margin: float) -> bool:
    """Whether own cells have spoken against a merge where another robot's claim says the same from its side.

    They must outweigh what speaks for the claim by the margin (nats).
    """
    if ended.corrections != claim.corrections[::-1] or claim.support - min(ended.against, MOST_SUPPORT) > -margin:
        return False
    T = seen_from(me, claim).T_target_source
    shift_m, turn_rad = displacement(ended.T_receiver_donor, T, ended.about_m)
    return shift_m <= NEAR_M and turn_rad <= NEAR_RAD


def _apart(rivals: Iterable[Similarity]) -> list[Similarity]:
    """One of each place, in the order in which they come."""
    return list({_place(rival.T_target_source): rival for rival in reversed(list(rivals))}.values())[::-1]


def _place(T: Transform) -> tuple[int, int, int]:
    return round(T.x_m / PLACE_M), round(T.y_m / PLACE_M), round(T.yaw_rad / PLACE_RAD)


def _named(claim: Claim) -> Named:
    return claim.edge, claim.epoch, claim.corrections

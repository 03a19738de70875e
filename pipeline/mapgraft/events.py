"""The history of a mission: one event per thing that happened, append-only, in the order in which it happened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

from mapgraft.contracts import Covariance, Exactness, Map, MapMetadata, MapType, Measurement, Observation, Transform

Kind = Literal[
    "offered",  # a donor told its metadata
    "rejected",  # the decision table has no procedure, or the pair is forbidden
    "unmatched",  # the matcher or the acceptor found nothing good enough
    "ambiguous",  # probable, but not enough to merge, or more than one place fits; tried again later
    "merged",  # a contribution entered the receiver's map (provisional)
    "updated",  # a newer version of the donor's layer, a better transform, or both took the place of the older ones
    "verified",  # the metrics were measured and the verifier kept the merge; not every time, see Merge.tells
    "confirmed",  # the verifier or a person is sure
    "reverted",  # the contribution was taken out again
    "attached",  # a layer entered the map by a chain of merges of several robots, without a merge of its own
    "reattached",  # another chain, a transform that has moved, or a newer layer took the place of what was attached
    "detached",  # what was attached was taken out again
    "unattached",  # a layer that merges lead to is not attached, and why; said once as long as the reason is the same
    "disputed",  # a merge contradicts others and nobody can tell which is wrong: nothing is attached through it
    "disbelieved",  # own observations contradict what was attached: this robot no longer believes another's merge
    "corrected",  # the robot learnt where it had really been, and mapped anew what it had observed
    "renamed",  # the robot is another source from now on: its map frame began anew, or another robot has its name
    "failed",  # a plugin raised, took too long or gave nonsense; the run goes on with the next rule or robot
]

STANDING = ("merged", "updated", "verified", "confirmed")  # kinds after which the contribution is in the map


@dataclass(frozen=True, slots=True)
class Event:
    """One row of the history.

    ``seq`` rises by one from 0. ``stamp_ns`` is data time. ``merge_id`` is ``<receiver>.<donor>.<n>``, n counting the
    attempts of that pair from 1, and empty where no attempt was made; for a layer that was attached it is
    ``<receiver>.<donor>.via.<n>``. ``through`` are the ids of the merges that lead to what was attached, from the
    receiver on, or of the merge that an opinion is about. ``T_receiver_donor`` is None where there is no hypothesis.
    ``state`` is the merge's state after the event.
    """

    seq: int
    stamp_ns: int
    kind: Kind
    receiver: str
    donor: str
    merge_id: str = ""
    state: Literal["", "candidate", "provisional", "confirmed", "reverted", "attached", "detached"] = ""
    reason: str = ""
    by: str = ""  # who decided: a plugin's name, "decision table", or a person
    rule: str = ""
    matcher: str = ""
    fuser: str = ""
    verifier: str = ""
    reversal: str = ""
    T_receiver_donor: Transform | None = None
    scale: float = 1.0
    covariance: Covariance | None = None
    score: float | None = None
    margin: float | None = None
    hypotheses: int = 0
    donor_epoch: int = 0
    donor_version: int = 0
    receiver_version: int = 0
    bytes_received: int = 0
    measurements: Sequence[Measurement] = ()
    evidence: Mapping[str, float] = field(default_factory=dict)
    exactness: Exactness | None = None
    through: Sequence[str] = ()


@dataclass(frozen=True, slots=True, eq=False)
class DonorMap:
    """A donor's map as a receiver has it: in the receiver's frame, unweighted, what metrics hold against its own.

    ``map_type`` is the type in which the two maps meet, which is not always the receiver's.
    """

    map_type: MapType
    map: Map


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """One robot's map as of now: its own, the fused one, and what it would offer.

    ``layer`` is the offered layer in its canonical encoding; equal bytes mean equal evidence. ``metadata`` is of the
    own map, ``version`` its number of observations: a single map offers what it had before its first merge. ``why``
    tells what the snapshot was taken for. ``donors`` holds what stands in the fused map by the donor's name, before a
    merge also what is about to enter it.
    """

    robot: str
    stamp_ns: int
    why: Literal["before merge", "after merge", "before revert", "after revert", "end"]
    map_type: MapType
    own: Map
    fused: Map
    layer: bytes
    metadata: MapMetadata
    version: int
    merge_id: str = ""
    donors: Mapping[str, DonorMap] = field(default_factory=dict)


class Sink(Protocol):
    """Where a replay writes to. The replay calls it in order; a sink never answers back."""

    def observed(self, observation: Observation) -> None: ...
    def happened(self, event: Event) -> None: ...
    def mapped(self, snapshot: Snapshot) -> None:
        """Taken before and after each merge and revert, and of every robot at the end."""
        ...

"""Finding, accepting and fusing: what one attempt to merge passes from hand to hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts.geometry import Transform
from mapgraft.contracts.maps import Contribution, Donation, Map, MapType
from mapgraft.contracts.verification import Measurements

# (6, 6) of x, y, z (m), roll, pitch, yaw (rad), in the target's frame; rows of what a planar map cannot vary are zero
Covariance = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """A guess of the transform from elsewhere (a person, the recording), with its covariance.

    Where the donor's scale is unknown it tells where the donor's origin lies and how its map is turned, whatever the
    scale.
    """

    T_receiver_donor: Transform
    covariance: Covariance
    origin: str


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """One hypothesis of how the donor's map lies in the receiver's.

    ``score`` is the matcher's own, larger is better; ``margin`` is how far it lies above the best **other** hypothesis
    (infinite when there is none). ``covariance`` is None when the matcher cannot tell. ``evidence`` holds further named
    numbers, shown in the events.
    """

    T_receiver_donor: Transform
    score: float
    margin: float
    scale: float = 1.0
    covariance: Covariance | None = None
    evidence: Mapping[str, float] = field(default_factory=dict)


class Matcher(Protocol):
    """Finds hypotheses of ``T_target_source``, best first, at least two when two exist; rigid, scale 1 unless unknown.

    A matcher that searches only where a prior says tells in the evidence of its matches ``prior_score``: what the
    prior's own transform scores, unrefined, on the same scale as the matches. Only so the engine knows whether a merge
    that stands is worth moving.

    Returns an empty sequence when the maps give no hypothesis at all. Raises EmptyMapError on a map without content.
    Equal inputs give equal results; inputs are not written.
    """

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]: ...


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A match with the measurements that the rule's metrics gave it before any fusion."""

    match: Match
    measurements: Measurements


@dataclass(frozen=True, slots=True)
class Decision:
    """What the acceptor says; ``chosen`` indexes the candidates and is None unless the verdict is ``provisional``."""

    verdict: Literal["provisional", "ambiguous", "unmatched"]
    chosen: int | None
    reason: str


class Acceptor(Protocol):
    def accept(self, candidates: Sequence[Candidate]) -> Decision:
        """Choose among the candidates, which come best first and may be empty."""
        ...


class Fuser(Protocol):
    def fuse(self, map_type: MapType, target: Map, source: Donation, match: Match) -> Contribution:
        """Make a contribution of the donor's layer, weighted by quality.

        ``map_type`` is the receiver's (it places the layer), ``target`` the view of the receiver's **own** layer alone,
        so that taking one merge out leaves the others as they were.
        """
        ...

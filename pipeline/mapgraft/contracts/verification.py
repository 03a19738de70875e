"""Measuring a merge while mapping goes on, and judging it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

from mapgraft.contracts.geometry import Transform
from mapgraft.contracts.maps import Layer, Map, MapType, Region
from mapgraft.contracts.observations import Observation
from mapgraft.contracts.rendezvous import Sighting

if TYPE_CHECKING:
    from mapgraft.contracts.merging import Match

RECENT_SAMPLES = 100  # so many of the latest samples a verifier is given, besides the first one


class Comparison(Protocol):
    """What metrics see of one candidate or one merge. All properties are as of now, not as of the start.

    ``target`` is the receiver's own map before a merge and, after it, what the reversal hands out: the own map with
    ``ledger`` and ``multi_map``, the merged map with ``single_map``, exactly as the paper compares them. ``donor`` is
    the donor's map alone, unweighted, placed in the receiver's frame. ``subject`` tells which of the two target is.
    """

    @property
    def map_type(self) -> MapType: ...
    @property
    def target(self) -> Map: ...
    @property
    def donor(self) -> Map: ...
    @property
    def target_layer(self) -> Layer: ...
    @property
    def donor_layer(self) -> Layer:
        """The donor's layer in the receiver's frame and type (``Contribution.layer``)."""
        ...

    @property
    def T_receiver_donor(self) -> Transform: ...
    @property
    def match(self) -> Match:
        """The hypothesis that placed the donor, with its score, margin, covariance and evidence.

        Its transform is ``T_receiver_donor`` before it was put into fixed point.
        """
        ...

    @property
    def sightings(self) -> Sequence[Sighting]:
        """Where the two robots saw each other, as far as anybody told; mostly none."""
        ...

    @property
    def subject(self) -> Literal["own", "merged"]: ...


class Step:
    """What has happened since the tracker's last update.

    ``touched`` is None at the first update and when everything may have changed; it is united from what the single
    observations touched when it is first asked for. ``observations`` are the receiver's own, in their order.
    ``donor_changed`` says that the donor's layer, the transform, or both are other ones now: the receiver has got a
    newer version of the donor's map, or the merge was registered anew. The comparison then shows the new
    ``donor_layer``, ``T_receiver_donor`` and ``match``, and ``touched`` is None. Observations made before are never in
    that step or a later one: they were told in a step of their own first, because evidence that refined a transform
    must not test it.
    """

    __slots__ = ("_touched", "donor_changed", "observations")

    def __init__(
        self,
        touched: Region | Callable[[], Region] | None = None,
        observations: Sequence[Observation] = (),
        donor_changed: bool = False,
    ) -> None:
        self._touched = touched
        self.observations = observations
        self.donor_changed = donor_changed

    @property
    def touched(self) -> Region | None:
        if callable(self._touched):
            self._touched = self._touched()
        return self._touched


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a metric found at one place: where in the receiver's map frame, what, and how much of it.

    ``kind`` is a few words (``wall missing``); ``start_m`` and ``end_m`` (x, y, z) are the ends of what was found,
    equal where it is a point; ``value`` is in ``unit``.
    """

    kind: str
    start_m: tuple[float, float, float]
    end_m: tuple[float, float, float]
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class Measurement:
    """One value of one metric: NaN when there is too little to measure.

    ``support`` is how much it rests on (cells, beams, …) and ``better`` which way it should go; ``details`` holds
    further named values (variants, parts, the same in another unit). A metric whose value is the probability that the
    match is right tells ``log_odds`` (nats) among them: by that the engine knows it. ``findings`` are the single things
    that it found, if that is what people want to see; of each standing merge the latest are written to a file and shown
    in viewers.
    """

    name: str
    value: float
    unit: str
    support: int
    better: Literal["higher", "lower"]
    details: Mapping[str, float] = field(default_factory=dict)
    findings: Sequence[Finding] = ()

    @property
    def sufficient(self) -> bool:
        return not math.isnan(self.value)


Measurements = Mapping[str, Measurement]  # metric name → its measurement


class Tracker(Protocol):
    """One metric of one candidate or merge. An incremental update equals a fresh measurement (a law)."""

    def update(self, step: Step) -> Measurement: ...


class Anew:
    """The tracker of metrics that look at both maps as they are, whatever has happened since: it measures anew.

    What costs much is kept with the maps by those who compute it.
    """

    __slots__ = ("_comparison", "_measure")

    def __init__(self, comparison: Comparison, measure: Callable[[Comparison], Measurement]) -> None:
        self._comparison = comparison
        self._measure = measure

    def update(self, step: Step) -> Measurement:
        return self._measure(self._comparison)


@runtime_checkable
class LocalTracker(Tracker, Protocol):
    """A tracker that looks at a part of the receiver's map only, and need not be asked while that stays as it is.

    ``concerns`` is read after each update: units of the receiver's map outside of which nothing, neither map nor
    observation, makes any difference to the measurement; None when everything does. Observations that do not touch it
    may be left out of later steps, and what was measured last then still holds.
    """

    @property
    def concerns(self) -> Region | None: ...


class Metric(Protocol):
    def track(self, comparison: Comparison) -> Tracker: ...


@dataclass(frozen=True, slots=True)
class Sample:
    """All measurements of one merge at one time, and the merge's state when they were made.

    ``observations`` counts the receiver's since the merge.
    """

    stamp_ns: int
    observations: int
    measurements: Measurements
    state: Literal["provisional", "confirmed"] = "provisional"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the verifier says, and the numbers behind it.

    ``evidence`` goes into the event. By convention ``<name>.revert_at`` and ``<name>.confirm_at`` are the limits of
    ``<name>``, which is another entry of the evidence, a metric, or ``<metric>.<detail>``: at that value or beyond it
    the merge is reverted or confirmed, as far as this number has a say. A number that has a limit to each side tells
    the two as ``<name>.revert_at.min`` and ``<name>.revert_at.max``. ``log_odds_wrong`` are the log-odds (nats) that
    the merge is wrong: where a verifier tells them, they are what other robots hear of how sure this one is.
    """

    action: Literal["keep", "confirm", "revert"]
    reason: str
    evidence: Mapping[str, float] = field(default_factory=dict)


class Verifier(Protocol):
    def verify(self, history: Sequence[Sample], reversal: str) -> Verdict:
        """Judge a merge from its samples, oldest first; the first one was taken at the merge itself.

        Of the later ones the latest ``RECENT_SAMPLES`` are there. A merge that is confirmed is judged on: its samples
        say so in ``state``, and ``revert`` takes it out like any other. ``reversal`` names the receiver's way of
        keeping contributions, because it decides what the metrics saw.
        """
        ...

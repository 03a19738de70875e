"""A plugin with a map type that is nothing like a grid: beacons heard, or listened for in vain, along a line.

The engine must carry it all the same.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mapgraft.contracts import (
    Candidate,
    Comparison,
    Contribution,
    Decision,
    Descriptor,
    Donation,
    EmptyMapError,
    Map,
    MapError,
    MapMetadata,
    MapType,
    Match,
    Measurement,
    Observation,
    OutputMessage,
    Prior,
    Reset,
    Sample,
    Step,
    Tracker,
    Transform,
    Verdict,
    hookimpl,
)

MAPGRAFT_CONTRACT = (1, 0)
BEACONS = "beacons"


@dataclass(frozen=True)
class Places:
    """A region: whole metres on the line."""

    at: frozenset[int]

    def union(self, other: Places) -> Places:
        return Places(self.at | other.at)

    def minus(self, other: Places) -> Places:
        return Places(self.at - other.at)

    def __len__(self) -> int:
        return len(self.at)


@dataclass
class Heard:
    """A layer: how much more often a beacon was heard at each whole metre than not, or less often (below zero)."""

    counts: Counter[int] = field(default_factory=Counter)
    map_type: str = BEACONS

    def evidence(self) -> dict[int, int]:
        """The counts without those that have cancelled: they say nothing."""
        return {at: n for at, n in sorted(self.counts.items()) if n}

    def most_looks(self) -> int:
        return max(map(abs, self.counts.values()), default=0)


@dataclass(frozen=True)
class Chart:
    """A view: the same, read-only."""

    counts: Mapping[int, int]
    map_type: str = BEACONS

    def known(self) -> int:
        return len(self.counts)


def _stretches(layer: Heard) -> dict[bytes, bytes]:
    stretches: dict[int, list[tuple[int, int]]] = {}
    for at, n in layer.evidence().items():
        stretches.setdefault(at // 10, []).append((at, n))
    return {b"%d" % stretch: json.dumps(told).encode() for stretch, told in stretches.items()}


class Beacons:
    """The map type; what others call a whole metre here is a place, and places lie ``spacing_m`` apart.

    Its observations are tuples of whole metres at which a beacon was heard, or mappings from whole metres to how much
    more often one was heard there than not.
    """

    name = BEACONS

    def __init__(self, *, spacing_m: float = 1.0) -> None:
        self.spacing_m = spacing_m

    def new_layer(self) -> Heard:
        return Heard()

    def integrate(self, layer: Heard, observation: Observation) -> Places:
        payload, shift = observation.payload, round(observation.T_map_sensor.x_m / self.spacing_m)
        if not isinstance(payload, tuple | Mapping):
            raise MapError(f"beacons are mapped from what was heard, found a {observation.kind}")
        balance = payload if isinstance(payload, Mapping) else Counter(payload)
        layer.counts.update({at + shift: n for at, n in balance.items()})
        return Places(frozenset(at + shift for at in balance))

    def view(
        self,
        own: Heard | None,
        contributions: Sequence[Contribution] = (),
        previous: Chart | None = None,
        touched: Places | None = None,
    ) -> Chart:
        layers = [own.counts] if own else []
        layers += [contribution.layer.counts for contribution in contributions]
        if previous is None or touched is None:
            return Chart({at: n for at in sorted(set().union(*layers)) if (n := sum(c[at] for c in layers))})
        counts = dict(previous.counts)
        for at in touched.at:
            if n := sum(c[at] for c in layers):
                counts[at] = n
            else:
                counts.pop(at, None)
        return Chart(dict(sorted(counts.items())))

    def place(self, layer: Heard, T_receiver_donor: Transform, scale: float = 1.0) -> Heard:
        if not isinstance(layer, Heard):
            raise MapError(f"beacons can be placed, found a layer of {layer.map_type}")
        if not (evidence := layer.evidence()):
            raise EmptyMapError("there is no beacon to place")
        if scale != 1.0:
            raise MapError("beacons stand at whole metres: they cannot be scaled")
        shift = round(T_receiver_donor.x_m / self.spacing_m)
        return Heard(Counter({at + shift: n for at, n in evidence.items()}))

    def absorb(self, layer: Heard, contribution: Contribution) -> Places:
        evidence = contribution.layer.evidence()
        layer.counts.update(evidence)
        return Places(frozenset(evidence))

    def reset(self, layer: Heard, foreign: Places, keep: Places) -> Reset:
        gone = foreign.minus(keep)
        held = sum(layer.counts.pop(at, 0) != 0 for at in gone.at)
        return Reset(gone, held, len(foreign) - len(gone))

    def region(self, layer: Heard) -> Places:
        return Places(frozenset(layer.evidence()))

    def known_region(self, map_: Chart) -> Places:
        return Places(frozenset(map_.counts))

    def encode(self, layer: Heard) -> bytes:
        return json.dumps(list(layer.evidence().items())).encode()

    def decode(self, data: bytes) -> Heard:
        try:
            return Heard(Counter({int(at): int(n) for at, n in json.loads(data)}))
        except (ValueError, TypeError) as error:
            raise MapError(f"these bytes are no beacons: {error}") from None

    def parts(self, layer: Heard) -> dict[bytes, bytes]:
        """By stretches of ten places."""
        return _stretches(layer)

    def join(self, parts: Mapping[bytes, bytes]) -> Heard:
        try:
            told = [pair for data in parts.values() for pair in json.loads(data)]
            layer = Heard(Counter({int(at): int(n) for at, n in told}))
        except (ValueError, TypeError) as error:
            raise MapError(f"these parts are no beacons: {error}") from None
        if _stretches(layer) != dict(parts):
            raise MapError("these parts are not as they are cut")
        return layer

    def preview(self, layer: Heard) -> Heard:
        """Whether a beacon is there, and not how often it was heard."""
        return Heard(Counter({at: 1 if n > 0 else -1 for at, n in layer.evidence().items()}))

    def metadata(self, layer: Heard) -> MapMetadata:
        evidence = layer.evidence()
        return MapMetadata(BEACONS, known_area_m2=float(len(evidence)), observations=sum(map(abs, evidence.values())))

    def structure(self, map_: Chart, within: Chart | None = None) -> np.ndarray:
        heard = [at for at, n in map_.counts.items() if n > 0 and (within is None or at in within.counts)]
        return np.array([(at * self.spacing_m, 0.0) for at in heard]).reshape(-1, 2)

    def messages(self, map_: Chart) -> Iterable[OutputMessage]:
        return [OutputMessage("map", "std_msgs/msg/String", {"data": json.dumps(list(map_.counts.items()))})]

    def files(self, map_: Chart, stem: str) -> Mapping[str, bytes]:
        return {f"{stem}.csv": "".join(f"{at},{n}\n" for at, n in map_.counts.items()).encode()}


class Slide:
    """The matcher: every shift, the one with most beacons in common first."""

    def match(self, target: Chart, source: Chart, prior: Prior | None = None) -> Sequence[Match]:
        _require_beacons(target, source)
        shifts = Counter(a - b for a in target.counts for b in source.counts)
        best = sorted(shifts.items(), key=lambda item: (-item[1], item[0]))[:3]
        return [
            Match(Transform.planar(shift, 0.0, 0.0), n, n - (best[1][1] if len(best) > 1 else 0)) for shift, n in best
        ]


class SlideNear:
    """A matcher that knows how sure it is, and looks only where a prior says: every shift within three sigma of it.

    ``tells`` is whether it says what the prior itself scores.
    """

    def __init__(self, *, spacing_m: float = 1.0, sigma_m: float = 1.0, tells: bool = True) -> None:
        self.spacing_m, self.sigma_m, self.tells = spacing_m, sigma_m, tells

    def match(self, target: Chart, source: Chart, prior: Prior | None = None) -> Sequence[Match]:
        _require_beacons(target, source)
        shifts = Counter(a - b for a in target.counts for b in source.counts)
        evidence = {"shifts": len(shifts)}
        if prior is not None:
            middle = prior.T_receiver_donor.x_m / self.spacing_m
            if self.tells:
                evidence["prior_score"] = shifts[round(middle)]
            reach = 3.0 * math.sqrt(prior.covariance[0, 0]) / self.spacing_m + 1e-9
            shifts = Counter({shift: n for shift, n in shifts.items() if abs(shift - middle) <= reach})
        best = sorted(shifts.items(), key=lambda item: (-item[1], item[0]))[:3]
        covariance = np.diag([self.sigma_m**2, 0.0, 0.0, 0.0, 0.0, 0.0])
        second = best[1][1] if len(best) > 1 else 0
        return [
            Match(
                Transform.planar(shift * self.spacing_m, 0.0, 0.0),
                n,
                n - second,
                covariance=covariance,
                evidence=evidence,
            )
            for shift, n in best
        ]


def _require_beacons(*maps: Map) -> None:
    for map_ in maps:
        if not isinstance(map_, Chart):
            raise MapError(f"beacons can be matched, found a map of {map_.map_type}")
        if not map_.known():
            raise EmptyMapError("there is no beacon to match")


class FirstOne:
    """The acceptor: the first candidate, if enough is in common."""

    def __init__(self, *, least: float = 2.0) -> None:
        self.least = least

    def accept(self, candidates: Sequence[Candidate]) -> Decision:
        if not candidates or candidates[0].match.score < self.least:
            return Decision("unmatched", None, "too little in common")
        return Decision("provisional", 0, "enough in common")


class Sum:
    """The fuser: the donor's counts as they are."""

    def fuse(self, map_type: MapType, target: Map, source: Donation, match: Match) -> Contribution:
        T = match.T_receiver_donor.snapped()
        placed = map_type.place(source.layer, T)
        return Contribution(source.provenance, placed, T, 1.0, "whole metres", None, None, map_type.region(placed))


class Disagreement:
    """The metric: beacons of one map inside the other's span that the other has not heard."""

    def track(self, comparison: Comparison) -> Tracker:
        return _Disagreeing(comparison)


@dataclass
class _Disagreeing:
    comparison: Comparison

    def update(self, step: Step) -> Measurement:
        own, donor = self.comparison.target.counts, self.comparison.donor.counts
        if not own or not donor:
            return Measurement("disagreement", math.nan, "beacons", 0, "lower")
        low, high = max(min(own), min(donor)), min(max(own), max(donor))
        inside = {at for at in own.keys() ^ donor.keys() if low <= at <= high}
        support = max(0, high - low + 1)
        value = float(len(inside)) if support else math.nan
        return Measurement("disagreement", value, "beacons", support, "lower")


class AtMost:
    """The verifier: reverts above a limit, confirms after some observations."""

    def __init__(self, *, limit: float = 0.0, confirm_after: int = 1000) -> None:
        self.limit, self.confirm_after = limit, confirm_after

    def verify(self, history: Sequence[Sample], reversal: str) -> Verdict:
        now = history[-1]
        value = now.measurements["disagreement"].value
        if math.isnan(value):
            return Verdict("keep", "there is too little to measure")
        if value > self.limit:
            limit = {"disagreement.revert_at": self.limit + 1.0}
            return Verdict("revert", f"{value:.0f} beacons disagree, {self.limit:.0f} may", limit)
        if now.observations >= self.confirm_after:
            return Verdict("confirm", f"nothing disagreed in {now.observations} observations")
        return Verdict("keep", "nothing disagrees")


RULES = """
- name: beacons with beacons
  when: {own.type: beacons, other.type: beacons, own.known_area_m2: {min: 2}, other.known_area_m2: {min: 2}}
  match: {use: slide}
  accept: {use: first_one, metrics: [disagreement]}
  fuse: {use: sum}
  verify: {use: at_most, metrics: [disagreement], every: 1, confirm_after: 3}
"""


@hookimpl
def register_map_types(register):
    register(Descriptor("beacons", "beacons:Beacons", "beacons on a line", observes={"heard": 1}))


@hookimpl
def register_matchers(register):
    register(Descriptor("slide", "beacons:Slide", "every shift", accepts=("beacons",)))
    register(
        Descriptor("slide_near", "beacons:SlideNear", "shifts near a prior", accepts=("beacons",), uses_prior=True)
    )


@hookimpl
def register_acceptors(register):
    register(Descriptor("first_one", "beacons:FirstOne", "the first candidate"))


@hookimpl
def register_fusers(register):
    register(Descriptor("sum", "beacons:Sum", "the sum of both", accepts=("beacons",)))


@hookimpl
def register_metrics(register):
    register(Descriptor("disagreement", "beacons:Disagreement", "what only one has heard", accepts=("beacons",)))
    register(Descriptor("echoes", "echoes:Echoes", "heard where the donor is deaf", accepts=("beacons",), stream=True))


@hookimpl
def register_verifiers(register):
    register(Descriptor("at_most", "beacons:AtMost", "a limit on disagreement"))


@hookimpl
def register_rules(register):
    register("beacons", RULES)

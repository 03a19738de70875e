"""A stream metric for ``beacons``: it counts what the observations since the placement say, whatever the maps say."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mapgraft.contracts import Comparison, Measurement, Observation, Step


class Echoes:
    """The share of beacons heard since the placement of which the donor knows nothing; the support is their number."""

    def track(self, comparison: Comparison) -> EchoTracker:
        return EchoTracker(comparison)


class EchoTracker:
    def __init__(self, comparison: Comparison) -> None:
        self.comparison, self.heard, self.unknown = comparison, 0, 0

    def update(self, step: Step) -> Measurement:
        known = self.known()
        for observation in step.observations:
            places = self.places(observation)
            self.heard += len(places)
            self.unknown += len(places - known)
        value = self.unknown / self.heard if self.heard else math.nan
        return Measurement("echoes", value, "1", self.heard, "lower")

    def known(self) -> frozenset[int]:
        """Where the donor knows something, as it lies now."""
        return frozenset(self.comparison.donor.counts)

    def places(self, observation: Observation) -> frozenset[int]:
        payload = observation.payload
        heard = [at for at, n in payload.items() if n > 0] if isinstance(payload, Mapping) else payload
        return frozenset(at + round(observation.T_map_sensor.x_m) for at in heard)

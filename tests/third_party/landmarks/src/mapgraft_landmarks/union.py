"""The fuser ``landmark_union``: the donor's landmarks beside the receiver's own."""

from __future__ import annotations

from mapgraft.contracts import ConfigError, Contribution, Donation, EmptyMapError, Map, MapType, Match
from mapgraft_landmarks.placement import RESAMPLER


class LandmarkUnion:
    """Adds the donor's looks and sightings to the receiver's, each ``weight`` times (a whole number from 1)."""

    def __init__(self, *, weight: int = 1) -> None:
        if weight < 1:
            raise ConfigError(f"landmark_union weighs the donor by a whole number from 1, found weight={weight}")
        self._weight = weight

    def fuse(self, map_type: MapType, target: Map, source: Donation, match: Match) -> Contribution:
        """Raises EmptyMapError when either map knows nothing."""
        if not target.known():
            raise EmptyMapError("the receiver's landmark map is empty: there is nothing to unite with")
        T_receiver_donor = match.T_receiver_donor.snapped()
        layer = map_type.place(source.layer, T_receiver_donor, match.scale)
        return Contribution(
            provenance=source.provenance,
            layer=layer,
            T_receiver_donor=T_receiver_donor,
            scale=match.scale,
            resampler=RESAMPLER,
            weights=self._weight,
            fill=None,
            region=map_type.region(layer),
        )

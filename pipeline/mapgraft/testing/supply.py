"""What an author supplies so that laws can be tried on maps of one type, and what the kit makes of it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar, Final

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import (
    SCAN,
    Contribution,
    CountedLayer,
    Donation,
    EmptyMapError,
    Fuser,
    Layer,
    Map,
    MapType,
    Match,
    Observation,
    Points,
    Provenance,
    Region,
    Transform,
)
from mapgraft.testing.content import content_of
from mapgraft.testing.laws import Drawing, Laws, require
from mapgraft.testing.scenes import Scene, planar_moves, ready_scenes, scenes_from

_UNITS: Final = 1.5  # finest units that quantisation may displace a point by
_WITHOUT_UNIT_M: Final = 0.15


class Supply(Laws):
    """What all laws about maps need: a map type, and something to map.

    Only ``make_map_type`` must be written. ``kind`` names the kind of observation that the map type maps, where the kit
    can make it (``READY_KINDS``), ``donor_kind`` that of donors where it is another; otherwise write ``observations``
    (a strategy of single observations) or ``scenes`` (what two robots have seen of one place, which matchers need).
    ``make_fuser`` gives the fuser that makes contributions; without one the donor's layer is contributed as it was
    placed, with ``weights`` None.

    Quantised maps do not move like rigid bodies. ``moved_share`` is the share of what stands in a map that must be
    found within ``tolerance_m`` of its place when the robot's frame lies elsewhere, ``placed_share`` the same of a
    placed layer, ``found_share`` the share of what stands in the donor's own map that must be found again in it.
    """

    kind: ClassVar[str] = SCAN
    donor_kind: ClassVar[str | None] = None
    moved_share: ClassVar[float] = 0.9
    placed_share: ClassVar[float] = 0.9
    found_share: ClassVar[float] = 0.9

    def make_map_type(self) -> MapType:
        """A new instance with the parameters to try: every robot gets one of its own."""
        raise NotImplementedError(f"{type(self).__name__} needs make_map_type()")

    def make_donor_map_type(self) -> MapType:
        """The same for donors, where theirs is another type."""
        return self.make_map_type()

    def make_fuser(self) -> Fuser | None:
        """The fuser whose contributions go into the maps."""
        return None

    def observations(self) -> st.SearchStrategy[Observation] | None:
        """Single observations; None: the kit makes those of ``kind``."""
        return None

    def scenes(self) -> st.SearchStrategy[Scene]:
        """What two robots have seen of one place."""
        single = self.observations()
        return ready_scenes(self.kind, donor_kind=self.donor_kind) if single is None else scenes_from(single)

    def moves(self) -> st.SearchStrategy[Transform]:
        """Transforms by which a map may be moved."""
        return planar_moves()

    def contribute(
        self, map_type: MapType, own: Layer, donor: Layer, T_receiver_donor: Transform, provenance: Provenance
    ) -> Contribution:
        """The contribution of a donor's layer; raises EmptyMapError when there is nothing to contribute."""
        match = Match(T_receiver_donor, score=1.0, margin=1.0)
        if (fuser := self.make_fuser()) is not None:
            return fuser.fuse(map_type, map_type.view(own), Donation(donor, provenance), match)
        T = T_receiver_donor.snapped()
        placed = map_type.place(donor, T)
        return Contribution(provenance, placed, T, 1.0, "as placed", None, None, map_type.region(placed))

    def fingerprint(self, map_type: MapType, map_: Map) -> Any:
        """All that can be told about a map from outside; two maps that are equal have equal fingerprints."""
        try:
            files = content_of(dict(map_type.files(map_, "map")))
        except EmptyMapError:
            files = None  # an empty map need not have a file
        messages = [content_of(message) for message in map_type.messages(map_)]
        return (map_.map_type, map_.known(), messages, files, content_of(map_type.structure(map_)))

    def tolerance_m(self, map_type: MapType) -> float:
        """How far quantisation may displace what stands in a map: one and a half of the type's finest units."""
        unit_m = map_type.metadata(map_type.new_layer()).resolution_m
        return _WITHOUT_UNIT_M if unit_m is None else _UNITS * unit_m


def layer_of(map_type: MapType, observations: Iterable[Observation]) -> Layer:
    """A layer that has integrated the observations in their order."""
    layer = map_type.new_layer()
    for observation in observations:
        map_type.integrate(layer, observation)
    return layer


def contributed(
    supply: Supply, map_type: MapType, own: Layer, scene: Scene, T: Transform, donor: str = "donor", version: int = 0
) -> Contribution:
    """What the first ``version`` of the donor's observations (0: all) contribute; another example if nothing."""
    seen = scene.donor[: version or None]
    layer = layer_of(supply.make_donor_map_type(), seen)
    try:
        return supply.contribute(map_type, own, layer, T, Provenance(donor, 1, len(seen)))
    except EmptyMapError:
        assume(False)
        raise


def scene_of(supply: Supply, drawing: Drawing) -> Scene:
    return drawing.draw(supply.scenes(), "scene")


def same_region(a: Region, b: Region) -> bool:
    return len(a) == len(b) and len(a.minus(b)) == 0


def require_same_map(supply: Supply, map_type: MapType, found: Map, wanted: Map, clause: str) -> None:
    """Raise ``BrokenLawError`` unless two maps have one fingerprint."""
    same = found.known() == wanted.known() and supply.fingerprint(map_type, found) == supply.fingerprint(
        map_type, wanted
    )
    require(same, lambda: f"{clause} ({found.known()} units known, {wanted.known()} expected)")


def require_no_more_looks(before: Layer, after: Layer, clause: str) -> bool:
    """Raise ``BrokenLawError`` where a unit was seen more often afterwards; False where the layers do not tell."""
    if not (isinstance(before, CountedLayer) and isinstance(after, CountedLayer)):
        return False
    most, found = before.most_looks(), after.most_looks()
    require(found <= most, f"{clause} a unit was seen {found} times, of which none was seen more than {most} times")
    return True


def require_moved(wanted: Points, found: Points, tolerance_m: float, share: float, share_again: float) -> None:
    """Raise ``BrokenLawError`` unless what is found lies where it is wanted, and what is wanted is found again."""
    for what, points, others, least in (
        ("what stands there", found, wanted, share),
        ("what must stand there", wanted, found, share_again),
    ):
        fits = share_near(points, others, tolerance_m)
        require(fits >= least, f"{fits:.0%} of {what} fits within {tolerance_m:.2g} m, {least:.0%} must")


def share_near(points: Points, others: Points, tolerance_m: float) -> float:
    """Which share of the points has one of the others within the tolerance; 1 without points."""
    return float(np.mean(near(points, others, tolerance_m))) if len(points) else 1.0


def near(points: Points, others: Points, tolerance_m: float) -> NDArray[np.bool_]:
    """Which of the points (n, 2) or (n, 3) have one of the others within the tolerance, in the plane if one is flat."""
    from scipy.spatial import cKDTree

    if not len(points) or not len(others):
        return np.zeros(len(points), np.bool_)
    d = min(points.shape[1], others.shape[1])
    far, _ = cKDTree(others[:, :d]).query(points[:, :d])
    within: NDArray[np.bool_] = far <= tolerance_m
    return within

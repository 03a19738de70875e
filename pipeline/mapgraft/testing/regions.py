"""The laws of regions: sets of the type's finest units."""

from __future__ import annotations

from mapgraft.contracts import MeetingRegion, Region
from mapgraft.testing.laws import Drawing, law, require
from mapgraft.testing.supply import Supply, same_region, scene_of


class RegionLaws(Supply):
    """Union, minus and len."""

    @law("regions are sets: union, minus and len fit each other, and an empty region changes nothing")
    def test_regions_are_sets(self, drawing: Drawing) -> None:
        a, b, nothing = self._regions(drawing)
        both, only_a, only_b = a.union(b), a.minus(b), b.minus(a)
        common = a.minus(only_a)
        require(len(a) == len(only_a) + len(common), f"{len(a)} units are {len(only_a)} without the other's and more")
        total = len(only_a) + len(only_b) + len(common)
        require(len(both) == total, f"a union of {len(a)} and {len(b)} units has {len(both)}, {total} expected")
        require(same_region(both, b.union(a)), "a union depends on the order")
        require(same_region(common, b.minus(only_b)), "what is in both depends on the order")
        for what, region in (
            ("itself", a.union(a)),
            ("nothing", a.union(nothing)),
            ("nothing before", nothing.union(a)),
        ):
            require(same_region(region, a), f"united with {what} a region has {len(region)} units instead of {len(a)}")
        left = (len(a.minus(a)), len(nothing.minus(a)), len(a.minus(nothing)))
        require(left == (0, 0, len(a)), f"without itself, nothing without it, it without nothing have {left} units")
        require(same_region(only_a.union(common), a), "its two parts united are not the region")

    @law("regions are not written by union and minus")
    def test_regions_are_not_written(self, drawing: Drawing) -> None:
        a, b, nothing = self._regions(drawing)
        sizes, parts = (len(a), len(b), len(nothing)), (a.minus(b), b.minus(a))
        a.union(b).minus(a), b.union(a), nothing.union(a), a.union(nothing).minus(b)
        require((len(a), len(b), len(nothing)) == sizes, f"sizes were {sizes}, now {(len(a), len(b), len(nothing))}")
        same = same_region(a.minus(b), parts[0]) and same_region(b.minus(a), parts[1])
        require(same, "after union and minus the two regions differ otherwise than before")

    @law("regions that tell whether they meet say so exactly where they have a unit in common")
    def test_regions_meet_where_they_have_a_unit_in_common(self, drawing: Drawing) -> None:
        a, b, nothing = self._regions(drawing)
        for one, other in ((a, b), (b, a), (a, a), (a.minus(b), b), (a, nothing), (nothing, a), (nothing, nothing)):
            if isinstance(one, MeetingRegion) and isinstance(other, MeetingRegion):
                common = len(one) - len(one.minus(other))
                require(one.meets(other) == (common > 0), f"it says {one.meets(other)} with {common} units in common")

    def _regions(self, drawing: Drawing) -> tuple[Region, Region, Region]:
        """What two observations touched, on one lattice, and an empty one."""
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        seen = map_type.new_layer()
        a = map_type.integrate(seen, scene.own[0])
        b = map_type.integrate(map_type.new_layer(), scene.own[-1])
        for observation in scene.own[1:2]:
            b = b.union(map_type.integrate(seen, observation))
        return a, b, map_type.region(map_type.new_layer())

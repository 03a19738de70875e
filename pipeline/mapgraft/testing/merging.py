"""The laws of reversals, for one map type: whatever happened in whatever order, what is reverted is gone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from hypothesis import strategies as st

from mapgraft.config import ReversalName
from mapgraft.contracts import Contribution, Layer, Map, MapType, Observation, Region
from mapgraft.reversal import Reversal, new_reversal
from mapgraft.testing.laws import Drawing, law, require
from mapgraft.testing.scenes import Scene
from mapgraft.testing.supply import Supply, contributed, layer_of, require_same_map, scene_of

_DONORS: Final = ("bravo", "charlie")
_ACTIONS: Final = ("observe", "merge", "update", "re-register", "revert", "look")
Action = tuple[str, str]


class Mission:
    """One robot that maps, merges and reverts, and beside it what it has observed and what stands."""

    def __init__(self, supply: Supply, reversal: ReversalName, scene: Scene, drawing: Drawing) -> None:
        self.supply, self.scene, self._drawing = supply, scene, drawing
        self.map_type = supply.make_map_type()
        self.reversal: Reversal = new_reversal(reversal, self.map_type)
        self.seen: list[Observation] = []
        self.standing: dict[str, Contribution] = {}
        self.observe()

    def observe(self) -> Region:
        self.seen.append(self.scene.own[len(self.seen) % len(self.scene.own)])
        return self.reversal.observe(self.seen[-1])

    def contribution(self, donor: str, version: int) -> Contribution:
        T = self._drawing.draw(self.supply.moves())
        own = self.alone()
        return contributed(self.supply, self.map_type, own, self.scene, T, donor, version)

    def act(self, action: str, donor: str) -> None:
        """Do it where it can be done; nothing otherwise."""
        latest = len(self.scene.donor)
        if action == "observe":
            self.observe()
        elif action == "merge" and donor not in self.standing:
            self.standing[donor] = self.contribution(donor, 1)
            self.reversal.merge(donor, self.standing[donor])
        elif action in ("update", "re-register") and donor in self.standing:
            version = latest if action == "update" else self.standing[donor].provenance.version
            self.standing[donor] = self.contribution(donor, version)
            self.reversal.replace(donor, self.standing[donor])
        elif action == "revert" and donor in self.standing:
            del self.standing[donor]
            said = self.reversal.revert(donor)
            require(said.exact, f"the reversal says it is not exact: {said.reason}")
        elif action == "look":
            self.reversal.fused()

    def alone(self) -> Layer:
        """The layer of a robot that observed the same and never merged."""
        return layer_of(self.supply.make_map_type(), self.seen)

    def fresh(self) -> Map:
        """The map of the layers that are left, made anew by somebody who has not seen what happened."""
        return self.supply.make_map_type().view(self.alone(), tuple(self.standing.values()))


class MergingLaws(Supply):
    """What the reversals promise, kept by the map type."""

    @law("with the ledger, any interleaving of observing, merging, updating, re-registering and reverting is exact")
    def test_the_ledger_is_exact(self, drawing: Drawing) -> None:
        self._require_exact(drawing, "ledger")

    @law("with multi_map, any interleaving of observing, merging, updating, re-registering and reverting is exact")
    def test_multi_map_is_exact(self, drawing: Drawing) -> None:
        self._require_exact(drawing, "multi_map")

    @law("the order of merges changes nothing")
    def test_the_order_of_merges_changes_nothing(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        own = layer_of(map_type, scene.own)
        moves = [drawing.draw(self.moves()) for _ in range(3)]
        given = [contributed(self, map_type, own, scene, T, f"donor {n}", n) for n, T in enumerate(moves)]
        order = drawing.draw(st.permutations(range(3)))
        wanted = map_type.view(own, given)
        found = map_type.view(own, [given[n] for n in order])
        require_same_map(self, map_type, found, wanted, f"merged in the order {order}, the map is another one")
        one, other = map_type.decode(map_type.encode(own)), map_type.decode(map_type.encode(own))
        for layer, numbers in ((one, range(3)), (other, order)):
            for n in numbers:
                map_type.absorb(layer, given[n])
        clause = f"absorbed in the order {order}, the map is another one"
        require_same_map(self, map_type, map_type.view(other), map_type.view(one), clause)

    @law("a reverted map has the bytes of one that never merged")
    def test_a_reverted_map_is_one_that_never_merged(self, drawing: Drawing) -> None:
        scene = scene_of(self, drawing)
        for name in ("ledger", "multi_map"):
            mission = Mission(self, name, scene, drawing)
            mission.act("merge", _DONORS[0])
            mission.act("look", "")
            mission.act("observe", "")
            mission.act("revert", _DONORS[0])
            mission.act("observe", "")
            kind, alone = mission.map_type, mission.alone()
            same = kind.encode(mission.reversal.offered_layer()) == kind.encode(alone)
            require(same, f"with {name}, the layer has other bytes than that of a robot that never merged")
            clause = f"with {name}, the map differs from that of a robot that never merged"
            require_same_map(self, kind, mission.reversal.fused(), kind.view(alone), clause)

    @law("with single_map, the statement after a revert is true: cells reset, contaminated and lost, exact or not")
    def test_a_single_map_says_what_it_lost(self, drawing: Drawing) -> None:
        scene = scene_of(self, drawing)
        mission = Mission(self, "single_map", scene, drawing)
        kind, reversal = mission.map_type, mission.reversal
        updated = kind.region(kind.new_layer())
        for observation in mission.seen:
            updated = updated.union(kind.integrate(kind.new_layer(), observation))
        foreign = self._foreign(kind, mission, _DONORS)
        if drawing.draw(st.booleans()):
            updated = updated.union(mission.observe())
        held = kind.region(reversal.compared_layer())
        said = reversal.revert(_DONORS[0])
        gone = foreign[0].minus(updated)
        reset, lost = len(gone) - len(gone.minus(held)), len(gone) - len(gone.minus(foreign[1]))
        wanted = (reset, len(foreign[0]) - len(gone), lost)
        found = (said.cells_reset, said.cells_contaminated, said.cells_lost)
        require(found == wanted, f"it says (reset, contaminated, lost) = {found}, it was {wanted}")
        require(
            said.exact == (wanted[1:] == (0, 0)), f"it says exact={said.exact} with {wanted[1:]} contaminated, lost"
        )
        reversal.revert(_DONORS[1])
        if wanted[1:] == (0, 0) and not len(foreign[1].minus(foreign[1].minus(updated))):
            clause = "both reverts were exact, and yet the map is not that of a robot that never merged"
            require_same_map(self, kind, reversal.fused(), kind.view(mission.alone()), clause)

    def _require_exact(self, drawing: Drawing, name: ReversalName) -> None:
        mission = Mission(self, name, scene_of(self, drawing), drawing)
        script: Sequence[Action] = drawing.draw(
            st.lists(st.tuples(st.sampled_from(_ACTIONS), st.sampled_from(_DONORS)), min_size=1, max_size=10)
        )
        drawing.note(", ".join(f"{action} {donor}" for action, donor in script))
        for action, donor in script:
            mission.act(action, donor)
        kind = mission.map_type
        same = kind.encode(mission.reversal.offered_layer()) == kind.encode(mission.alone())
        require(same, "the own layer has other bytes than that of a robot that never merged")
        clause = "the map is not what the layers that are left make"
        require_same_map(self, kind, mission.reversal.fused(), mission.fresh(), clause)

    def _foreign(self, kind: MapType, mission: Mission, donors: Sequence[str]) -> list[Region]:
        """Merge donors; what absorbing each of them changes."""
        regions = []
        for donor in donors:
            given = mission.contribution(donor, 1)
            regions.append(kind.absorb(kind.decode(kind.encode(mission.alone())), given))
            mission.reversal.merge(donor, given)
        return regions

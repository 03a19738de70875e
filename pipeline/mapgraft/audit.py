"""``--verify-ledger``: the robots' evidence once more from the recording, compared with what the run holds.

Own layers are integrated anew from the observations, contributions placed anew from the donors' layers as they were
when they were sent, and the fused map is compared with one that was computed from its layers without anything kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from mapgraft.assembly import map_type_of
from mapgraft.config import Config
from mapgraft.contracts import Layer, Map, MapError, MapType, Observation, Provenance
from mapgraft.correction import Correction, Recollection
from mapgraft.errors import PluginError
from mapgraft.guard import Call, Guard
from mapgraft.plugins import Plugins
from mapgraft.procedures import Workshop
from mapgraft.rendezvous import Sighted
from mapgraft.robot import Robot


@dataclass(frozen=True, slots=True)
class Finding:
    """What was found out about one robot; ``sentence`` goes on after its name."""

    robot: str
    sound: bool
    sentence: str


def audit(
    timeline: Iterable[Observation | Correction | Sighted],
    kinds: Mapping[str, Iterable[str]],
    robots: Mapping[str, Robot],
    config: Config,
    plugins: Plugins,
    guard: Guard | None = None,
) -> list[Finding]:
    """One finding per robot, by name; ``kinds`` tells what each observes, ``timeline`` is that of the run.

    ``guard`` watches over the map types: one that fails now is named in its robots' findings, which are not sound then.
    """
    workshop = Workshop(plugins, guard=guard or Guard())
    anew = {name: _Anew(name, map_type_of(name, kinds[name], config, workshop), workshop.guard) for name in robots}
    wanted = {source for robot in robots.values() for source in _sources(robot)}
    for name, robot in robots.items():
        wanted.add((name, robot.reversal.offered_version))
    for again in anew.values():
        again.begin(wanted)
    for entry in timeline:
        if isinstance(entry, Sighted):
            continue
        again, robot = anew[entry.robot], robots[entry.robot]
        if again.failed or again.version >= robot.reversal.version:
            continue
        if isinstance(entry, Correction):
            again.correct(entry, robot, wanted)
        else:
            again.integrate(entry, wanted, robot.recollection is not None)
    return [_finding(robot, anew) for _, robot in sorted(robots.items())]


@dataclass(slots=True)
class _Anew:
    """One robot's evidence, integrated once more; ``kept`` holds it encoded as it was at the versions wanted.

    ``failed`` says why its map type could not go on.
    """

    robot: str
    map_type: MapType
    guard: Guard
    layer: Layer = field(init=False)
    version: int = 0
    recollection: Recollection = field(default_factory=Recollection)
    kept: dict[int, bytes] = field(default_factory=dict)
    failed: str = ""

    def asking(self) -> Call:
        """A context in which its layers and maps are compared: what they are asked has no guard of its own."""
        return self.guard.calling("map type", self.map_type.name)

    def begin(self, wanted: set[tuple[str, int]]) -> None:
        try:
            self.layer = self.map_type.new_layer()
            self._keep(wanted)
        except (PluginError, MapError) as error:
            self.failed = str(error)

    def integrate(self, observation: Observation, wanted: set[tuple[str, int]], remember: bool) -> None:
        try:
            self.map_type.integrate(self.layer, observation)
        except MapError:  # left out then as now
            return
        except PluginError as error:
            self.failed = str(error)
            return
        if remember:
            self.recollection.observations.append(observation)
        self._done(wanted)

    def correct(self, correction: Correction, robot: Robot, wanted: set[tuple[str, int]]) -> None:
        """Integrate everything once more, where the robot could follow the correction, too."""
        anew = self.recollection.corrected(correction)
        if anew is None or correction.stamp_ns not in robot.corrected_ns:
            return
        self.recollection.observations[:] = anew.observations
        try:
            self.layer = self.map_type.new_layer()
            for observation in anew.observations:
                self.map_type.integrate(self.layer, observation)
        except (PluginError, MapError) as error:
            self.failed = str(error)
        else:
            self._done(wanted)

    def _done(self, wanted: set[tuple[str, int]]) -> None:
        """There is a new version."""
        self.version += 1
        try:
            self._keep(wanted)
        except (PluginError, MapError) as error:
            self.failed = str(error)

    def _keep(self, wanted: set[tuple[str, int]]) -> None:
        if (self.robot, self.version) in wanted:
            self.kept[self.version] = self.map_type.encode(self.layer)


def _sources(robot: Robot) -> list[tuple[str, int]]:
    return [(c.provenance.source, c.provenance.version) for c in robot.reversal.contributions.values()]


def _finding(robot: Robot, anew: Mapping[str, _Anew]) -> Finding:
    if robot.failed:
        return Finding(robot.name, True, f"is not checked, for it took no part to the end: {robot.failed}")
    again = anew[robot.name]
    if again.failed:
        return Finding(robot.name, False, f"cannot be checked: {again.failed}")
    faults: list[str] = []
    for look in (_own_faults, _donor_faults, _view_faults):
        try:
            with again.asking():
                faults += look(robot, anew)
        except (PluginError, MapError) as error:
            faults.append(f"cannot be checked: {error}")
    if faults:
        return Finding(robot.name, False, "; ".join(faults))
    others = len(robot.reversal.contributions)
    with_ = f" and {others} contribution{'s' * (others != 1)}" if others else ""
    own = robot.reversal.version - len(robot.corrected_ns)
    return Finding(robot.name, True, f"{own} observation{'s' * (own != 1)}{with_} recomputed, all equal")


def _own_faults(robot: Robot, anew: Mapping[str, _Anew]) -> list[str]:
    version, again = robot.reversal.offered_version, anew[robot.name]
    held = robot.map_type.encode(robot.reversal.offered_layer())
    if again.kept.get(version) == held:
        return []
    own = version - len(robot.corrected_ns)
    return [f"its own layer of {own} observation{'s' * (own != 1)} differs from one integrated anew"]


def _donor_faults(robot: Robot, anew: Mapping[str, _Anew]) -> list[str]:
    """Contributions of the receiver's own type; what a conversion made is not placed anew."""
    faults, map_type = [], robot.map_type
    for merge_id, contribution in robot.reversal.contributions.items():
        sent = _layer_of(contribution.provenance, anew, map_type.name)
        if sent is None:
            continue
        placed = map_type.place(sent, contribution.T_receiver_donor, contribution.scale)
        if map_type.encode(placed) != map_type.encode(contribution.layer):
            faults.append(f"the contribution {merge_id} differs from the donor's layer placed anew")
    return faults


def _layer_of(provenance: Provenance, anew: Mapping[str, _Anew], wanted: str) -> Layer | None:
    donor = anew[provenance.source]
    data = donor.kept.get(provenance.version)
    return None if data is None or donor.map_type.name != wanted else donor.map_type.decode(data)


def _view_faults(robot: Robot, anew: Mapping[str, _Anew]) -> list[str]:
    fresh = robot.reversal.recomputed(anew[robot.name].map_type)
    if same_map(robot.map_type, robot.reversal.fused(), fresh):
        return []
    return ["its fused map differs from one computed anew from the layers"]


def same_map(map_type: MapType, one: Map, other: Map) -> bool:
    """Whether two maps know the same units and show the same."""
    if one.known() != other.known():
        return False
    known, also = map_type.known_region(one), map_type.known_region(other)
    if len(known.minus(also)) or len(also.minus(known)):
        return False
    try:
        shown = [(m.suffix, m.message_type, m.fields) for m in map_type.messages(one)]
        as_well = [(m.suffix, m.message_type, m.fields) for m in map_type.messages(other)]
    except MapError:  # too large to be shown: what it knows is the same
        return True
    return _same(shown, as_well)


def _same(one: object, other: object) -> bool:
    """Equality of nested plain values and arrays, NaN equal to NaN."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        floats = one.dtype.kind == "f"
        return one.dtype == other.dtype and bool(np.array_equal(one, other, equal_nan=floats))
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_same(value, other[key]) for key, value in one.items())
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other) or (one != one and other != other)

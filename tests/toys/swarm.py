"""Robots with tiny real grids on a simulated radio: what tests drive in every order, and what must come of it.

A robot observes, meets, claims merges, takes them back, corrects its map, fails and begins again in a new frame. What
it attaches follows from the claims and layers that it holds, swapped in and out of a real ledger. ``Swarm.fresh``
computes the same anew from what has survived.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from mapgraft.contracts import (
    SCAN,
    Contribution,
    Layer,
    MapMetadata,
    Observation,
    Provenance,
    Scan,
    Transform,
)
from mapgraft.exchange import Form, Offer
from mapgraft.graph.chains import Chain, best_chains
from mapgraft.graph.claims import Claim, Claims, Source
from mapgraft.network.host import Wish
from mapgraft.network.node import Node
from mapgraft.network.radio import NS_PER_S, Conditions, Fates, Radio, Traffic
from mapgraft.network.replica import Whole
from mapgraft.network.wire import Aspect, Copy, encode, kind_of
from mapgraft.reversal import Reversal, new_reversal
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.weights import TileWeights

RESOLUTION_M = 0.5
_ANGLES = np.linspace(-math.pi, math.pi, 7)[:-1]


def grid() -> OccupancyGrid:
    return OccupancyGrid(resolution_m=RESOLUTION_M, rays_per_tile=2, poses_per_tile=3)


def scan_of(source: Source, number: int, shift_m: float = 0.0) -> Observation:
    """The ``number``-th scan of a source: six beams of some lengths, from some place."""
    drawn = hashlib.blake2b(f"{source} {number}".encode(), digest_size=16).digest()
    ranges = np.array([0.6 + byte / 60.0 for byte in drawn[:6]], np.float32)
    T = Transform.planar(drawn[6] / 40.0 + shift_m, drawn[7] / 40.0, drawn[8] / 50.0)
    directions = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)), axis=1)
    scan = Scan(directions, ranges, np.ones(6, np.bool_), None)
    return Observation(source.name, number, number, "laser", SCAN, scan, T, T)


def placed(map_type: OccupancyGrid, layer: Layer, chain: Chain, provenance: Provenance) -> Contribution:
    """What a layer contributes through a chain: as it is, once."""
    similarity = chain.similarity
    T = similarity.T_target_source.snapped()
    put = map_type.place(layer, T)
    return Contribution(provenance, put, T, 1.0, "as placed", TileWeights.plain(), None, map_type.region(put))


def believed(claims: Claims) -> list[Claim]:
    """Those that know of every correction of their two maps that any claim knows of."""
    latest: dict[Source, int] = {}
    for claim in claims.active():
        for end in claim.edge:
            latest[end] = max(latest.get(end, 0), claim.corrections_of(end))
    return [claim for claim in claims.active() if all(claim.corrections_of(end) == latest[end] for end in claim.edge)]


@dataclass
class Robot:
    """The host of one node."""

    address: str
    source: Source
    previews: bool = True
    picky: bool = False  # merges nobody by itself
    claims: Claims = field(default_factory=Claims)
    map_type: OccupancyGrid = field(default_factory=grid)
    version: int = 0
    corrections: int = 0
    scans: list[Observation] = field(default_factory=list)
    attempts: dict[Source, int] = field(default_factory=dict)
    merged_from: dict[Source, bytes] = field(default_factory=dict)  # whose layer it was that was merged
    refusals: list[str] = field(default_factory=list)
    reversal: Reversal = field(init=False)
    node: Node = field(init=False)
    _attached: dict[Source, tuple[str, tuple[object, ...]]] = field(default_factory=dict)
    _told: int = -1

    def __post_init__(self) -> None:
        self.reversal = new_reversal("ledger", self.map_type)

    def observe(self) -> None:
        observation = scan_of(self.source, len(self.scans))
        self.scans.append(observation)
        self.reversal.observe(observation)
        self.version += 1

    def correct(self, shift_m: float) -> None:
        """New poses for all old scans, as after a loop closure: what it has merged it has to find anew."""
        if not self.scans:
            return
        self.scans = [scan_of(self.source, number, shift_m) for number in range(len(self.scans))]
        attached = self.reversal.contributions
        self.map_type = grid()
        self.reversal = new_reversal("ledger", self.map_type)
        for scan in self.scans:
            self.reversal.observe(scan)
        for merge_id, contribution in attached.items():
            self.reversal.merge(merge_id, contribution)
        self.version += 1
        self.corrections += 1
        for known in [claim for claim in self.claims.active() if claim.receiver == self.source]:
            told = (self.corrections, max(known.corrections[1], self.heard_of(known.donor)))
            self.claims.add(replace(known, state="provisional", revision=known.revision + 1, corrections=told))
        self.heard(0)

    def heard_of(self, source: Source) -> int:
        """How often a source's map had been corrected when it came last."""
        head = self.node.replica.head(Copy(source, "layer"))
        return 0 if head is None else Offer.decode(head.offer).corrections

    def claim(self, donor: Source, state: Literal["provisional", "confirmed", "reverted"], anew: bool = False) -> None:
        """Write what this robot says of its merge with a donor; ``anew`` begins another one."""
        known = self.claims.of(self.source, donor)
        if known is None or anew:
            n = self.attempts[donor] = max(self.attempts.get(donor, 0), known.epoch if known else 0) + 1
            x, y, quarter = hashlib.blake2b(f"{self.source}{donor}{n}".encode(), digest_size=3).digest()
            T = Transform.planar(x / 32.0, y / 32.0, quarter % 4 * math.pi / 2)
            found = (self.corrections, self.heard_of(donor))
            made = Claim(self.source, donor, n, state, 0, T, support=x % 7 - 1.0, reason="drawn", corrections=found)
        else:
            made = replace(known, state=state, revision=known.revision + 1)
        self.claims.add(made)
        self.heard(0)

    def revoke_as_donor(self, receiver: Source) -> None:
        """Take back what another robot says of its merge with this one."""
        known = self.claims.of(receiver, self.source)
        if known is not None and known.is_active:
            self.claims.add(replace(known, state="reverted", revision=known.revision + 1, by="donor"))
            self.heard(0)

    def offer(self) -> bytes:
        metadata = MapMetadata(self.map_type.name, RESOLUTION_M, observations=len(self.scans))
        return Offer(Provenance(*self.source, self.version), metadata, self.corrections).encode()

    def cut(self, aspect: Aspect, _stamp_ns: int) -> tuple[Form, Mapping[bytes, bytes]]:
        layer = self.reversal.offered_layer()
        return "parts", self.map_type.parts(layer if aspect == "layer" else self.map_type.preview(layer))

    def wants(self, offer: bytes, size: int, stamp_ns: int) -> Wish:
        provenance = Offer.decode(offer).provenance
        claim = self.claims.of(self.source, Source(provenance.source, provenance.epoch))
        if claim is None and self.picky:
            return "nothing"
        if claim is None:
            return "preview" if self.previews else "layer"
        return "layer" if claim.is_active else "nothing"

    def consider(self, whole: Whole, aspect: Aspect, size: int, stamp_ns: int) -> Wish:
        provenance = Offer.decode(whole.head.offer).provenance
        donor = Source(provenance.source, provenance.epoch)
        if aspect == "preview":
            return "layer"
        if self.claims.of(self.source, donor) is None and provenance.version:
            self.merged_from[donor] = whole.head.writer
            self.claim(donor, "provisional")
        return "nothing"

    def passed_on(self, whole: Whole, size: int, stamp_ns: int) -> None:
        """It is in the replica."""

    def refused(self, offer: bytes, reason: str, stamp_ns: int) -> None:
        self.refusals.append(reason)

    def lacks(self) -> Collection[Source]:
        return best_chains(self.source, believed(self.claims))

    def renamed(self, source: Source, stamp_ns: int) -> None:
        """Everything that was attached under the old name goes."""
        for merge_id in list(self.reversal.contributions):
            self.reversal.revert(merge_id)
        self._attached.clear()
        self.source = source

    def belongs(self, source: Source, writer: bytes, stamp_ns: int) -> None:
        """What was claimed of the map of another robot that is called so, too, is taken back."""
        known = self.claims.of(self.source, source)
        if self.merged_from.pop(source, writer) > writer and known is not None and known.is_active:
            self.claim(source, "reverted")

    def heard(self, stamp_ns: int) -> None:
        """Swap what is attached for what follows from the claims and layers held now."""
        chains = best_chains(self.source, believed(self.claims))
        wanted = {}
        for source, chain in chains.items():
            head = self.node.replica.head(Copy(source, "layer"))
            if head is not None and head.version:
                wanted[source] = (head.version, head.digest, *(claim.data for claim in chain.claims))
        for source in sorted(self._attached.keys() - wanted.keys()):
            self.reversal.revert(self._attached.pop(source)[0])
        for source, basis in sorted(wanted.items()):
            merge_id, before = self._attached.get(source, (f"{source}", ()))
            if before == basis:
                continue
            whole = self.node.replica.whole(Copy(source, "layer"))
            assert whole is not None
            provenance = Provenance(*source, whole.head.version)
            contribution = placed(self.map_type, self.map_type.join(whole.parts()), chains[source], provenance)
            (self.reversal.replace if source in self._attached else self.reversal.merge)(merge_id, contribution)
            self._attached[source] = (merge_id, basis)


@dataclass
class Swarm:
    """Robots on one radio, at one time of data."""

    conditions: Conditions = field(default_factory=Conditions)
    window_ns: int = 4 * NS_PER_S
    robots: dict[str, Robot] = field(default_factory=dict)
    traffic: Traffic = field(default_factory=Traffic)
    now_ns: int = 0
    lived: Fates = field(default_factory=Fates)  # of messages before everything was healed
    radio: Radio = field(init=False)

    def __post_init__(self) -> None:
        self.radio = Radio(self.conditions)

    def add(self, address: str, name: str = "", epoch: int = 1, writer: bytes = b"", previews: bool = True) -> Robot:
        """A robot begins, or begins again at the same address with nothing in its memory."""
        source = Source(name or address, epoch)
        robot = Robot(address, source, previews)
        robot.node = Node(source, writer or address.encode().ljust(8, b"_")[:8], robot, NS_PER_S // 2)
        self.robots[address] = robot
        return robot

    def meet(self, one: str, other: str, window_ns: int | None = None) -> None:
        """Both are in contact from now on, and greet each other."""
        self.radio.connect(one, other, self.now_ns + (self.window_ns if window_ns is None else window_ns))
        for sender, receiver in ((one, other), (other, one)):
            self._send(sender, receiver, self.robots[sender].node.greeting(receiver))

    def advance(self, by_ns: int) -> None:
        """Let time pass: everything that is due in it happens, in its order."""
        until_ns = self.now_ns + by_ns
        while (at_ns := self._next_ns()) is not None and at_ns <= until_ns:
            self.now_ns = max(self.now_ns, at_ns)
            for delivery in self.radio.due(self.now_ns):
                self.robots[delivery.receiver].node.hear(delivery.sender, delivery.data, delivery.arrival_ns)
                self._flush(delivery.receiver)
            for address in sorted(self.robots):
                node = self.robots[address].node
                if node.wake_ns is not None and node.wake_ns <= self.now_ns:
                    node.settle(self.now_ns, self.radio.neighbours(address, self.now_ns))
                    self._flush(address)
        self.now_ns = until_ns

    def heal(self) -> None:
        """Nothing is lost any more, and everybody meets everybody until nobody has anything to say."""
        self.advance(60 * NS_PER_S)
        self.lived, self.radio = self.radio.fates, Radio()
        for _ in range(3):
            self.advance(NS_PER_S)
            for one in sorted(self.robots):
                for other in sorted(self.robots):
                    if one < other:
                        self.meet(one, other, 10 * NS_PER_S)
            self.advance(20 * NS_PER_S)

    def fresh(self, address: str) -> bytes:
        """The encoding of a robot's fused map, computed anew from the claims of all and the newest layers there are."""
        robot, map_type = self.robots[address], grid()
        claims = Claims(claim for other in self.robots.values() for claim in other.claims)
        own = map_type.new_layer()
        for scan in robot.scans:
            map_type.integrate(own, scan)
        contributions = []
        for source, chain in sorted(best_chains(robot.source, believed(claims)).items()):
            if (newest := self.newest(source)) is not None:
                version, layer = newest
                contributions.append(placed(map_type, layer, chain, Provenance(*source, version)))
        return fingerprint(map_type, map_type.view(own, contributions))

    def newest(self, source: Source) -> tuple[int, Layer] | None:
        """The newest version of a source's layer that anybody has whole; of one that lives its own."""
        for robot in self.robots.values():
            if robot.source == source:
                return (robot.version, robot.reversal.offered_layer()) if robot.version else None
        copies = [robot.node.replica.whole(Copy(source, "layer")) for robot in self.robots.values()]
        found = [whole for whole in copies if whole is not None and whole.head.version]
        if not found:
            return None
        whole = max(found, key=lambda one: one.head.version)
        return whole.head.version, grid().join(whole.parts())

    def disagreements(self) -> list[str]:
        """What is not as it must be after everybody has met everybody."""
        out = []
        digests = {robot.claims.digest() for robot in self.robots.values()}
        if len(digests) > 1:
            out.append(f"{len(digests)} states of claims")
        for address, robot in sorted(self.robots.items()):
            if fingerprint(robot.map_type, robot.reversal.fused()) != self.fresh(address):
                out.append(f"the map of {address} is not the one that follows from what has survived")
        return out

    def _next_ns(self) -> int | None:
        wakes = [robot.node.wake_ns for robot in self.robots.values() if robot.node.wake_ns is not None]
        due = [*wakes, *([self.radio.next_ns] if self.radio.next_ns is not None else [])]
        return min(due, default=None)

    def _flush(self, address: str) -> None:
        for receiver, message in self.robots[address].node.said():
            self._send(address, receiver, message)

    def _send(self, sender: str, receiver: str, message: object) -> None:
        data = encode(message)
        self.traffic.count(sender, receiver, kind_of(message), len(data))
        self.radio.send(sender, receiver, data, self.now_ns)


def fingerprint(map_type: OccupancyGrid, seen: object) -> bytes:
    """All cells of a map by their clamped log-odds, tile by tile."""
    whole = hashlib.blake2b(digest_size=16)
    for key, tile in seen.tiles.items():
        if tile.log_odds.any():
            whole.update(key.to_bytes(8, "little") + tile.log_odds.tobytes())
    return whole.digest()

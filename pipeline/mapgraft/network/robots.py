"""A robot as its node sees it: offers, layers cut for the way, decisions, and consequences."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from mapgraft.contracts import Layer, MapError, PreviewedType
from mapgraft.errors import FailedPluginError, PluginError
from mapgraft.exchange import Form, Offer, SentLayer
from mapgraft.graph.claims import Claims, Source
from mapgraft.lives import base_name
from mapgraft.network.host import Wish
from mapgraft.network.meetings import Meetings
from mapgraft.network.node import Node
from mapgraft.network.replica import Whole
from mapgraft.network.wire import WRITER, Aspect
from mapgraft.robot import Robot


@dataclass(slots=True)
class RobotHost:
    """With ``previews`` a map is looked at in its preview first, where it was not merged yet and its type has one."""

    robot: Robot
    previews: bool = False

    @property
    def claims(self) -> Claims:
        return self.robot.claims

    def offer(self) -> bytes:
        return self.robot.offer()

    def cut(self, aspect: Aspect, stamp_ns: int) -> tuple[Form, Mapping[bytes, bytes]]:
        """A map type that fails to cut it is complained of, and the layer goes as a whole."""
        own = self.robot.own
        layer = self._preview(stamp_ns) if aspect == "preview" else own.reversal.offered_layer()
        try:
            return own.cut(layer)
        except (PluginError, MapError) as error:
            self.robot.complain(error, stamp_ns)
            return own.uncut(layer)

    def _preview(self, stamp_ns: int) -> Layer:
        try:
            return self.robot.own.preview()
        except PluginError as error:
            self.robot.complain(error, stamp_ns)
            raise MapError(str(error)) from error

    def wants(self, offer: bytes, size: int, stamp_ns: int) -> Wish:
        if not self.robot.wants(offer, size, stamp_ns):
            return "nothing"
        return "preview" if self.previews and self._has_preview(Offer.decode(offer)) else "layer"

    def consider(self, whole: Whole, aspect: Aspect, size: int, stamp_ns: int) -> Wish:
        sent = sent_layer(whole, size)
        if aspect == "preview":
            return "layer" if self.robot.consider(whole.head.offer, sent, stamp_ns, preview=True) else "nothing"
        self.robot.graph.layers.add(sent)
        self.robot.consider(whole.head.offer, sent, stamp_ns)
        self.robot.graph.publish(stamp_ns)
        return "nothing"

    def passed_on(self, whole: Whole, size: int, stamp_ns: int) -> None:
        self.robot.graph.layers.add(sent_layer(whole, size))

    def refused(self, offer: bytes, reason: str, stamp_ns: int) -> None:
        self.robot.refused(offer, reason, stamp_ns)

    def heard(self, stamp_ns: int) -> None:
        self.robot.heard(stamp_ns)

    def lacks(self) -> Collection[Source]:
        return self.robot.graph.wants()

    def renamed(self, source: Source, stamp_ns: int) -> None:
        self.robot.rename(source, f"another robot is called {base_name(source.name)}", stamp_ns)

    def belongs(self, source: Source, writer: bytes, stamp_ns: int) -> None:
        self.robot.belongs(source, writer, stamp_ns)

    def _has_preview(self, offer: Offer) -> bool:
        if offer.provenance.source in self.robot.merges:
            return False
        own = self.robot.map_type
        try:
            other = own if offer.metadata.type == own.name else self.robot.workshop.map_type(offer.metadata.type)
        except (PluginError, FailedPluginError):
            return False
        return isinstance(other, PreviewedType)


def sent_layer(whole: Whole, size: int) -> SentLayer:
    """What came, for the robot; unpacked when it is looked at."""
    offer = Offer.decode(whole.head.offer)
    head, told = whole.head, offer.provenance
    return SentLayer(told, offer.metadata.type, head.form, whole.parts, size, offer.corrections, head.writer)


def node_of(robot: Robot, patience_ns: int, previews: bool, writer: bytes = b"") -> Node:
    """The node of a robot; its ``writer`` follows from its name, which no other of a mission has, if not told."""
    writer = writer or hashlib.blake2b(robot.name.encode(), digest_size=WRITER).digest()
    book = robot.rendezvous
    meetings = None if book is None else Meetings(book, robot.met)
    return Node(robot.graph.me, writer, RobotHost(robot, previews), patience_ns, meetings=meetings)

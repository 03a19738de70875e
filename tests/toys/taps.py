"""A plugin whose maps are beacons by another name, so that two of them must be converted to meet; conversions count."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import beacons

from mapgraft.contracts import Descriptor, Layer, MapType, hookimpl

MAPGRAFT_CONTRACT = (1, 0)
TAPS = "taps"


class Taps(beacons.Beacons):
    """The map type."""

    name = TAPS

    def new_layer(self):
        return beacons.Heard(map_type=TAPS)

    def view(self, own, contributions=(), previous=None, touched=None):
        return dataclasses.replace(super().view(own, contributions, previous, touched), map_type=TAPS)

    def place(self, layer, T_receiver_donor, scale=1.0):
        return dataclasses.replace(super().place(layer, T_receiver_donor, scale), map_type=TAPS)

    def decode(self, data):
        return dataclasses.replace(super().decode(data), map_type=TAPS)

    def metadata(self, layer):
        return dataclasses.replace(super().metadata(layer), type=TAPS)


class ToBeacons:
    """The conversion; ``converted`` has the number of places of every layer that was converted."""

    converted: ClassVar[list[int]] = []

    def convert(self, layer: Layer, source: MapType, target: MapType) -> Layer:
        self.converted.append(len(layer.counts))
        made = target.new_layer()
        made.counts.update(layer.evidence())
        return made


class FromBeacons(ToBeacons):
    """The way back."""

    converted: ClassVar[list[int]] = []


@hookimpl
def register_map_types(register):
    register(Descriptor(TAPS, "taps:Taps", "beacons by another name"))


@hookimpl
def register_fusers(register):
    register(Descriptor("sum_of_taps", "beacons:Sum", "the sum of both", accepts=(TAPS,)))


@hookimpl
def register_conversions(register):
    register(Descriptor("taps_to_beacons", "taps:ToBeacons", "by their own name", accepts=(TAPS,), gives="beacons"))
    register(Descriptor("beacons_to_taps", "taps:FromBeacons", "by the other name", accepts=("beacons",), gives=TAPS))

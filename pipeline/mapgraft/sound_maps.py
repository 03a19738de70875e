"""Whether what a map type gave can be used at all; each function raises PluginError that goes on after its name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Final, cast

import numpy as np

from mapgraft.contracts import Layer, Map, MapMetadata, OutputMessage, Points, Region, Reset
from mapgraft.errors import MapError, PluginError
from mapgraft.exchange import MOST_OFFER, Offer
from mapgraft.sound_values import finite, number, shown, text

_OF_REGIONS: Final = ("union", "minus", "__len__")
LONGEST_NAME: Final = 64  # bytes of the name of a part


def sound_layer(layer: object, map_type: str) -> Layer:
    """A layer of the type that was asked for."""
    told = getattr(layer, "map_type", None)
    if told != map_type:
        raise PluginError(f"gave a {type(layer).__name__} of type {shown(told)} where a layer of {map_type} was wanted")
    return cast("Layer", layer)


def sound_view(map_: object, map_type: str) -> Map:
    """A map of the type that was asked for."""
    if getattr(map_, "map_type", None) != map_type or not callable(getattr(map_, "known", None)):
        raise PluginError(f"gave {shown(map_)} where a map of type {map_type} was wanted")
    return cast("Map", map_)


def sound_map(map_: object, map_type: str) -> Map:
    """A map of the type that was asked for, which knows a number of units: for some types that is work."""
    found = sound_view(map_, map_type)
    known = found.known()
    if not isinstance(known, int | np.integer) or known < 0:
        raise PluginError(f"gave a map that knows {shown(known)} units")
    return found


def sound_region(region: object) -> Region:
    """What can be united, taken away and counted."""
    if not _is_region(cast("type[Region]", type(region))):
        raise PluginError(f"gave {shown(region)} where a region was wanted")
    return cast("Region", region)


@cache
def _is_region(kind: type[Region]) -> bool:
    """Asked once a kind: for every scan it would take as long as all else here."""
    return all(callable(getattr(kind, method, None)) for method in _OF_REGIONS)


def sound_reset(reset: object) -> Reset:
    """What was discarded, with counts."""
    if not isinstance(reset, Reset):
        raise PluginError(f"gave {shown(reset)} where a Reset was wanted")
    sound_region(reset.touched)
    for what, count in (("reset", reset.cells_reset), ("contaminated", reset.cells_contaminated)):
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 0:
            raise PluginError(f"gave {shown(count)} as the number of cells {what}, a count was wanted")
    return reset


def sound_bytes(data: object) -> bytes:
    """A layer's encoding."""
    if not isinstance(data, bytes):
        raise PluginError(f"gave a {type(data).__name__} where bytes were wanted")
    return data


def sound_parts(parts: object) -> Mapping[bytes, bytes]:
    """A layer in parts, under names that fit into a message."""
    if not isinstance(parts, Mapping):
        raise PluginError(f"gave {shown(parts)} where a mapping from names to parts was wanted")
    for name, part in parts.items():
        if not isinstance(name, bytes) or len(name) > LONGEST_NAME:
            raise PluginError(f"gave a part named {shown(name)}, at most {LONGEST_NAME} bytes were wanted")
        if not isinstance(part, bytes):
            raise PluginError(f"gave a part of type {type(part).__name__}, bytes were wanted")
    return parts


def sound_metadata(metadata: object, map_type: str) -> MapMetadata:
    """What a robot may tell: its own type, finite numbers, texts."""
    if not isinstance(metadata, MapMetadata) or metadata.type != map_type:
        raise PluginError(f"gave {shown(metadata)} where the metadata of a map of type {map_type} were wanted")
    for what, value in (("a resolution", metadata.resolution_m), ("a quality", metadata.quality)):
        if value is not None:
            finite(what, value)
    finite("a known area", metadata.known_area_m2)
    number("a number of observations", metadata.observations)
    bounds_m: object = metadata.bounds_m
    if bounds_m is not None:
        if not isinstance(bounds_m, Sequence) or len(bounds_m) != 4:
            raise PluginError(f"gave bounds of {shown(bounds_m)}, x_min, y_min, x_max and y_max were wanted")
        for edge in bounds_m:
            finite("a bound", edge)
    for what, word in (("a sensor", metadata.sensor), ("a mapper", metadata.mapper)):
        text(what, word)
    return metadata


def sound_offer(offer: Offer) -> bytes:
    """What a robot tells, as bytes that others read: who sent more, or else, would be heard by nobody, and not know."""
    data = offer.encode()
    if len(data) > MOST_OFFER:
        said = f"tells {len(data):,} bytes about its map, of which others read at most {MOST_OFFER:,}"
        raise PluginError(f"{said}: let its metadata be shorter")
    try:
        Offer.decode(data)
    except MapError as error:
        raise PluginError(f"tells about its map what others do not take: {error}") from None
    return data


def sound_points(points: object) -> Points:
    """Positions in the plane or in space."""
    if not isinstance(points, np.ndarray) or points.ndim != 2 or points.shape[1] not in (2, 3):
        raise PluginError(f"gave {shown(points)} where positions (n, 2) or (n, 3) were wanted")
    return points


def sound_messages(messages: object) -> Sequence[OutputMessage]:
    """How viewers see a map; all of them, for an iterable may fail on the way."""
    if not isinstance(messages, Iterable):
        raise PluginError(f"gave {shown(messages)} where messages were wanted")
    found = tuple(messages)
    for message in found:
        if not isinstance(message, OutputMessage):
            raise PluginError(f"gave {shown(message)} among its messages")
    return found


def sound_files(files: object) -> Mapping[str, bytes]:
    """File names with their content."""
    if not isinstance(files, Mapping):
        raise PluginError(f"gave {shown(files)} where a mapping from file names to bytes was wanted")
    for name, content in files.items():
        text("a file's name", name)
        if not isinstance(content, bytes):
            raise PluginError(f"gave a file {shown(name)} of type {type(content).__name__}, bytes were wanted")
    return files

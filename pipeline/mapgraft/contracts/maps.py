"""Map types: how evidence accumulates, is viewed, encoded, placed in another frame, and taken out again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol, Self, runtime_checkable

from mapgraft.contracts.geometry import Points, Transform
from mapgraft.contracts.observations import Observation


class Region(Protocol):
    """A set of the map type's finest units (cells, voxels, features). The engine knows only union, minus and len.

    It carries what its units mean (the resolution, say); united with a region of other units it raises MapError.
    """

    def union(self, other: Self) -> Self: ...
    def minus(self, other: Self) -> Self: ...
    def __len__(self) -> int: ...


@runtime_checkable
class MeetingRegion(Region, Protocol):
    """A region that can tell, without making another one, whether it has a unit in common with one of its type.

    For every other region the engine finds out with ``minus`` and ``len``.
    """

    def meets(self, other: Self) -> bool: ...


class Layer(Protocol):
    """The evidence of one source in that source's own frame: raw, additive, written by one robot only.

    What is inside is the map type's own affair; the engine hands it around and never looks in.
    """

    @property
    def map_type(self) -> str: ...


@runtime_checkable
class CountedLayer(Layer, Protocol):
    """A layer that can tell how often its units were seen, so that nobody makes more of them than there were.

    ``most_looks`` is the largest count that a unit has of anything (hits, misses): so many observations say the same of
    it. Neither placing nor converting raises it, also where several units fall into one: they were seen together.
    """

    def most_looks(self) -> int: ...


class Map(Protocol):
    """A read-only view computed from layers: what matchers and metrics look at."""

    @property
    def map_type(self) -> str: ...
    def known(self) -> int:
        """How many of the type's finest units are known; 0 means that the map is empty."""
        ...


@dataclass(frozen=True, slots=True)
class MapMetadata:
    """What a robot tells about its map before it sends it (a few hundred bytes).

    ``bounds_m`` is (x_min, y_min, x_max, y_max) of what is known, in the map's own frame; ``known_area_m2`` is the area
    that was looked at; ``sensor`` names what saw it, as the recording does; ``quality`` in [0, 1] where the type can
    judge it; ``mapper`` names what made the map (``scans``, ``ready map``); ``can_send`` names what may
    travel with the layer (``rays``, ``path``, …); ``extra`` holds further plain values that rules may ask for. All of
    it, with the robot's name, may take 16 KiB as JSON: a robot that tells more takes no part any more.
    """

    type: str
    resolution_m: float | None = None
    scale_known: bool = True
    bounds_m: tuple[float, float, float, float] | None = None
    known_area_m2: float = 0.0
    observations: int = 0
    sensor: str = ""
    mapper: str = "scans"
    quality: float | None = None
    can_send: tuple[str, ...] = ()
    extra: Mapping[str, float | str | bool] = field(default_factory=dict)


class Provenance(NamedTuple):
    """Whose evidence it is, in which life of the robot's map frame, and after how many observations."""

    source: str
    epoch: int
    version: int


class Donation(NamedTuple):
    """A donor's layer as it was received, with its provenance."""

    layer: Layer
    provenance: Provenance


Role = Literal["observation", "prior"]


@dataclass(frozen=True, slots=True, eq=False)
class Contribution:
    """What the fuser made of a donor's layer: immutable, with everything needed to take it out again.

    ``layer`` is of the receiver's type, in the receiver's frame, and holds the donor's evidence **unweighted**, so
    that metrics see the donor as it is. ``weights`` and ``fill`` say how it enters the fused view and are the type's
    own affair: for grids an application count 0–3 per tile, and the cells in which a weight of 0 still fills what the
    receiver does not know. ``T_receiver_donor`` is in fixed point (``Transform.snapped``), ``resampler`` names the
    rule that placed the layer, ``region`` the units that the contribution changes in the fused view. ``summary`` holds
    named numbers that tell how it was fused, shown in the events.
    """

    provenance: Provenance
    layer: Layer
    T_receiver_donor: Transform
    scale: float
    resampler: str
    weights: object
    fill: Region | None
    region: Region
    role: Role = "observation"
    summary: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Reset:
    """What discarding a donor's data in a single map cost: units reset to unknown, units left contaminated.

    ``touched`` are the units discarded, ``cells_reset`` counts those of them that held evidence before, and
    ``cells_contaminated`` the donor's units that were kept, also where its evidence and another donor's cancel.
    """

    touched: Region
    cells_reset: int
    cells_contaminated: int


@dataclass(frozen=True, slots=True)
class Exactness:
    """The statement of a reversal after a revert.

    ``exact`` means that the robot's map is, bit for bit, what it would be had the merge never happened, and that
    nothing else went with it. ``cells_lost`` counts units of the robot's own or of other standing merges' evidence that
    went with the revert, each once however many had a share in it, ``cells_contaminated`` units that still hold
    something of the reverted donor, also where that and another donor's evidence cancel.
    """

    exact: bool
    cells_reset: int = 0
    cells_contaminated: int = 0
    cells_lost: int = 0
    reason: str = ""


@dataclass(frozen=True, slots=True)
class OutputMessage:
    """How a viewer sees a map: a ROS 2 message as nested plain values, without its header.

    ``suffix`` ends the topic (``/<robot>/<suffix>``); ``message_type`` is e.g. ``nav_msgs/msg/OccupancyGrid``;
    ``fields`` maps field names to numbers, strings, arrays, lists or nested mappings. The output fills in every
    ``header`` field of the message, at the top and inside (the markers of a MarkerArray have their own).
    """

    suffix: str
    message_type: str
    fields: Mapping[str, object]


class MapType(Protocol):
    """A kind of map. Keyword-only, defaulted constructor arguments are its parameters (resolution, sensor model, …).

    An instance belongs to one robot. Layers of other instances (other parameters) of the same type may be viewed,
    encoded and placed, because every layer carries the parameters it was made with.

    ``name``, the descriptor's name, ``Layer.map_type``, ``Map.map_type`` and ``MapMetadata.type`` are one word. Only
    ``integrate``, ``absorb`` and ``reset`` write, and only to the layer they are given; a layer inside a Donation or a
    Contribution is never written again. The engine hands a type only layers, maps and regions of that type.
    """

    @property
    def name(self) -> str: ...

    def new_layer(self) -> Layer:
        """An empty layer with this instance's parameters."""
        ...

    def integrate(self, layer: Layer, observation: Observation) -> Region:
        """Add one observation to the one live layer, in place; returns what it touched."""
        ...

    def view(
        self,
        own: Layer | None,
        contributions: Sequence[Contribution] = (),
        previous: Map | None = None,
        touched: Region | None = None,
    ) -> Map:
        """The fused map ``own + Σ weighted contributions``, in this instance's parameters.

        Pure. With ``previous`` (an earlier view of the same layers) and ``touched`` (all that has changed since) only
        that is computed anew, and the result equals a fresh view (a law). ``own`` may be of another resolution than
        the instance's only when there are no contributions.
        """
        ...

    def place(self, layer: Layer, T_receiver_donor: Transform, scale: float = 1.0) -> Layer:
        """The layer's evidence in the receiver's frame and this instance's resolution, deterministic and unweighted.

        ``T_receiver_donor`` is snapped to fixed point first. Raises EmptyMapError when there is nothing to place.
        """
        ...

    def absorb(self, layer: Layer, contribution: Contribution) -> Region:
        """Bake a contribution into a layer, in place (``single_map``, ``multi_map``).

        Returns the units to which the contribution adds evidence, whatever the layer holds there already.
        """
        ...

    def reset(self, layer: Layer, foreign: Region, keep: Region) -> Reset:
        """The paper's discard (section 3.2): set ``foreign`` minus ``keep`` to unknown, in place, and count.

        ``foreign`` is what ``absorb`` returned, without what was discarded since. ``cells_reset`` counts the units that
        held evidence, ``cells_contaminated`` those in ``foreign`` and ``keep``.
        """
        ...

    def region(self, layer: Layer) -> Region:
        """The units about which the layer holds evidence."""
        ...

    def known_region(self, map_: Map) -> Region:
        """The units that the map knows, as many as ``map_.known()`` says: what evidence has made out, and no hints."""
        ...

    def encode(self, layer: Layer) -> bytes:
        """Canonical bytes: equal layers give equal bytes."""
        ...

    def decode(self, data: bytes) -> Layer:
        """The inverse of ``encode``: a layer of its own that may be integrated into (a copy is decode of encode).

        Raises MapError when the bytes are not a layer of this type.
        """
        ...

    def metadata(self, layer: Layer) -> MapMetadata: ...

    def structure(self, map_: Map, within: Map | None = None) -> Points:
        """Where in the map something stands: (n, 2) or (n, 3) metres in the map's frame, in an order of the map's own.

        For grids the centres of occupied cells: what is free is no structure. With ``within``, a map in the same frame,
        only what lies where that map knows something. Tells how far a map is displaced, and how much of it is new.
        """
        ...

    def messages(self, map_: Map) -> Iterable[OutputMessage]:
        """How viewers see the map.

        Pictures of it are drawn from the ``nav_msgs/OccupancyGrid`` among them, which says how it looks from above;
        where there is none, from lines, boxes and points, which are walls, but free space in markers of the namespace
        ``free``.
        """
        ...

    def files(self, map_: Map, stem: str) -> Mapping[str, bytes]:
        """The map in its type's usual file format: file name → content, names starting with ``stem``."""
        ...


@runtime_checkable
class PartedType(Protocol):
    """A map type whose layers travel in parts, so that only those are sent that have changed.

    Layers of every other type travel as one part, which ``encode`` makes.
    """

    def parts(self, layer: Layer) -> Mapping[bytes, bytes]:
        """The layer cut into parts (tiles, blocks, …) by names of at most 64 bytes; equal layers have equal parts.

        What has not changed of a layer makes the same bytes under the same name. They are not compressed: whoever sends
        them does that, against what the other has.
        """
        ...

    def join(self, parts: Mapping[bytes, bytes]) -> Layer:
        """The inverse of ``parts``: a live layer; its encoding is that of the layer that was cut.

        Raises MapError when these are not the parts of a layer.
        """
        ...


@runtime_checkable
class PreviewedType(Protocol):
    """A map type that can tell in few bytes what a map looks like, for others to find out whether it is of use."""

    def preview(self, layer: Layer) -> Layer:
        """A layer whose view knows the same units as the layer's own, and says the same of each, but no more: not how
        often it was seen, nor what was seen from where."""
        ...


class Conversion(Protocol):
    """Turns a layer of one type into a layer of another; counts survive, not only classes.

    ``source`` is the instance whose parameters (thresholds, …) say how the layer is read, ``target`` the one whose
    parameters (resolution, …) the result must have; where the layer's scale is unknown, the result's resolution is in
    the layer's own units. A rule's ``via`` names the type in which two maps are matched and measured; what the fuser
    then gets is the donor's layer in the receiver's type where conversions lead there, and as it was sent where none
    does.
    """

    def convert(self, layer: Layer, source: MapType, target: MapType) -> Layer: ...

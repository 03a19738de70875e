"""A tiny map type (a few square cells) and a mission of three robots told to a sink, for tests of what is written."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np

from mapgraft.contracts import (
    Contribution,
    Exactness,
    Map,
    MapMetadata,
    Measurement,
    Observation,
    OutputMessage,
    Points,
    Region,
    Reset,
    Transform,
)
from mapgraft.contracts import (
    Layer as AnyLayer,
)
from mapgraft.events import DonorMap, Event, Sink, Snapshot
from mapgraft.network.radio import Traffic
from mapgraft.outputs.provenance import InputFile, RunProvenance

S = 1_000_000_000
START_NS = 1_600_000_000 * S
ALPHA, AT, UNDERSCORE = "alpha", "beta@2", "beta_2"  # two robots that ROS would give one name
ROBOTS = (ALPHA, AT, UNDERSCORE)
RESOLUTION_M = 0.5
Why = Literal["before merge", "after merge", "before revert", "after revert", "end"]


@dataclass(frozen=True)
class Cells:
    at: frozenset[tuple[int, int]]

    def union(self, other: Cells) -> Cells:
        return Cells(self.at | other.at)

    def minus(self, other: Cells) -> Cells:
        return Cells(self.at - other.at)

    def __len__(self) -> int:
        return len(self.at)


@dataclass
class Plot:
    """A layer: cell → 0 (free) or 100 (occupied). As a map it is its own view."""

    cells: dict[tuple[int, int], int] = field(default_factory=dict)
    map_type: str = "plot"

    def known(self) -> int:
        return len(self.cells)


class PlotType:
    """Cells of half a metre; what was seen last stands."""

    name = "plot"

    def new_layer(self) -> Plot:
        return Plot()

    def integrate(self, layer: AnyLayer, observation: Observation) -> Cells:
        assert isinstance(observation.payload, dict)
        seen: Mapping[tuple[int, int], int] = observation.payload
        _plot(layer).cells.update(seen)
        return Cells(frozenset(seen))

    def view(
        self,
        own: AnyLayer | None,
        contributions: Sequence[Contribution] = (),
        previous: Map | None = None,
        touched: Region | None = None,
    ) -> Plot:
        cells: dict[tuple[int, int], int] = {}
        for contribution in contributions:
            cells.update(_plot(contribution.layer).cells)
        return Plot(cells | (_plot(own).cells if own is not None else {}))

    def place(self, layer: AnyLayer, T_receiver_donor: Transform, scale: float = 1.0) -> Plot:
        T, cells = T_receiver_donor.snapped(), _plot(layer).cells
        centres = (np.array(list(cells), dtype=np.float64) + 0.5) * RESOLUTION_M * scale
        moved = np.floor(T.apply(centres) / RESOLUTION_M).astype(int).tolist()
        return Plot({(x, y): value for (x, y), value in zip(moved, cells.values(), strict=True)})

    def absorb(self, layer: AnyLayer, contribution: Contribution) -> Cells:
        _plot(layer).cells.update(_plot(contribution.layer).cells)
        return self.region(contribution.layer)

    def reset(self, layer: AnyLayer, foreign: Region, keep: Region) -> Reset:
        assert isinstance(foreign, Cells) and isinstance(keep, Cells)
        for cell in foreign.at - keep.at:
            _plot(layer).cells.pop(cell, None)
        return Reset(foreign, len(foreign.at - keep.at), len(foreign.at & keep.at))

    def region(self, layer: AnyLayer) -> Cells:
        return Cells(frozenset(_plot(layer).cells))

    def known_region(self, map_: Map) -> Cells:
        return Cells(frozenset(_plot(map_).cells))

    def encode(self, layer: AnyLayer) -> bytes:
        return json.dumps(sorted([x, y, value] for (x, y), value in _plot(layer).cells.items())).encode()

    def decode(self, data: bytes) -> Plot:
        return Plot({(x, y): value for x, y, value in json.loads(data)})

    def metadata(self, layer: AnyLayer) -> MapMetadata:
        cells = _plot(layer).cells
        x, y = np.array(list(cells)).T if cells else (np.zeros(1), np.zeros(1))
        low, high = (x.min(), y.min()), (x.max() + 1, y.max() + 1)
        bounds = (*(float(v) * RESOLUTION_M for v in low), *(float(v) * RESOLUTION_M for v in high))
        return MapMetadata(
            "plot",
            RESOLUTION_M,
            bounds_m=(bounds[0], bounds[1], bounds[2], bounds[3]) if cells else None,
            known_area_m2=len(cells) * RESOLUTION_M**2,
            observations=len(cells),
            sensor="probe",
            can_send=("cells",),
            extra={"colour": "green", "depth": 2.5, "wet": False},
        )

    def structure(self, map_: Map, within: Map | None = None) -> Points:
        known = _plot(map_ if within is None else within).cells
        cells = [cell for cell, value in _plot(map_).cells.items() if value and cell in known]
        return (np.array(cells, np.float64).reshape(-1, 2) + 0.5) * RESOLUTION_M

    def messages(self, map_: Map) -> Iterable[OutputMessage]:
        grid, (x0, y0) = _raster(map_)
        info = {
            "resolution": RESOLUTION_M,
            "width": grid.shape[1],
            "height": grid.shape[0],
            "origin": {"position": {"x": x0 * RESOLUTION_M, "y": y0 * RESOLUTION_M}},
        }
        yield OutputMessage("map", "nav_msgs/msg/OccupancyGrid", {"info": info, "data": grid.reshape(-1)})

    def files(self, map_: Map, stem: str) -> Mapping[str, bytes]:
        return {f"{stem}.json": self.encode(_plot(map_))}


def _plot(layer: object) -> Plot:
    assert isinstance(layer, Plot)
    return layer


def _raster(map_: Map) -> tuple[np.ndarray, tuple[int, int]]:
    cells = _plot(map_).cells
    x, y = np.array(list(cells)).T
    grid = np.full((int(np.ptp(y)) + 1, int(np.ptp(x)) + 1), -1, dtype=np.int8)
    grid[y - y.min(), x - x.min()] = list(cells.values())
    return grid, (int(x.min()), int(y.min()))


def traffic() -> Traffic:
    """What the robots sent each other."""
    return Traffic({(ALPHA, AT, "hello"): 120, (ALPHA, AT, "layer"): 4000})


def provenance(started_at: datetime = datetime(2026, 1, 2, tzinfo=UTC), host: str = "here") -> RunProvenance:
    """Of a run over two files."""
    inputs = (InputFile("a.mcap", "ab" * 32, 1234), InputFile("b.bag", "cd" * 32, 99))
    return RunProvenance("0.1.0", "seed: 0\n", "- name: all\n", inputs, started_at, host, {"plot": "plots 1.0"})


def told() -> Iterator[Observation | Event | Snapshot]:
    """The mission, in order: 30 s at 20 observations per second and robot, merges, a revert, and the end."""
    happen = _happenings()
    seq = 0
    for tick in range(600):
        stamp_ns = START_NS + tick * S // 20
        for snapshot_or_event in happen.get(tick, ()):
            if isinstance(snapshot_or_event, Snapshot):
                yield snapshot_or_event
            else:
                yield Event(seq=seq, stamp_ns=stamp_ns, **snapshot_or_event)
                seq += 1
        if 200 < tick < 400 and tick % 2 == 0:
            yield Event(seq=seq, stamp_ns=stamp_ns, **_verified(tick))
            seq += 1
        for n, robot in enumerate(ROBOTS):
            T = Transform.planar(tick * 0.02, float(n), 0.01 * tick)
            yield Observation(robot, stamp_ns + n, stamp_ns + n, "probe", "cells", {(tick, n): 0}, T, T)
    for n, robot in enumerate(ROBOTS):
        yield snapshot(robot, 599, "end", 14, extra={(90, 90 + n): 100} if robot == ALPHA else {})


def tell(sink: Sink, story: Iterable[Observation | Event | Snapshot]) -> None:
    """Hand everything to the sink, as a replay does."""
    for item in story:
        if isinstance(item, Observation):
            sink.observed(item)
        elif isinstance(item, Event):
            sink.happened(item)
        else:
            sink.mapped(item)


def snapshot(
    robot: str,
    tick: int,
    why: Why,
    size: int,
    merge_id: str = "",
    extra: Mapping[tuple[int, int], int] | None = None,
    donor: str = "",
) -> Snapshot:
    """A square map of ``size`` cells with a wall on one side; ``extra`` cells are in the fused map only, from ``donor``
    if there is one."""
    own = Plot({(x, y): 100 if x == 0 else 0 for x in range(size) for y in range(size)})
    kind = PlotType()
    return Snapshot(
        robot,
        START_NS + tick * S // 20,
        why,
        kind,
        own,
        Plot(own.cells | dict(extra or {})),
        kind.encode(own),
        kind.metadata(own),
        size,
        merge_id,
        {donor: DonorMap(kind, Plot({(7, 7): 0, **dict(extra or {})}))} if donor else {},
    )


def _happenings() -> dict[int, list[Snapshot | dict[str, Any]]]:
    first, second = f"{ALPHA}.{AT}.1", f"{UNDERSCORE}.{ALPHA}.1"
    made = {"by": "threshold", "rule": "all", "matcher": "look", "fuser": "lay", "verifier": "watch", "score": 0.9}
    one = {"receiver": ALPHA, "donor": AT, "merge_id": first, "reversal": "ledger", **made}
    one |= {"T_receiver_donor": Transform.planar(20.0, 3.0, 0.3).snapped(), "covariance": _COVARIANCE}
    two = {"receiver": UNDERSCORE, "donor": ALPHA, "merge_id": second, "reversal": "single_map", **made}
    two |= {"T_receiver_donor": Transform.planar(-4.0, 1.0, -1.2).snapped(), "margin": np.inf}
    pair = {"receiver": ALPHA, "donor": UNDERSCORE}
    lost = Exactness(False, 120, 3, 2, "cells seen since the merge stay")
    return {
        100: [{"kind": "offered", **pair, "bytes_received": 240}],
        101: [
            {"kind": "rejected", **pair, "reason": "no rule fits: 'all' needs a known scale", "by": "decision table"}
        ],
        200: [
            snapshot(ALPHA, 200, "before merge", 10, first, donor=AT),
            {"kind": "merged", "state": "provisional", "reason": "0.9 is above 0.5", "hypotheses": 2, **one}
            | {"measurements": (_similarity(0.91),), "evidence": {"support": 120.0}, "bytes_received": 5000},
            snapshot(ALPHA, 200, "after merge", 10, first, extra={(40, 6): 100}, donor=AT),
        ],
        300: [
            snapshot(UNDERSCORE, 300, "before merge", 12, second, donor=ALPHA),
            {"kind": "merged", "state": "provisional", **two},
            snapshot(UNDERSCORE, 300, "after merge", 12, second, extra={(-8, 2): 100}, donor=ALPHA),
        ],
        350: [{"kind": "updated", "state": "provisional", "donor_version": 351, **one}],
        400: [{"kind": "confirmed", "state": "confirmed", "reason": "long enough", **one}],
        450: [
            snapshot(UNDERSCORE, 450, "before revert", 13, second, extra={(-8, 2): 100}, donor=ALPHA),
            {"kind": "reverted", "state": "reverted", "reason": "0.2 is below 0.5", "exactness": lost, **two}
            | {"measurements": (_similarity(0.2),)},
            snapshot(UNDERSCORE, 450, "after revert", 13, second),
        ],
        500: [
            {"kind": "unmatched", "state": "candidate", "merge_id": f"{ALPHA}.{UNDERSCORE}.1", **pair},
            {"kind": "ambiguous", "state": "candidate", "merge_id": f"{ALPHA}.{UNDERSCORE}.2", **pair, "margin": 1.5},
        ],
    }


def _verified(tick: int) -> dict[str, Any]:
    return {
        "kind": "verified",
        "receiver": ALPHA,
        "donor": AT,
        "merge_id": f"{ALPHA}.{AT}.1",
        "state": "provisional",
        "reason": "keep",
        "measurements": (_similarity(0.9 + tick * 1e-4), Measurement("rays", np.nan, "1", 0, "lower")),
        "T_receiver_donor": Transform.planar(20.0, 3.0, 0.3).snapped(),
    }


def _similarity(value: float) -> Measurement:
    return Measurement("similarity", value, "1", 50, "higher", {"free": value, "occupied": 0.5})


_COVARIANCE = np.diag([0.01, 0.02, 0.0, 0.0, 0.0, 0.001])

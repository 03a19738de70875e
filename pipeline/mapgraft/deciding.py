"""Where to look next: the place whose observation would best tell apart where a donor's map may lie."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Finding, Map, MapType, Match, Measurement, Transform
from mapgraft.outputs.report.rasters import FREE, OCCUPIED, UNKNOWN, Raster, drawable_of, raster_of

NAME: Final = "deciding_place"
CELL_M: Final = 0.25  # at least; walls that hypotheses put closer together are the same
REACH_M: Final = 8.0  # of a scan
ERROR: Final = 0.1  # share of what is seen that is not as a right hypothesis predicts
CHANCE: Final = 0.4  # the same of a wrong one, where nothing else is predicted
_BLOCK: Final = 2  # cells: what is seen within half a metre is one piece of evidence
_RAYS: Final = 90
_MOST_VIEWS: Final = 600
_MOST_CELLS: Final = 4_000_000
_NEARLY: Final = 0.9  # a share of the best that is worth a shorter way

Cells = NDArray[np.uint8]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Place:
    """Where to stand (``x_m``, ``y_m``) in the receiver's frame, and what to look at.

    ``nats`` is by how much what is seen there is expected to change the log-odds between the hypotheses, whichever is
    right; it rests on so many ``blocks`` of half a metre. Of one hypothesis that has no ``rival`` the alternative is
    that it is wrong.
    """

    x_m: float
    y_m: float
    look_x_m: float
    look_y_m: float
    nats: float
    blocks: int
    has_rival: bool

    @property
    def sentence(self) -> str:
        """One clause for a person."""
        what = "tell the two apart" if self.has_rival else "tell whether it is right"
        stand, look = f"({self.x_m:z.1f}, {self.y_m:z.1f}) m", f"({self.look_x_m:z.1f}, {self.look_y_m:z.1f}) m"
        return f"from {stand} a look at {look} would best {what}: {self.nats:.1f} nats expected"

    @property
    def evidence(self) -> Mapping[str, float]:
        """The numbers as they stand in the event."""
        stand = {"deciding_x_m": self.x_m, "deciding_y_m": self.y_m}
        look = {"deciding_look_x_m": self.look_x_m, "deciding_look_y_m": self.look_y_m}
        return {**stand, **look, "deciding_nats": self.nats}

    @property
    def measurement(self) -> Measurement:
        """The same as a measurement, with the line from where to look to what as its finding."""
        stand, look = (self.x_m, self.y_m, 0.0), (self.look_x_m, self.look_y_m, 0.0)
        details = {"x_m": self.x_m, "y_m": self.y_m, "look_x_m": self.look_x_m, "look_y_m": self.look_y_m}
        finding = Finding("deciding place", stand, look, self.nats, "nats")
        return Measurement(NAME, self.nats, "nats", self.blocks, "higher", details, (finding,))


def deciding_place(
    map_type: MapType, own: Map, donor: Map, matches: Sequence[Match], at: Transform | None
) -> Place | None:
    """The place for one or two hypotheses of where a donor's map lies; ``at`` is where the robot is.

    A place decides where it is unknown to the robot and the hypotheses predict wall and free space, one each, more
    than a cell apart; it is looked at from the robot's own free space, as far as the way there is free, and seen as far
    as the own map and the hypothesis let light through. Where two hypotheses agree on all that can be seen, the place
    is one that tells whether the first is right. None where there is no such, or a map cannot be seen from above.
    Raises what the map type raises.
    """
    mine, theirs = _from_above(map_type, own), _from_above(map_type, donor)
    if mine is None or theirs is None or not matches:
        return None
    lattice = _Lattice.around(mine, max(theirs.cell_m * match.scale for match in matches))
    if lattice is None:
        return None
    known = lattice.cells_of(mine, None)
    worlds = [lattice.cells_of(theirs, match) for match in matches[:2]]
    return _told(known, worlds, lattice, at) or _told(known, worlds[:1], lattice, at)


def _told(known: Cells, worlds: Sequence[Cells], lattice: _Lattice, at: Transform | None) -> Place | None:
    contested = (known == UNKNOWN) & _differ(worlds)
    stands = _stands(known, contested, lattice, at)
    if not len(stands):
        return None
    steps = round(2.0 * REACH_M / lattice.cell_m)
    seen = [_seen_from(stands, steps, known, world, contested) for world in worlds]
    blocks = np.mean([one.sum(axis=1) for one in seen], axis=0)
    best = _best(blocks, stands, lattice, at)
    if blocks[best] < 1.0:
        return None
    look = _centre_of_cluster(np.any([one[best] for one in seen], axis=0), contested, lattice)
    x_m, y_m = lattice.centre(*stands[best])
    nats = float(blocks[best]) * _nats_per_block(len(worlds) > 1)
    return Place(x_m, y_m, *look, nats, round(float(blocks[best])), len(worlds) > 1)


@dataclass(frozen=True, slots=True)
class _Lattice:
    """Square cells around a robot's own map, as far as a scan reaches beyond it."""

    x_m: float
    y_m: float
    cell_m: float
    rows: int
    columns: int

    @classmethod
    def around(cls, raster: Raster, least_m: float) -> _Lattice | None:
        """In cells that are no smaller than those of the maps; None where there would be too many."""
        cell_m = max(CELL_M, raster.cell_m, least_m)
        x0, y0, x1, y1 = raster.bounds_m
        columns, rows = (math.ceil((side + 2.0 * REACH_M) / cell_m) for side in (x1 - x0, y1 - y0))
        if rows * columns > _MOST_CELLS:
            return None
        return cls(x0 - REACH_M, y0 - REACH_M, cell_m, rows, columns)

    def cells_of(self, raster: Raster, match: Match | None) -> Cells:
        """What a map says, by a hypothesis of where it lies; where any of it is wall a cell is wall."""
        out = np.zeros((self.rows, self.columns), np.uint8)
        for what in (FREE, OCCUPIED):
            rows, columns = np.nonzero(raster.cells == what)
            points = np.stack((raster.x_m + (columns + 0.5) * raster.cell_m, raster.y_m + (rows + 0.5) * raster.cell_m))
            if match is not None:
                T = match.T_receiver_donor.matrix
                points = match.scale * T[:2, :2] @ points + T[:2, 3:4]
            at = np.floor((points - [[self.x_m], [self.y_m]]) / self.cell_m).astype(np.intp)
            inside = (at[0] >= 0) & (at[0] < self.columns) & (at[1] >= 0) & (at[1] < self.rows)
            out[at[1][inside], at[0][inside]] = what
        return out

    def centre(self, row: int, column: int) -> tuple[float, float]:
        """x and y (m)."""
        return float(self.x_m + (column + 0.5) * self.cell_m), float(self.y_m + (row + 0.5) * self.cell_m)

    def cell_at(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Row and column, in fractions."""
        return (y_m - self.y_m) / self.cell_m - 0.5, (x_m - self.x_m) / self.cell_m - 0.5


def _from_above(map_type: MapType, map_: Map) -> Raster | None:
    """How a map looks, of whatever type it is: from the messages in which viewers are shown it."""
    shown = {message.message_type: message for message in map_type.messages(map_)}
    chosen = drawable_of(shown)
    return None if chosen is None else raster_of(chosen, _as_message(shown[chosen].fields))


def _as_message(value: Any) -> Any:
    """Nested plain values with the attributes that a decoded message has."""
    if isinstance(value, Mapping):
        return SimpleNamespace(**{name: _as_message(one) for name, one in value.items()})
    return [_as_message(one) for one in value] if isinstance(value, list | tuple) else value


def _differ(worlds: Sequence[Cells]) -> Mask:
    """Where hypotheses predict different things, by more than a cell; where one alone predicts anything."""
    from scipy.ndimage import binary_dilation

    if len(worlds) == 1:
        predicted: Mask = worlds[0] != UNKNOWN
        return predicted
    one, other = worlds
    around = np.ones((3, 3), bool)
    clear = [(world == FREE) & ~binary_dilation(world == OCCUPIED, around) for world in worlds]
    differ: Mask = ((one == OCCUPIED) & clear[1]) | ((other == OCCUPIED) & clear[0])
    return differ


def _stands(known: Cells, contested: Mask, lattice: _Lattice, at: Transform | None) -> NDArray[np.intp]:
    """Cells (n, 2) of the own free space that the robot can drive to, near enough to what is to be seen."""
    from scipy.ndimage import distance_transform_edt, label

    free = known == FREE
    if not free.any() or not contested.any():
        return np.zeros((0, 2), np.intp)
    parts, _ = label(free)
    cells = np.argwhere(free)
    if at is None:
        part = int(np.bincount(parts[free]).argmax())
    else:
        apart = np.abs(cells - np.array(lattice.cell_at(at.x_m, at.y_m))).sum(axis=1)
        part = int(parts[tuple(cells[int(apart.argmin())])])
    near = distance_transform_edt(~contested) <= REACH_M / lattice.cell_m
    stands = np.argwhere((parts == part) & near).astype(np.intp)
    return stands[:: 1 + (len(stands) - 1) // _MOST_VIEWS] if len(stands) else stands


def _seen_from(stands: NDArray[np.intp], steps: int, known: Cells, world: Cells, contested: Mask) -> Mask:
    """(stands, blocks): which contested blocks a scan from each cell sees, if this hypothesis is right.

    Rays go on for so many steps of half a cell, through what is free as far as anybody knows.
    """
    number, count = _numbered(contested)
    seen = np.zeros((len(stands), count), bool)
    turns = 2.0 * math.pi * np.arange(_RAYS) / _RAYS
    step = 0.5 * np.stack((np.sin(turns), np.cos(turns)))
    opaque = (known == OCCUPIED) | ((known == UNKNOWN) & (world != FREE))
    alive = np.ones((len(stands), _RAYS), bool)
    rows, columns = (stands[:, side, None] + np.zeros(_RAYS) for side in (0, 1))
    for _ in range(steps):
        rows, columns = rows + step[0], columns + step[1]
        at = np.rint(rows).astype(np.intp), np.rint(columns).astype(np.intp)
        alive &= (at[0] >= 0) & (at[0] < known.shape[0]) & (at[1] >= 0) & (at[1] < known.shape[1])
        if not alive.any():
            break
        here = np.where(alive, at[0], 0), np.where(alive, at[1], 0)
        who, ray = np.nonzero(alive & contested[here] & (world[here] != UNKNOWN))
        seen[who, number[here[0][who, ray], here[1][who, ray]]] = True
        alive &= ~opaque[here]
    return seen


def _numbered(contested: Mask) -> tuple[NDArray[np.intp], int]:
    """The number of each contested cell's block, and how many blocks there are."""
    rows, columns = np.nonzero(contested)
    block = (rows // _BLOCK) * contested.shape[1] + columns // _BLOCK
    found, numbers = np.unique(block, return_inverse=True)
    out = np.zeros(contested.shape, np.intp)
    out[rows, columns] = numbers
    return out, len(found)


def _best(blocks: NDArray[np.float64], stands: NDArray[np.intp], lattice: _Lattice, at: Transform | None) -> int:
    """The cell from which most is seen; of those from which nearly as much is, the nearest to the robot."""
    if at is None:
        return int(blocks.argmax())
    good = np.flatnonzero(blocks >= _NEARLY * blocks.max())
    apart = np.hypot(*(stands[good] - np.array(lattice.cell_at(at.x_m, at.y_m))).T)
    return int(good[int(apart.argmin())])


def _centre_of_cluster(seen: Mask, contested: Mask, lattice: _Lattice) -> tuple[float, float]:
    """The middle of the largest cluster of what is seen, in metres."""
    from scipy.ndimage import label

    number, _ = _numbered(contested)
    shown = contested & seen[number]
    clusters, _ = label(shown, np.ones((3, 3)))
    largest = int(np.bincount(clusters[shown]).argmax())
    row, column = np.argwhere(clusters == largest).mean(axis=0)
    return lattice.centre(row, column)


def _nats_per_block(has_rival: bool) -> float:
    """What one piece of evidence is expected to say (Kullback-Leibler), against a rival or against chance."""
    wrong = 1.0 - ERROR if has_rival else CHANCE
    return (1.0 - ERROR) * math.log((1.0 - ERROR) / (1.0 - wrong)) + ERROR * math.log(ERROR / wrong)

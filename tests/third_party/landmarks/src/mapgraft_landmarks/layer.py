"""The evidence of one robot about point landmarks."""

from __future__ import annotations

from dataclasses import dataclass, field

from mapgraft.contracts import Layer, MapError
from mapgraft_landmarks.cells import CellRegion, Cells
from mapgraft_landmarks.landmarks import MAP_TYPE


@dataclass(slots=True, eq=False)
class LandmarkLayer:
    """Raw, additive evidence in the frame of whoever gathered it; a write puts a new table in the old one's place."""

    cell_m: float
    cells: Cells = field(default_factory=Cells.empty)
    observations: int = 0
    sensors: frozenset[str] = frozenset()

    @property
    def map_type(self) -> str:
        return MAP_TYPE

    def region(self) -> CellRegion:
        return CellRegion(self.cell_m, self.cells.keys)


def as_layer(layer: Layer) -> LandmarkLayer:
    """The layer as one of this type; raises MapError when it is of another."""
    if not isinstance(layer, LandmarkLayer):
        raise MapError(f"{MAP_TYPE} needs a layer of its own type, found one of {layer.map_type}")
    return layer

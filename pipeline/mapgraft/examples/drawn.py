"""Maps of any type as they look from above, drawn once and used by every attempt that needs them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Map, MapType
from mapgraft.errors import MapError, PluginError
from mapgraft.examples.pictures import map_png, reduced
from mapgraft.examples.rows import picture
from mapgraft.outputs.messages import MessageEncoder
from mapgraft.outputs.report.rasters import Raster, drawable_of, raster_of
from mapgraft.outputs.tables import Row

_KEPT: Final = 8  # maps that are kept in full; pairs follow each other robot by robot


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A map from above, and the picture of it that goes with the example."""

    raster: Raster
    shown: Raster
    png: bytes

    def columns(self, whose: str) -> Row:
        """The columns of its picture, those of ``own`` or ``donor``."""
        return {
            f"{whose}_picture": picture(self.png),
            f"{whose}_px_m": self.shown.cell_m,
            f"{whose}_x_m": self.shown.x_m,
            f"{whose}_y_m": self.shown.y_m,
        }


@dataclass(slots=True)
class Drawings:
    """Draws maps by the messages by which their types show them; ``undrawn`` says of which types it could not."""

    undrawn: dict[str, str] = field(default_factory=dict)
    _encoder: MessageEncoder = field(default_factory=MessageEncoder)
    _kept: OrderedDict[Hashable, Drawn | None] = field(default_factory=OrderedDict)

    def of(self, key: Hashable, palette: NDArray[np.uint8], map_type: MapType, see: Callable[[], Map]) -> Drawn | None:
        """The map that ``see`` gives; None where it is empty or its type cannot show it. Equal keys mean equal maps."""
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        drawn = self._draw(palette, map_type, see)
        self._kept[key] = drawn
        if len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return drawn

    def _draw(self, palette: NDArray[np.uint8], map_type: MapType, see: Callable[[], Map]) -> Drawn | None:
        if map_type.name in self.undrawn:
            return None
        try:
            raster = self._raster(map_type, see())
        except MapError:
            return None
        except PluginError as error:  # the run learns of it elsewhere; pictures are not worth a failure
            self.undrawn[map_type.name] = str(error)
            return None
        if raster is None:
            return None
        shown = reduced(raster)
        return Drawn(raster, shown, map_png(shown.cells, palette))

    def _raster(self, map_type: MapType, map_: Map) -> Raster | None:
        said = {message.message_type: message for message in reversed(tuple(map_type.messages(map_)))}
        message_type = drawable_of(said)
        if message_type is None:
            return None
        data = self._encoder.encode(message_type, said[message_type].fields, 0, "map")
        raster = raster_of(message_type, self._encoder.decode(message_type, data))
        return None if raster is None else raster.trimmed()

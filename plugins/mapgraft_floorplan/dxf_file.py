"""Plans as DXF: the lines of the model space, of all layers or of some."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_floorplan.plan import MOST_SEGMENTS, Plan, plan_of, require_few
from mapgraft_floorplan.units import believable, told_unit

LARGEST: Final = 256_000_000  # bytes
DEEPEST: Final = 16  # blocks inside each other
_METRES: Final = {  # of $INSUNITS
    1: 0.0254, 2: 0.3048, 3: 1609.344, 4: 1e-3, 5: 1e-2, 6: 1.0, 7: 1e3, 8: 2.54e-8, 9: 2.54e-5, 10: 0.9144,
    13: 1e-6, 14: 0.1, 15: 10.0, 16: 100.0, 21: 0.3048006,
}  # fmt: skip
_CURVED: Final = frozenset({"LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "SPLINE", "ELLIPSE"})
_SAGITTA: Final = 0.004  # of the extent of a curve: how far straight pieces lie off it
_ENTITIES: Final = 2 * MOST_SEGMENTS


@dataclass(slots=True)
class _Found:
    """Pieces of wall, which layers they are on, and what was left out."""

    name: str
    layers: Sequence[str] | None
    pieces: list[NDArray[np.float64]] = field(default_factory=list)
    count: int = 0
    looked_at: int = 0
    per_layer: dict[str, int] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)

    def look(self) -> None:
        self.looked_at += 1
        if self.looked_at > _ENTITIES:
            raise MapError(
                f"the plan {self.name} unfolds to more than {_ENTITIES} entities: select the layers with walls"
            )

    def add(self, ends: NDArray[np.float64], layer: str) -> None:
        self.per_layer[layer] = self.per_layer.get(layer, 0) + max(0, len(ends) - 1)
        if self.layers is not None and not any(fnmatchcase(layer.lower(), w.lower()) for w in self.layers):
            return
        if len(ends) > 1:
            self.pieces.append(np.hstack((ends[:-1], ends[1:])))
            self.count += len(ends) - 1
            require_few(self.count, f"the plan {self.name}")


def read(
    path: str | Path,
    *,
    unit_m: float | None = None,
    layers: Sequence[str] | None = None,
    warn: Callable[[str], None] | None = None,
) -> Plan:
    """The walls in a DXF drawing: lines, polylines, arcs, circles, ellipses and splines of the model space, those in
    inserted blocks included, seen from above.

    ``layers`` are names (with * and ?) of those that hold walls; without it all are read that are neither off nor
    frozen. ``unit_m`` is the length of one unit; without it $INSUNITS tells it, and where that is 0 the scale is
    unknown. Raises ConfigError when the unit is impossible, MapError when the file is no DXF, has no walls, or too
    many.
    """
    path = Path(path)
    wanted = [layers] if isinstance(layers, str) else layers
    unit = told_unit(unit_m, path.name)
    document = _opened(path)
    found = _Found(path.name, wanted)
    hidden = {layer.dxf.name for layer in document.layers if layer.is_off() or layer.is_frozen()}
    try:
        _collect(document.modelspace(), found, hidden, "0", 0)
    except (ValueError, TypeError, ArithmeticError, AttributeError, IndexError, KeyError) as fault:
        raise MapError(
            f"{path.name} holds an entity that cannot be read ({fault}): export the drawing again"
        ) from fault
    _tell(found, warn)
    segments = np.concatenate(found.pieces) if found.pieces else np.empty((0, 4))
    if unit is None and len(segments):
        told = _METRES.get(int(document.header.get("$INSUNITS", 0)))
        extent = float(np.ptp(segments.reshape(-1, 2), axis=0).max())
        unit = None if told is None else believable(told, extent, path.name, warn)
    return plan_of(segments, unit, f"the plan {path.name}")


def _opened(path: Path) -> Any:
    from ezdxf.filemanagement import readfile
    from ezdxf.lldxf.const import DXFError

    try:
        if path.stat().st_size > LARGEST:
            raise MapError(f"{path.name} is too large for a plan ({path.stat().st_size} bytes): export the walls alone")
        return readfile(str(path))
    except OSError as fault:
        raise MapError(f"the plan {path.name} cannot be read as DXF: {fault.strerror or fault}") from fault
    except (DXFError, ValueError, KeyError, TypeError, AttributeError, IndexError) as fault:
        said = " ".join(str(fault).split()) or type(fault).__name__
        raise MapError(f"{path.name} is no DXF drawing that can be read ({said}): export it again") from fault


def _collect(entities: Iterable[Any], found: _Found, hidden: set[str], around: str, depth: int) -> None:
    """Walls among the entities; what a block draws on layer 0 lies on the layer of its insertion."""
    for entity in entities:
        found.look()
        layer = around if entity.dxf.layer == "0" else entity.dxf.layer
        if layer in hidden or entity.dxf.get("invisible", 0):
            continue
        kind = entity.dxftype()
        if kind == "INSERT":
            if depth >= DEEPEST:
                raise MapError(f"{found.name} has more than {DEEPEST} blocks inside each other, or one inside itself")
            for one in entity.multi_insert() if entity.mcount > 1 else (entity,):
                _collect(one.virtual_entities(), found, hidden, layer, depth + 1)
        elif kind == "LINE":
            start, end = entity.dxf.start, entity.dxf.end
            found.add(np.array([[start.x, start.y], [end.x, end.y]]), layer)
        elif kind in _CURVED:
            for line in _flattened(entity):
                found.add(line, layer)
        else:
            found.left_out[kind] = found.left_out.get(kind, 0) + 1


def _flattened(entity: Any) -> Iterator[NDArray[np.float64]]:
    from ezdxf.path import make_path

    if entity.dxftype() == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline):
        return
    path = make_path(entity)
    if len(path) == 0:
        return
    if not path.has_curves:
        yield np.array([[v.x, v.y] for v in path.control_vertices()])
        return
    corners = np.array([[v.x, v.y] for v in path.control_vertices()])
    extent = float(np.ptp(corners, axis=0).max())
    if extent > 0.0:
        yield np.array([[v.x, v.y] for v in path.flattening(_SAGITTA * extent, 4)])


def _tell(found: _Found, warn: Callable[[str], None] | None) -> None:
    named = ", ".join(f"{layer} ({count})" for layer, count in sorted(found.per_layer.items()))
    if found.layers is not None and not found.pieces:
        raise MapError(f"{found.name} has no walls on the layers {', '.join(found.layers)}: it has {named or 'none'}")
    if warn is None:
        return
    if found.layers is None and len(found.per_layer) > 1:
        warn(
            f"{found.name}: the lines of all its layers are taken for walls; the option layers selects some of {named}"
        )
    if found.left_out:
        what = ", ".join(f"{count} {kind}" for kind, count in sorted(found.left_out.items()))
        warn(f"{found.name} has entities that are not read as walls: {what}")

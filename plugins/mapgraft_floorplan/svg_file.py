"""Plans as SVG: lines and outlines, nothing else; XML that could do harm is refused."""

from __future__ import annotations

import math
import xml.parsers.expat
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_floorplan.plan import Plan, plan_of, require_few
from mapgraft_floorplan.svg_shapes import DRAWN, Affine, affine_of, polylines
from mapgraft_floorplan.svg_viewport import Size, nested, sheet_of
from mapgraft_floorplan.units import believable, told_unit

LARGEST: Final = 128_000_000  # bytes
DEEPEST: Final = 200  # elements inside each other
_NOT_SHOWN: Final = frozenset({"defs", "symbol", "clipPath", "mask", "pattern", "marker", "text", "style", "metadata"})
_LEFT_OUT: Final = frozenset({"use", "image", "text"})


class _Group(NamedTuple):
    """An open element: how its content lies, its viewport, and whether it is shown and in a selected layer."""

    M: Affine
    size: Size
    shown: bool
    selected: bool


@dataclass(slots=True)
class _Drawing:
    """What was found so far."""

    name: str
    layers: Sequence[str] | None
    open: list[_Group] = field(default_factory=list)
    pieces: list[NDArray[np.float64]] = field(default_factory=list)
    count: int = 0
    labels: dict[str, None] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)
    unit_m: float | None = None
    doubt: str = ""

    def doctype(self, *_: object) -> None:
        raise MapError(
            f"{self.name} declares a document type, which a plan does not need and which can do harm: remove it"
        )

    def begin(self, tag: str, given: dict[str, str]) -> None:
        tag = tag.rpartition(":")[2]
        if not self.open:
            if tag != "svg":
                raise MapError(f"{self.name} is no SVG drawing: its outermost element is {tag!r}")
            M, size, self.unit_m, self.doubt = sheet_of(given, self.name)
            self.open.append(_Group(M, size, not _hidden(given), self.layers is None))
            return
        if len(self.open) >= DEEPEST:
            raise MapError(f"{self.name} has more than {DEEPEST} elements inside each other: it is no plan")
        around = self.open[-1]
        label = given.get("inkscape:label") or given.get("id") or ""
        selected = around.selected
        if tag == "g" and label:
            self.labels[label] = None
            selected = selected or any(fnmatchcase(label, wanted) for wanted in self.layers or ())
        shown = around.shown and tag not in _NOT_SHOWN and not _hidden(given)
        M, size = around.M @ affine_of(given.get("transform", ""), self.name), around.size
        if tag == "svg" and shown:
            inner, size = nested(given, around.size, self.name)
            M = M @ inner
        self.open.append(_Group(M, size, shown, selected))
        if around.shown and tag in _LEFT_OUT:
            self.left_out[tag] = self.left_out.get(tag, 0) + 1
        if shown and selected and tag in DRAWN:
            self._draw(tag, given, M)

    def end(self, _tag: str) -> None:
        self.open.pop()

    def _draw(self, tag: str, given: dict[str, str], M: Affine) -> None:
        for line in polylines(tag, given, self.name):
            with np.errstate(all="ignore"):  # what is not finite is refused with the whole plan
                ends = line @ M[:2, :2].T + M[:2, 2]
            self.pieces.append(np.hstack((ends[:-1], ends[1:])))
            self.count += len(line) - 1
        require_few(self.count, f"the plan {self.name}")


def read(
    path: str | Path,
    *,
    unit_m: float | None = None,
    layers: Sequence[str] | None = None,
    warn: Callable[[str], None] | None = None,
) -> Plan:
    """The walls in an SVG drawing: paths, lines, polylines, polygons, rectangles, circles, ellipses, with transforms.

    What is filled counts with its outline, a thick stroke with its middle. ``unit_m`` is the length of one unit of the
    drawing (of its view box); without it width, height and view box tell it where they are in mm, cm, in, pt or pc,
    unless the walls would then be no larger than paper; else the scale is unknown. Drawings inside the drawing lie as
    their view boxes say. ``layers`` are names of groups (id or
    Inkscape's label, with * and ?) whose content alone is read. Raises ConfigError when the unit is impossible,
    MapError when the file is no SVG, has a document type, no walls, or too many.
    """
    path = Path(path)
    drawing = _Drawing(path.name, [layers] if isinstance(layers, str) else layers)
    unit = told_unit(unit_m, path.name)
    _parse(path, drawing)
    if layers is not None and not drawing.pieces:
        known = ", ".join(drawing.labels) or "none"
        raise MapError(
            f"{path.name} has no walls in groups named {', '.join(drawing.layers or ())}: its groups are {known}"
        )
    segments = np.concatenate(drawing.pieces) if drawing.pieces else np.empty((0, 4))
    segments = segments * np.array([1.0, -1.0, 1.0, -1.0])  # y points down in SVG
    if drawing.left_out and warn:
        what = ", ".join(f"{count} {tag}" for tag, count in sorted(drawing.left_out.items()))
        warn(f"{path.name} has elements that are not read as walls: {what}")
    if drawing.doubt and warn:
        warn(f"{path.name}: {drawing.doubt}")
    if unit is None and drawing.unit_m is not None and len(segments):
        extent = float(np.ptp(segments.reshape(-1, 2), axis=0).max())
        unit = believable(drawing.unit_m, extent, path.name, warn) if math.isfinite(extent) else drawing.unit_m
    return plan_of(segments, unit, f"the plan {path.name}")


def _parse(path: Path, drawing: _Drawing) -> None:
    parser = xml.parsers.expat.ParserCreate()
    parser.StartDoctypeDeclHandler = drawing.doctype
    parser.EntityDeclHandler = drawing.doctype
    parser.StartElementHandler = drawing.begin
    parser.EndElementHandler = drawing.end
    try:
        if path.stat().st_size > LARGEST:
            raise MapError(f"{path.name} is too large for a plan ({path.stat().st_size} bytes): export the walls alone")
        with path.open("rb") as file:
            parser.ParseFile(file)
    except OSError as fault:
        raise MapError(f"the plan {path} cannot be read: {fault.strerror}") from fault
    except xml.parsers.expat.ExpatError as fault:
        raise MapError(f"{path.name} is no XML ({fault}): export the drawing as SVG again") from fault


def _hidden(given: dict[str, str]) -> bool:
    style = given.get("style", "").replace(" ", "")
    return (
        given.get("display") == "none"
        or given.get("visibility") in ("hidden", "collapse")
        or "display:none" in style
        or "visibility:hidden" in style
    )

"""How an SVG element's view box lies in its viewport: widths, heights, and what preserveAspectRatio says."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from mapgraft.contracts import MapError
from mapgraft_floorplan.svg_shapes import Affine

PIXEL_M: Final = 0.0254 / 96.0
_METRES: Final = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "pt": 0.0254 / 72.0, "pc": 0.0254 / 6.0, "q": 2.5e-4, "m": 1.0}
_LENGTH: Final = re.compile(r"\s*([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([a-zA-Z%]*)\s*")
_AT: Final = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
_ALIGN: Final = re.compile(r"(?:defer\s+)?x(Min|Mid|Max)Y(Min|Mid|Max)(?:\s+(meet|slice))?")
_SAME: Final = 0.01  # relative difference up to which two units are one


class Size(NamedTuple):
    """Of a viewport, in the units of what is drawn in it; NaN where the file does not tell."""

    width: float
    height: float


class Sheet(NamedTuple):
    """The outermost viewport: its ``M`` stretches one axis where the drawing asks for that, and leaves the other.

    ``unit_m`` is the length of one unit along x, None where width and height have no unit. ``doubt`` says in words what
    does not fit together, or is empty.
    """

    M: Affine
    size: Size
    unit_m: float | None
    doubt: str


def sheet_of(given: Mapping[str, str], name: str) -> Sheet:
    """That of the outermost element; raises MapError, naming the file, when its view box cannot be read."""
    lengths = [_metres(given.get(side, "")) for side in ("width", "height")]
    box = _box(given, name)
    if box is None:
        whole = Size(*(math.nan if m is None else m / PIXEL_M for m in lengths))
        return Sheet(np.eye(3), whole, None if lengths[0] is None else PIXEL_M, "")
    size = Size(box[2], box[3])
    units = [m / side for m, side in zip(lengths, size, strict=True) if m is not None]
    if not units:
        return Sheet(np.eye(3), size, None, "")
    if len(units) < 2 or abs(units[0] - units[1]) <= _SAME * max(units):
        return Sheet(np.eye(3), size, units[0], "")
    told = f"its width and height say that a unit is {units[0]:.4g} and {units[1]:.4g} m long"
    how = given.get("preserveAspectRatio", "xMidYMid").strip()
    if how == "none":
        return Sheet(
            np.diag([1.0, units[1] / units[0], 1.0]), size, units[0], f"{told}: it is stretched along one axis"
        )
    unit_m = max(units) if how.endswith("slice") else min(units)
    return Sheet(np.eye(3), size, unit_m, f"{told}: {unit_m:.4g} m is taken, as preserveAspectRatio has it")


def nested(given: Mapping[str, str], around: Size, name: str) -> tuple[Affine, Size]:
    """How the content of an inner viewport lies in what is around it; raises MapError when it cannot be read."""
    x, y = (_user(given.get(key, "0"), whole, name) for key, whole in zip("xy", around, strict=True))
    sides = [_user(given.get(key, "100%"), whole, name) for key, whole in zip(("width", "height"), around, strict=True)]
    box = _box(given, name)
    move = np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
    if box is None:
        return move, Size(*sides)
    if not all(math.isfinite(side) and side > 0.0 for side in sides):
        raise MapError(f"{name} has a drawing inside another whose size nobody tells: give it a width and a height")
    return move @ _fitted(box, Size(*sides), given.get("preserveAspectRatio", "xMidYMid").strip()), Size(box[2], box[3])


def _fitted(box: tuple[float, float, float, float], size: Size, how: str) -> Affine:
    """What brings a view box into a viewport."""
    scale = size.width / box[2], size.height / box[3]
    at = (0.0, 0.0)
    if how != "none":
        found = _ALIGN.fullmatch(how)
        one = max(scale) if found and found[3] == "slice" else min(scale)
        scale = one, one
        at = (_AT[found[1]], _AT[found[2]]) if found else (0.5, 0.5)
    x = at[0] * (size.width - box[2] * scale[0]) - box[0] * scale[0]
    y = at[1] * (size.height - box[3] * scale[1]) - box[1] * scale[1]
    return np.array([[scale[0], 0.0, x], [0.0, scale[1], y], [0.0, 0.0, 1.0]])


def _box(given: Mapping[str, str], name: str) -> tuple[float, float, float, float] | None:
    text = given.get("viewBox", "")
    if not text.strip():
        return None
    try:
        x, y, width, height = (float(value) for value in text.replace(",", " ").split())
    except ValueError:
        raise MapError(f"the view box {text[:40]!r} in {name} is no four numbers: export the drawing again") from None
    if not all(map(math.isfinite, (x, y, width, height))) or min(width, height) <= 0.0:
        raise MapError(f"the view box {text[:40]!r} in {name} has no area: export the drawing again")
    return x, y, width, height


def _metres(text: str) -> float | None:
    """A length with a unit of length; None for pixels, percents and what is no length above 0."""
    found = _LENGTH.fullmatch(text)
    if found is None or found[2].lower() not in _METRES:
        return None
    metres = _number(found[1]) * _METRES[found[2].lower()]
    return metres if math.isfinite(metres) and metres > 0.0 else None


def _user(text: str, whole: float, name: str) -> float:
    """A length in the units around: plain, in pixels, with a unit (of 96 pixels per inch), or a share of the whole."""
    found = _LENGTH.fullmatch(text)
    unit = "" if found is None else found[2].lower()
    if found is None or not (unit in ("", "px", "%") or unit in _METRES):
        raise MapError(f"the length {text[:20]!r} in {name} cannot be read: export the drawing again")
    number = _number(found[1])
    if unit == "%":
        return number / 100.0 * whole if number else 0.0
    return number * (_METRES[unit] / PIXEL_M if unit in _METRES else 1.0)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan

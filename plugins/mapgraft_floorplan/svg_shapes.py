"""The shapes of SVG as lines through points."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError

Affine = NDArray[np.float64]  # (3, 3)
Line = NDArray[np.float64]  # (k, 2)

DRAWN: Final = frozenset({"path", "line", "polyline", "polygon", "rect", "circle", "ellipse"})
_CURVE_STEPS: Final = 16
_ROUND_STEPS: Final = 48
_TOKEN: Final = re.compile(r"[A-Za-z]|[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_NUMBER: Final = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_TRANSFORM: Final = re.compile(r"[\s,]*(?:[a-zA-Z]+\s*\([^()]*\)[\s,]*)+")
_STRAIGHT: Final = frozenset("MmLlHhVvZz")


def polylines(tag: str, given: dict[str, str], name: str) -> Iterator[Line]:
    """The shape of one element; raises MapError, naming the file, when its numbers cannot be read."""
    try:
        if tag == "path":
            yield from _path(given.get("d", ""))
        elif tag == "line":
            yield np.array([[_of(given, "x1"), _of(given, "y1")], [_of(given, "x2"), _of(given, "y2")]])
        elif tag == "rect":
            x, y, w, h = (_of(given, key) for key in ("x", "y", "width", "height"))
            yield np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]])
        elif tag in ("circle", "ellipse"):
            yield _round(tag, given)
        else:
            yield from _points(given.get("points", ""), tag == "polygon")
    except (ValueError, IndexError, KeyError, TypeError, ZeroDivisionError, OverflowError) as fault:
        said = str(fault) or "no numbers where they belong"
        raise MapError(f"a {tag} in {name} cannot be read ({said}): export the drawing again") from fault


def affine_of(text: str, name: str) -> Affine:
    """The matrix of a transform attribute."""
    if not text.strip():
        return np.eye(3)
    from svgelements import Matrix

    try:
        if not _TRANSFORM.fullmatch(text):
            raise ValueError("no list of translate(…), rotate(…), …")
        m = Matrix(text)
        out = np.array([[m.a, m.c, float(m.e)], [m.b, m.d, float(m.f)], [0.0, 0.0, 1.0]], np.float64)
    except (ValueError, TypeError, IndexError, AttributeError) as fault:
        raise MapError(f"the transform {text[:40]!r} in {name} cannot be read: export the drawing again") from fault
    if not np.isfinite(out).all():
        raise MapError(f"the transform {text[:40]!r} in {name} is not finite: export the drawing again")
    return out


def _of(given: dict[str, str], key: str) -> float:
    text = given.get(key, "0").strip()
    return float(text[:-2] if text.endswith("px") else text)


def _round(tag: str, given: dict[str, str]) -> Line:
    rx, ry = (_of(given, "r"),) * 2 if tag == "circle" else (_of(given, "rx"), _of(given, "ry"))
    angle = np.linspace(0.0, 2.0 * math.pi, _ROUND_STEPS + 1)
    return np.stack((_of(given, "cx") + rx * np.cos(angle), _of(given, "cy") + ry * np.sin(angle)), axis=1)


def _points(text: str, closed: bool) -> Iterator[Line]:
    numbers = [float(token) for token in _NUMBER.findall(text)]
    line = np.array(numbers[: len(numbers) // 2 * 2]).reshape(-1, 2)
    if len(line) > 1:
        yield np.vstack((line, line[:1])) if closed else line


def _path(text: str) -> Iterator[Line]:
    tokens = _TOKEN.findall(text)
    if not tokens:
        return
    if all(token in _STRAIGHT for token in tokens if token.isalpha()):
        yield from _straight(tokens)
    else:
        yield from _curved(text)


def _straight(tokens: list[str]) -> Iterator[Line]:
    """Paths of straight pieces only, without the cost of a library that knows all."""
    at, here, start, command = 0, (0.0, 0.0), (0.0, 0.0), ""
    line: list[tuple[float, float]] = []
    while at < len(tokens):
        if tokens[at].isalpha():
            command, at = tokens[at], at + 1
            if command in "Zz":
                if len(line) > 0:
                    yield np.array([*line, start])
                line, here = [start], start
                continue
        elif command in "Zz":
            raise ValueError("numbers after the end of an outline")
        relative = command.islower()
        base = here if relative else (0.0, 0.0)
        if command in "Hh":
            here, at = (base[0] + float(tokens[at]), here[1]), at + 1
        elif command in "Vv":
            here, at = (here[0], base[1] + float(tokens[at])), at + 1
        else:
            here, at = (base[0] + float(tokens[at]), base[1] + float(tokens[at + 1])), at + 2
        if command in "Mm":
            if len(line) > 1:
                yield np.array(line)
            line, start, command = [here], here, "l" if relative else "L"
        else:
            line.append(here)
    if len(line) > 1:
        yield np.array(line)


def _curved(text: str) -> Iterator[Line]:
    from svgelements import Close, Line, Move, Path

    line: list[tuple[float, float]] = []
    for piece in Path(text):
        made: Any = piece
        if isinstance(piece, Move):
            if len(line) > 1:
                yield np.array(line)
            line = [(float(made.end.x), float(made.end.y))]
        elif isinstance(piece, Line | Close):
            if made.end is not None:
                line.append((float(made.end.x), float(made.end.y)))
        else:
            for step in range(1, _CURVE_STEPS + 1):
                point = made.point(step / _CURVE_STEPS)
                line.append((float(point.x), float(point.y)))
    if len(line) > 1:
        yield np.array(line)

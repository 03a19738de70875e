"""Ready-made maps as files: the ``yaml`` + image pair of ROS's map_server."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent

from mapgraft.contracts import ConfigError, GridMessage, MapError, Transform
from mapgraft_grid.grid_map import FREE, LARGEST_DENSE, OCCUPIED, DenseGrid
from mapgraft_grid.images import Gray, read_gray

FREE_THRESH: Final = 0.196  # below (255 - 205) / 255, so that the gray of unknown cells reads back as unknown
OCCUPIED_THRESH: Final = 0.65
UNKNOWN_GRAY: Final = 205  # what map_saver writes for unknown cells
_LARGEST_YAML: Final = 1 << 20  # bytes
_PIXELS_AT_ONCE: Final = 1_000_000
_DEEPEST: Final = 8  # levels of a description
_MOST_EVENTS: Final = 1000  # words, numbers and brackets of a description

Cells = NDArray[np.int8]  # (h, w) -1 unknown, 0 free … 100 occupied, row 0 at the bottom
Warn = Callable[[str], None]


class _Settings(NamedTuple):
    image: str
    resolution_m: float
    origin: tuple[float, float, float]  # x, y (m), yaw (rad)
    occupied: float
    free: float
    negate: bool
    mode: Literal["trinary", "scale", "raw"]


def read(
    path: str | Path, *, unknown_gray: int | None = None, warn: Warn | None = None, most_cells: int = LARGEST_DENSE
) -> GridMessage:
    """The map that a map_server ``yaml`` file describes.

    ``unknown_gray`` is the gray, as in the image, that means unknown whatever the file's thresholds say. ``warn`` is
    called with one sentence for each thing that is probably not meant. The image must lie in the yaml's folder, and is
    not looked at when it has more than ``most_cells``.
    Raises MapError when a file is missing, unreadable or impossible, ConfigError when ``unknown_gray`` is.
    """
    path = Path(path)
    settings = _settings(path)
    if unknown_gray is not None and not 0 <= unknown_gray <= 255:
        raise ConfigError(f"unknown_gray must lie in 0 … 255, found {unknown_gray}")
    gray = read_gray(_image_path(path, settings.image), min(most_cells, LARGEST_DENSE), asked_by=path.name)
    cells = _cells(gray, settings)
    lost = cells[gray.raw == UNKNOWN_GRAY]
    if unknown_gray is not None:
        cells[gray.raw == unknown_gray] = -1
    elif warn and settings.mode != "raw" and lost.size and not (lost == -1).any():
        what = "free" if lost[0] == 0 else "occupied" if lost[0] == 100 else "partly free"
        warn(
            f"{path.name} says that gray {UNKNOWN_GRAY}, which map savers write for unknown cells, is {what} "
            f"(free_thresh {settings.free}, {lost.size} cells): read it with unknown_gray: {UNKNOWN_GRAY} "
            "if it is not meant so"
        )
    return GridMessage(np.ascontiguousarray(cells[::-1]), settings.resolution_m, Transform.planar(*settings.origin))


def files(grid: DenseGrid, stem: str) -> Mapping[str, bytes]:
    """The map as ``stem.pgm`` (P5, 0 occupied, 205 unknown, 254 free, top row first) and ``stem.yaml``."""
    gray = np.full(grid.classes.shape, UNKNOWN_GRAY, np.uint8)
    gray[grid.classes == FREE] = 254
    gray[grid.classes == OCCUPIED] = 0
    height, width = grid.classes.shape
    x, y = grid.origin_m
    text = (
        f"image: {stem}.pgm\nmode: trinary\nresolution: {grid.resolution_m:.10g}\norigin: [{x:.10g}, {y:.10g}, 0]\n"
        f"negate: 0\noccupied_thresh: {OCCUPIED_THRESH}\nfree_thresh: {FREE_THRESH}\n"
    )
    return {
        f"{stem}.pgm": f"P5\n{width} {height}\n255\n".encode() + gray[::-1].tobytes(),
        f"{stem}.yaml": text.encode(),
    }


def _cells(gray: Gray, settings: _Settings) -> Cells:
    """The cells in the image's order, as map_server reads them, some rows at a time: each takes 50 bytes on the way."""
    out = np.empty(gray.levels.shape, np.int8)
    rows = max(1, _PIXELS_AT_ONCE // gray.levels.shape[1])
    for top in range(0, len(out), rows):
        part = slice(top, top + rows)
        out[part] = _cells_of(gray.levels[part], gray.opaque[part], settings)
    return out


def _cells_of(levels: NDArray[np.float64], opaque: NDArray[np.bool_], settings: _Settings) -> Cells:
    if settings.mode == "raw":
        return np.where(levels <= 100, np.round(levels), -1).astype(np.int8)
    shade = levels / 255.0
    occupancy = shade if settings.negate else 1.0 - shade
    if settings.mode == "trinary" or settings.occupied <= settings.free:
        between = np.full(levels.shape, -1.0)
    else:
        between = 1.0 + 98.0 * (occupancy - settings.free) / (settings.occupied - settings.free)
        between[~opaque] = -1.0
    out = np.where(occupancy > settings.occupied, 100.0, np.where(occupancy < settings.free, 0.0, np.floor(between)))
    return out.astype(np.int8)


def _settings(path: Path) -> _Settings:
    try:
        if path.stat().st_size > _LARGEST_YAML:
            raise MapError(f"{path.name} is too large for a map description ({path.stat().st_size} bytes)")
        data = path.read_bytes()
        _require_flat(path.name, data)
        reader = YAML(typ="safe", pure=True)
        reader.composer.warn_double_anchors = False  # YAML allows it: the last one counts
        found = reader.load(data)
    except OSError as fault:
        raise MapError(f"the map {path} cannot be read: {fault.strerror}") from fault
    except (YAMLError, ValueError) as fault:
        raise MapError(f"{path.name} is not YAML{_where(fault)}") from fault
    if not isinstance(found, dict):
        raise MapError(f"{path.name} must describe a map (image, resolution, origin, …), found {type(found).__name__}")
    missing = [name for name in ("image", "resolution", "origin") if name not in found]
    if missing:
        raise MapError(f"{path.name} does not say {', '.join(missing)}: a map needs image, resolution and origin")
    return _checked(path.name, found)


def _require_flat(name: str, data: bytes) -> None:
    """A description is a few words and numbers: what nests, or stands for more than it says, is none."""
    depth = 0
    for count, event in enumerate(YAML(typ="safe", pure=True).parse(data)):
        depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
        if depth > _DEEPEST or count > _MOST_EVENTS or isinstance(event, AliasEvent):
            raise MapError(f"{name} is no description of a map: it nests, repeats itself or is too long")


def _where(fault: Exception) -> str:
    """Where and what the fault is, in one line."""
    mark = getattr(fault, "problem_mark", None)
    at = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    return f"{at}: {getattr(fault, 'problem', None) or ' '.join(str(fault).split())}"


def _checked(name: str, found: dict[str, object]) -> _Settings:
    resolution = _number(name, "resolution", found["resolution"])
    if resolution <= 0:
        raise MapError(f"the resolution in {name} must be above 0 m per cell, found {resolution}")
    origin = found["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapError(f"the origin in {name} must be [x, y, yaw], found {reprlib.repr(origin)}")
    x, y, yaw = (_number(name, "origin", value) for value in origin)
    mode = found.get("mode", "trinary")
    if mode not in ("trinary", "scale", "raw"):
        raise MapError(f"the mode in {name} must be trinary, scale or raw, found {reprlib.repr(mode)}")
    occupied = _number(name, "occupied_thresh", found.get("occupied_thresh", OCCUPIED_THRESH))
    free = _number(name, "free_thresh", found.get("free_thresh", FREE_THRESH))
    if not 0 <= free <= occupied <= 1:
        raise MapError(f"{name} needs 0 ≤ free_thresh ≤ occupied_thresh ≤ 1, found {free} and {occupied}")
    if found.get("negate", 0) not in (0, 1):
        raise MapError(f"negate in {name} must be 0 or 1, found {reprlib.repr(found['negate'])}")
    image = found["image"]
    if not isinstance(image, str) or not image:
        raise MapError(f"the image in {name} must be a file name, found {reprlib.repr(image)}")
    return _Settings(image, resolution, (x, y, yaw), occupied, free, bool(found.get("negate", 0)), mode)


def _number(name: str, what: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise MapError(f"{what} in {name} must be a number, found {reprlib.repr(value)}")
    return float(value)


def _image_path(path: Path, image: str) -> Path:
    """The image beside the description; a path that leads out of its folder is refused."""
    folder = path.parent.resolve()
    try:
        target = (folder / image).resolve()
    except (OSError, ValueError) as fault:
        raise MapError(f"the image in {path.name} cannot be the name of a file: {fault}") from fault
    if not target.is_relative_to(folder):
        raise MapError(
            f"{path.name} names the image {image}, which lies outside its folder: copy the image beside it and write "
            f"image: {Path(image).name}"
        )
    return target

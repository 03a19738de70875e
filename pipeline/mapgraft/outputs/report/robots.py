"""The robots and their maps at the end of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.events import Event
from mapgraft.outputs.report.folder import FinishedRun
from mapgraft.outputs.report.gallery import Gallery
from mapgraft.outputs.report.paintings import fused_picture, map_picture
from mapgraft.outputs.report.pairs import PLACE, place_of
from mapgraft.outputs.report.rasters import Canvas
from mapgraft.outputs.report.scenes import Look
from mapgraft.outputs.report.words import Clock, number, short
from mapgraft.pages import Picture

_MOST_PICTURED: Final = 16  # robots
_PATH_POINTS: Final = 240


@dataclass(frozen=True, slots=True)
class RobotCard:
    """One robot. ``path`` is its way over the picture of its own map, in percent of it, for a polyline.

    ``places`` are lines from where it should look next to what is to be seen there. ``is_one_map`` says that its own
    map holds what came from others, so that there is no other picture.
    """

    name: str
    facts: Sequence[tuple[str, str]]
    own: Picture | None
    fused: Picture | None
    path: str
    undrawn: Sequence[str]
    is_one_map: bool = False
    places: Sequence[tuple[float, float, float, float]] = ()


def robot_cards(
    run: FinishedRun,
    gallery: Gallery,
    donors: dict[str, list[str]],
    attached: dict[str, list[str]],
    undecided: dict[str, list[Event]],
) -> list[RobotCard]:
    """``donors`` are those whose maps stand in a robot's map at the end, ``attached`` what came through others.

    ``undecided`` are the attempts that came to no decision, with the place that would decide.
    """
    rows = run.maps_at_the_end()
    return [
        _card(run, told, rows.get(name, {}), gallery, _Others.of(name, donors, attached, undecided), n)
        for n, (name, told) in enumerate(run.summary["robots"].items())
    ]


def corrections(decisions: Sequence[Event], clock: Clock) -> list[str]:
    """Sentences on the robots that learnt where they had been, one per robot."""
    told: dict[str, list[Event]] = {}
    for event in decisions:
        if event.kind == "corrected":
            told.setdefault(event.receiver, []).append(event)
    return [
        f"{name} learnt where it had been and mapped anew{_times(events)} at {clock.at(events[-1].stamp_ns)}: "
        f"{events[-1].reason}."
        for name, events in sorted(told.items())
    ]


def renamings(decisions: Sequence[Event], clock: Clock) -> list[str]:
    """Sentences on the robots that are other sources from some time on."""
    return [
        f"{event.receiver} at {clock.at(event.stamp_ns)}: {event.reason}."
        for event in decisions
        if event.kind == "renamed"
    ]


def _times(events: Sequence[Event]) -> str:
    return "" if len(events) == 1 else f", {len(events):,} times, the last time"


@dataclass(frozen=True, slots=True)
class _Others:
    """One robot, and what it has to do with others at the end."""

    name: str
    donors: Sequence[str]
    attached: Sequence[str]
    undecided: Sequence[Event]

    @classmethod
    def of(
        cls,
        name: str,
        donors: dict[str, list[str]],
        attached: dict[str, list[str]],
        undecided: dict[str, list[Event]],
    ) -> _Others:
        return cls(name, donors.get(name, []), attached.get(name, []), undecided.get(name, []))


def _card(
    run: FinishedRun, told: dict[str, Any], row: dict[str, Any], gallery: Gallery, others: _Others, number_of_card: int
) -> RobotCard:
    name, donors, attached = others.name, others.donors, others.attached
    way_m = _way(run.path / "trajectories" / f"{told.get('files_as', name)}.tum")
    facts = [("observations", f"{told.get('observations', 0):,}")]
    if len(way_m):
        facts.append(("path", f"{np.linalg.norm(np.diff(way_m, axis=0), axis=1).sum():,.1f} m"))
    if row:
        facts.append(("own map", f"{row['known_area_m2']:,.1f} m²"))
        if row["known_fused"] != row["known_own"]:
            facts.append(("with merges", _grown(row["known_own"], row["known_fused"])))
        resolution = "" if row["resolution_m"] is None else f", {number(row['resolution_m'])} m"
        facts.append(("map type", f"{row['map_type']}{resolution}"))
    facts.append(("merged from", ", ".join(sorted(donors)) or "nobody"))
    if attached:
        facts.append(("attached", "; ".join(sorted(attached))))
    facts += [("to decide about", f"{short(event.donor)}: {place_of(event)}") for event in others.undecided]
    has_merges = bool(donors or attached)
    if number_of_card >= _MOST_PICTURED:
        return RobotCard(name, facts, None, None, "", gallery.undrawn.get(name, ()), has_merges)
    look = gallery.last.get(name)
    own, fused, canvas = _pictures(name, look, has_merges)
    over = ("", ()) if canvas is None else (_over(canvas, way_m), [_line(canvas, one) for one in others.undecided])
    is_one_map = has_merges and fused is None
    return RobotCard(name, facts, own, fused, over[0], gallery.undrawn.get(name, ()), is_one_map, over[1])


def _grown(own: int, fused: int) -> str:
    """How much more a robot knows by its merges; types count in units of their own (cells, voxels, pieces of wall)."""
    if not own:
        return "all that is known"
    share = 100.0 * (fused - own) / own
    return f"{number(round(abs(share), 1))} % {'more' if share > 0.0 else 'less'} is known"


def _pictures(name: str, look: Look | None, has_merges: bool) -> tuple[Picture | None, Picture | None, Canvas | None]:
    own, fused = (None, None) if look is None else (look.own_raster(), look.fused_raster())
    canvas = Canvas.around(own, fused if has_merges else None)
    if canvas is None:
        return None, None, None
    mine, said = canvas.cells_of(own), short(name)
    picture = map_picture(mine, canvas.cell_m, f"{said}'s own map at the end")
    merged = None
    if has_merges and fused is not None and not (canvas.cells_of(fused) == mine).all():
        merged = fused_picture(mine, canvas.cells_of(fused), canvas.cell_m, f"{said}'s map with its merges at the end")
    return picture, merged, canvas


def _over(canvas: Canvas, way_m: NDArray[np.float64]) -> str:
    """The way in percent of the picture from its upper left corner."""
    if len(way_m) < 2:
        return ""
    step = max(1, math.ceil(len(way_m) / _PATH_POINTS))
    points = np.concatenate((way_m[::step], way_m[-1:]))
    x = 100.0 * (points[:, 0] - canvas.x_m) / (canvas.columns * canvas.cell_m)
    y = 100.0 - 100.0 * (points[:, 1] - canvas.y_m) / (canvas.rows * canvas.cell_m)
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))


def _line(canvas: Canvas, event: Event) -> tuple[float, float, float, float]:
    """From where to look to what, in percent of the picture from its upper left corner."""
    wide, high = canvas.columns * canvas.cell_m, canvas.rows * canvas.cell_m
    x0, y0, x1, y1 = (event.evidence[name] for name in PLACE)
    across = [round(100.0 * (x - canvas.x_m) / wide, 1) for x in (x0, x1)]
    down = [round(100.0 - 100.0 * (y - canvas.y_m) / high, 1) for y in (y0, y1)]
    return across[0], down[0], across[1], down[1]


def _way(path: Path) -> NDArray[np.float64]:
    """(n, 2) metres in the robot's map frame; none where the trajectory is gone."""
    if not path.is_file() or not path.stat().st_size:
        return np.zeros((0, 2))
    read: NDArray[np.float64] = np.loadtxt(path, usecols=(1, 2), ndmin=2)
    return read

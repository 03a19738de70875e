"""The pictures of the merges that the page shows, painted while the merge recording is read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from mapgraft.events import Event
from mapgraft.outputs.report.paintings import (
    Agreement,
    difference_picture,
    fused_picture,
    overlay_picture,
)
from mapgraft.outputs.report.rasters import Canvas
from mapgraft.outputs.report.scenes import Look, Moment, Scenes
from mapgraft.outputs.report.words import short
from mapgraft.pages import Picture


@dataclass(frozen=True, slots=True)
class View:
    """Two maps held against each other at one moment, and the receiver's map with its merges.

    ``title`` says when; ``holds`` names the donors of which the receiver's compared map holds something (with
    ``single_map``, which keeps no own map), ``contains`` says that this donor is one of them.
    """

    title: str
    overlay: Picture | None
    difference: Picture | None
    agreement: Agreement | None
    fused: Picture | None
    fused_title: str
    after: Picture | None = None
    after_title: str = ""
    holds: tuple[str, ...] = ()
    contains: bool = False

    @property
    def pictures(self) -> list[Picture]:
        return [p for p in (self.overlay, self.difference, self.fused, self.after) if p is not None]


@dataclass(slots=True)
class Gallery:
    """Merge id → its views, in order of time; ``undrawn`` the message types of robots that no picture shows."""

    views: dict[str, list[View]] = field(default_factory=dict)
    last: Mapping[str, Look] = field(default_factory=dict)
    undrawn: dict[str, list[str]] = field(default_factory=dict)

    def bytes_of(self, merge_id: str) -> int:
        return sum(len(picture.uri) for view in self.views.get(merge_id, ()) for picture in view.pictures)


def paint(scenes: Scenes, events: Iterable[Sequence[Event]]) -> Gallery:
    """Pictures of these merges, each given by its decisions: at the merge, and before its revert or at the end."""
    gallery = Gallery()
    made: dict[int, Event] = {}
    standing: list[Event] = []
    for decisions in events:
        merged = decisions[0]
        reverted = next((event for event in decisions if event.kind == "reverted"), None)
        made[merged.seq] = merged
        if reverted is not None:
            made[reverted.seq] = reverted
        else:
            standing.append(decisions[-1])
        gallery.views[merged.merge_id] = []
    for moment in scenes.moments(made):
        view = _merged(moment) if moment.event.kind == "merged" else _reverted(moment)
        if view.pictures:
            gallery.views[moment.event.merge_id].append(view)
    gallery.last = scenes.last
    for event in standing:
        look = gallery.last.get(event.receiver)
        if look is not None and (view := _last(event, look)).pictures:
            gallery.views[event.merge_id].append(view)
    gallery.undrawn = {robot: types for robot, look in sorted(gallery.last.items()) if (types := look.undrawn())}
    return gallery


def _merged(moment: Moment) -> View:
    """Before a merge the receiver's map is its own under every reversal, or what earlier merges have made of it."""
    return _view(moment.event, moment.before, moment.after, "at the merge", "with what came in", inside=False)


def _reverted(moment: Moment) -> View:
    event, before, after = moment.event, moment.before, moment.after
    view = _view(event, before, before, "just before it was reverted", "before the revert")
    own, fused = after.own_raster(), after.fused_raster()
    canvas = Canvas.around(before.own_raster(), before.donor_raster(event.donor), before.fused_raster())
    if canvas is None or fused is None:
        return view
    said = f"{short(event.receiver)}'s map after {short(event.merge_id)} was reverted"
    picture = fused_picture(canvas.cells_of(own), canvas.cells_of(fused), canvas.cell_m, said)
    return replace(view, after=picture, after_title="after the revert")


def _last(event: Event, look: Look) -> View:
    return _view(event, look, look, "at the end", "at the end")


def _held(event: Event, look: Look, inside: bool) -> tuple[str, ...]:
    """The donors of which the receiver's compared map holds something; ``inside`` that of the event, too."""
    if event.reversal != "single_map":
        return ()
    return tuple(short(donor) for donor in sorted(look.donors) if inside or donor != event.donor)


def _view(event: Event, compared: Look, shown: Look, when: str, which: str, *, inside: bool = True) -> View:
    """``compared`` holds the two maps that are held against each other, ``shown`` the receiver's with its merges.

    ``inside`` says that the merge stands already.
    """
    own, donor, fused = compared.own_raster(), compared.donor_raster(event.donor), shown.fused_raster()
    canvas = Canvas.around(own, donor, fused)
    if canvas is None:
        return View(when, None, None, None, None, which)
    mine, cell_m = canvas.cells_of(own), canvas.cell_m
    receiver, giver = short(event.receiver), short(event.donor)
    overlay = difference = agreement = merged = None
    if own is not None and donor is not None:
        theirs = canvas.cells_of(donor)
        overlay = overlay_picture(mine, theirs, cell_m, f"{receiver}'s map and {giver}'s on each other {when}")
        said = f"where {receiver}'s map and {giver}'s agree and contradict {when}"
        difference, agreement = difference_picture(mine, theirs, cell_m, said)
    if fused is not None:
        merged = fused_picture(mine, canvas.cells_of(fused), cell_m, f"{receiver}'s merged map {which}")
    holds = _held(event, compared, inside)
    return View(when, overlay, difference, agreement, merged, which, holds=holds, contains=giver in holds)

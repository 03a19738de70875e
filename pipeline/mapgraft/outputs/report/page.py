"""Putting the page of a run together, and writing it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any, Final

from mapgraft import __version__
from mapgraft.events import Event
from mapgraft.outputs.files import json_bytes
from mapgraft.outputs.report.folder import FinishedRun, open_run
from mapgraft.outputs.report.gallery import Gallery, paint
from mapgraft.outputs.report.merges import anchors_of, by_merge, card_of, most_telling, row_of
from mapgraft.outputs.report.paintings import DIFFERENCE, FUSED, OVERLAY, colour
from mapgraft.outputs.report.pairs import not_merged, undecided
from mapgraft.outputs.report.robots import corrections, renamings, robot_cards
from mapgraft.outputs.report.scenes import Scenes
from mapgraft.outputs.report.settings import changed, versions
from mapgraft.outputs.report.timeline import timeline
from mapgraft.outputs.report.words import Clock, count, listed, size
from mapgraft.outputs.run_folder import MERGE_RECORDING, REPORT, SUMMARY
from mapgraft.outputs.staging import Staging, writing
from mapgraft.pages import render

MOST_MERGES: Final = 40  # merges that are told with pictures and curves
MOST_BYTES: Final = 3_500_000  # of their pictures
_MOST_ROWS: Final = 2_000  # of the table of all merges


def page_of(path: Path) -> str:
    """The page of the finished run in a folder. Raises UsageError when there is none."""
    run = open_run(path)
    scenes = Scenes(run.recording)
    decisions = run.decisions()
    clock = _clock(run, decisions)
    merges = by_merge(decisions)
    anchors = anchors_of(merges)
    telling = most_telling(merges)[:MOST_MERGES]
    gallery = paint(scenes, [merges[merge_id] for merge_id in merges if merge_id in telling])
    told = _within(telling, gallery)
    events = run.events_of(told)
    return render(
        "report.html",
        version=__version__,
        name=run.recording.name.removesuffix(MERGE_RECORDING),
        clock=clock,
        lead=_lead(run, merges, clock),
        tiles=_tiles(run, merges, clock),
        shared=_shared(run),
        robots=robot_cards(run, gallery, _donors(merges), _attached(decisions), undecided(decisions)),
        remarks=[*run.summary.get("remarks", ()), *corrections(decisions, clock), *renamings(decisions, clock)],
        recordings=[_recording(row) for row in run.recordings()],
        timeline=timeline(decisions, clock, {name: f"#{anchors[name]}" for name in told}),
        cards=[card_of(events[name], anchors[name], gallery, clock) for name in told],
        rows=[row_of(merges[name], anchors[name], name in told, clock) for name in list(merges)[:_MOST_ROWS]],
        merge_count=len(merges),
        not_merged=not_merged(decisions, clock),
        changed=changed(run.mission["config"]),
        versions=list(versions(scenes.metadata, run.run_id)),
        decision_table=scenes.attached.get("decision_table.yaml", b"").decode(errors="replace"),
        legends=_LEGENDS,
        pictured=any(gallery.views.values()),
    )


def publish(path: Path, page: str, target: Path | None = None) -> Path:
    """Write a folder's page into it, or to ``target``; whole or not at all. Returns where it is.

    The ``summary.json`` of a run lists it from then on. Raises OutputError when it cannot be written.
    """
    place = path / REPORT if target is None else target
    with writing(place.parent):
        place.parent.mkdir(parents=True, exist_ok=True)
        staging = Staging(place.parent)
        staging.write(place.name, page.encode(errors="replace"))
        if target is None and (path / SUMMARY).is_file():
            summary = json.loads((path / SUMMARY).read_text(encoding="utf-8"))
            summary["files"] = sorted({*summary["files"], REPORT})
            staging.write(SUMMARY, json_bytes(summary))
        staging.publish()
    return place


_LEGENDS: Final = {
    "overlay": [
        (colour(OVERLAY, 5), "wall of the receiver only"),
        (colour(OVERLAY, 6), "wall of the donor only"),
        (colour(OVERLAY, 4), "wall of both"),
        (colour(OVERLAY, 3), "free in both"),
        (colour(OVERLAY, 1), "free, receiver only"),
        (colour(OVERLAY, 2), "free, donor only"),
    ],
    "difference": [
        (colour(DIFFERENCE, 4), "both say wall"),
        (colour(DIFFERENCE, 2), "both say free"),
        (colour(DIFFERENCE, 6), "contradiction: the donor has a wall, the receiver sees free space"),
        (colour(DIFFERENCE, 5), "contradiction: the receiver has a wall, the donor sees free space"),
        (colour(DIFFERENCE, 3), "differs by a cell at a wall of both"),
        (colour(DIFFERENCE, 1), "known to one of them only"),
    ],
    "fused": [
        (colour(FUSED, 3), "wall in its own map"),
        (colour(FUSED, 4), "wall, from others"),
        (colour(FUSED, 1), "free in its own map"),
        (colour(FUSED, 2), "free, from others"),
    ],
}


def _clock(run: FinishedRun, decisions: Sequence[Event]) -> Clock:
    robots = run.summary["robots"].values()
    stamps = [told[key] for told in robots for key in ("first_stamp_ns", "last_stamp_ns") if key in told]
    stamps += [event.stamp_ns for event in decisions]
    return Clock(min(stamps, default=0), max(stamps, default=0))


def _within(telling: Sequence[str], gallery: Gallery) -> list[str]:
    """Those whose pictures fit into the page together; the first one in any case."""
    told: list[str] = []
    total = 0
    for merge_id in telling:
        total += gallery.bytes_of(merge_id)
        if told and total > MOST_BYTES:
            break
        told.append(merge_id)
    return told


def _donors(merges: Mapping[str, Sequence[Event]]) -> dict[str, list[str]]:
    out: dict[str, list[str]] = {}
    for events in merges.values():
        if events[-1].state != "reverted":
            out.setdefault(events[-1].receiver, []).append(events[-1].donor)
    return out


def _attached(decisions: Sequence[Event]) -> dict[str, list[str]]:
    """Receiver → the donors whose layers are in its map at the end through merges of others, each with these."""
    last = {event.merge_id: event for event in decisions if event.merge_id}
    out: dict[str, list[str]] = {}
    for event in last.values():
        if event.state == "attached":
            out.setdefault(event.receiver, []).append(f"{event.donor} (by {', '.join(event.through)})")
    return out


def _lead(run: FinishedRun, merges: Mapping[str, Sequence[Event]], clock: Clock) -> str:
    robots = list(run.summary["robots"])
    replayed = f"{clock.span} of {listed(robots)} {'was' if len(robots) == 1 else 'were'} replayed."
    if not merges:
        alone = len(robots) < 2
        return f"{replayed} No merge was made{': there was only one robot.' if alone else '.'}"
    reverted = [events for events in merges.values() if events[-1].state == "reverted"]
    standing = len(merges) - len(reverted)
    left = [event.exactness for events in reverted for event in events if event.exactness is not None]
    how = " exactly" if left and all(one.exact for one in left) else ""
    made = f"{replayed} {count(len(merges), 'merge was', 'merges were')} made"
    if not reverted:
        return f"{made}; {'it stands' if standing == 1 else 'all of them stand'} at the end."
    taken = f"{len(reverted)} {'was' if len(reverted) == 1 else 'were'} found wrong and taken out again{how}"
    return f"{made}: {standing} {'stands' if standing == 1 else 'stand'} at the end, {taken}."


def _tiles(run: FinishedRun, merges: Mapping[str, Sequence[Event]], clock: Clock) -> list[tuple[str, str, str]]:
    robots, states = run.summary["robots"], [events[-1].state for events in merges.values()]
    confirmed = states.count("confirmed")
    standing = confirmed + states.count("provisional")
    sent = sum(entry["bytes"] for entry in run.summary.get("bytes", ()))
    return [
        ("robots", f"{len(robots):,}", ""),
        ("observations", f"{sum(told.get('observations', 0) for told in robots.values()):,}", ""),
        ("data time", clock.span, ""),
        ("merges standing", f"{standing:,}", f"{confirmed:,} confirmed" if standing else ""),
        ("reverted", f"{states.count('reverted'):,}", ""),
        ("exchanged", size(sent), ""),
    ]


def _shared(run: FinishedRun) -> list[str]:
    """Which robots merges connect at the end."""
    return [f"{listed(part['robots'])} share one map." for part in run.summary.get("components", ())]


def _recording(row: Mapping[str, Any]) -> dict[str, str]:
    return {"name": PurePath(row["path"]).name, "sha256": row["sha256"], "size": size(row["size_bytes"])}

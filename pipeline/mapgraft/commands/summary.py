"""What came of a run, for persons and for machines."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from mapgraft.console import cell, results
from mapgraft.events import Event, Snapshot
from mapgraft.job import Result
from mapgraft.outputs.run_folder import REPORT


def print_summary(result: Result) -> None:
    """What became of every merge, what every robot has, what was left out, and where it was written."""
    console = results()
    merges = _merges(result.events)
    for events in merges:
        _print_merge(console, events, result.start_ns)
    console.print(_robot_table(result))
    if result.kinds:
        console.print(cell(f"Sent between robots: {_kinds(result)}."))
    standing = len(result.standing)
    if not standing:
        console.print(cell(f"No merge stands at the end. {_why_not(result.events)}"))
    else:
        reverted = sum(event.kind == "reverted" for event in result.events)
        there = len(result.attached)
        through = f" {there} layer{'s' * (there != 1)} attached through other robots." if there else ""
        console.print(f"{standing} merge{'s' * (standing != 1)} standing, {reverted} reverted.{through}")
    for sentence in (*result.remarks, *result.failed, *result.lost):
        console.print(cell(sentence), style="yellow")
    for finding in result.ledgers:
        style = "green" if finding.sound else "red"
        console.print(cell(f"ledger of {finding.robot}: {finding.sentence}"), style=style)
    if result.folder:
        page = result.folder / REPORT
        console.print(cell(f"Written to {result.folder}"))
        if page.is_file():
            console.print(cell(f"To look at: {page}"))


def as_json_summary(result: Result) -> dict[str, Any]:
    """The same for machines; times in nanoseconds, transforms as x_m, y_m, yaw_rad."""
    return {
        "run_id": result.run_id,
        "folder": str(result.folder) if result.folder else None,
        "observations": result.observations,
        "lost": list(result.lost),
        "remarks": list(result.remarks),
        "failed": list(result.failed),
        "ledgers": [dataclasses.asdict(finding) for finding in result.ledgers],
        "events": dict(Counter(event.kind for event in result.events)),
        "merges": [_as_json(events) for events in _merges(result.events)],
        "standing": sorted(result.standing),
        "attached": {merge_id: list(event.through) for merge_id, event in sorted(result.attached.items())},
        "robots": {
            name: {"observations": _observations(result, snapshot), "known_area_m2": snapshot.metadata.known_area_m2}
            for name, snapshot in sorted(result.maps.items())
        },
        "bytes": [
            {"donor": donor, "receiver": receiver, "bytes": size}
            for (donor, receiver), size in sorted(result.traffic.items())
        ],
        "bytes_by_kind": [
            {"receiver": receiver, "kind": kind, "bytes": size}
            for (receiver, kind), size in sorted(result.kinds.items())
        ],
    }


def _kinds(result: Result) -> str:
    """How much there was of each kind of message, most first."""
    sums = Counter[str]()
    for (_, kind), size in result.kinds.items():
        sums[kind] += size
    return ", ".join(f"{size / 1000:,.1f} kB {kind}" for kind, size in sums.most_common())


_ROUTINE = ("verified", "updated", "disputed")


def _merges(events: Sequence[Event]) -> list[list[Event]]:
    """The events of every merge that was made, each merge's in order."""
    made = [event.merge_id for event in events if event.kind == "merged"]
    return [[event for event in events if event.merge_id == merge_id] for merge_id in made]


def _print_merge(console: Console, events: Sequence[Event], start_ns: int) -> None:
    """Two lines: which merge, when and where; and what became of it."""
    last = _decisive(events)
    T = next((event.T_receiver_donor for event in reversed(events) if event.T_receiver_donor is not None), None)
    pose = "" if T is None else f", {last.donor} at {T.x_m:z.2f} m, {T.y_m:z.2f} m, {math.degrees(T.yaw_rad):z.1f}°"
    style = {"reverted": "red", "confirmed": "green"}.get(last.state, "yellow")
    console.print(cell(f"{events[0].merge_id}  made at {_seconds(events[0].stamp_ns - start_ns)}{pose}"))
    console.print(cell(f"  {_outcome(events, start_ns)}"), style=style)


def _outcome(events: Sequence[Event], start_ns: int) -> str:
    """When somebody was sure of a merge, and when it was taken out all the same: what was confirmed is watched on."""
    last, sure = _decisive(events), [event for event in events if event.kind == "confirmed"]
    told = [f"confirmed at {_seconds(event.stamp_ns - start_ns)}{_person(event)}" for event in sure[-1:]]
    if last.state == "reverted":
        told.append(f"reverted at {_seconds(last.stamp_ns - start_ns)}: {last.reason}")
    return ", ".join(told) or "standing, not confirmed yet"


def _person(event: Event) -> str:
    return f" by {event.by}" if event.by.startswith("person") else ""


def _robot_table(result: Result) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in ("robot", "observations", "own map", "received", "merged from"):
        table.add_column(column, justify="left" if column in ("robot", "merged from") else "right")
    for name, snapshot in sorted(result.maps.items()):
        donors = [event.donor for event in result.standing.values() if event.receiver == name]
        donors += [f"({event.donor})" for event in result.attached.values() if event.receiver == name]
        received = sum(size for (_, receiver), size in result.traffic.items() if receiver == name)
        table.add_row(
            cell(name),
            f"{_observations(result, snapshot):,}",
            f"{snapshot.metadata.known_area_m2:,.0f} m²",
            f"{received / 1000:,.0f} kB",
            cell(", ".join(sorted(donors)) or "nobody"),
        )
    return table


def _observations(result: Result, snapshot: Snapshot) -> int:
    """How many a map holds: its version rises with each, and when the robot maps anew."""
    anew = sum(event.kind == "corrected" and event.receiver == snapshot.robot for event in result.events)
    return snapshot.version - anew


def _decisive(events: Sequence[Event]) -> Event:
    """The event that tells best how a merge ended: the last that is more than a measurement."""
    return next((event for event in reversed(events) if event.kind not in _ROUTINE), events[-1])


def _why_not(events: Sequence[Event]) -> str:
    """The most telling reason when nothing was merged."""
    for kind in ("reverted", "ambiguous", "unmatched", "rejected"):
        found = [event for event in events if event.kind == kind]
        if found:
            last = found[-1]
            return f"Last {kind}: {last.receiver} ← {last.donor}, {last.reason}."
    if any(event.kind == "failed" for event in events):
        return "No attempt came to its end, because plugins failed."
    return "No robot met another: with one robot, or no exchange, there is nothing to merge."


def _as_json(events: Sequence[Event]) -> dict[str, Any]:
    first, last = events[0], events[-1]
    T = last.T_receiver_donor
    return {
        "merge_id": first.merge_id,
        "receiver": first.receiver,
        "donor": first.donor,
        "stamp_ns": first.stamp_ns,
        "state": last.state,
        "reason": _decisive(events).reason,
        "T_receiver_donor": None if T is None else {"x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad},
        "events": dict(Counter(event.kind for event in events)),
    }


def _seconds(ns: int) -> str:
    return f"{ns / 1e9:.1f} s"

"""Collecting examples while robots make attempts: looks on, listens to the events, writes each one when it is whole.

An attempt that came to nothing is whole at once, a merge when it is reverted, or at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from mapgraft.contracts import MapMetadata, Match, Observation, Sample, Transform, Verdict
from mapgraft.errors import MapError, PluginError
from mapgraft.evaluation.scored import numbers_of
from mapgraft.evaluation.truth import Truth
from mapgraft.events import Event, Snapshot
from mapgraft.examples.drawn import Drawings, Drawn
from mapgraft.examples.looks import Looks
from mapgraft.examples.pairs import pair_sha256
from mapgraft.examples.pictures import DONOR, OWN, overlay_png
from mapgraft.examples.rows import picture
from mapgraft.examples.truths import Truths, Yardstick
from mapgraft.examples.window import window_of
from mapgraft.onlooker import Attempted, Encountered
from mapgraft.outputs.tables import Row
from mapgraft.procedures import Workshop

ATTEMPTED: Final = {"merged": "provisional", "ambiguous": "ambiguous", "unmatched": "unmatched"}


@dataclass(frozen=True, slots=True)
class Origin:
    """What all examples of a run have in common, and by robot the stem of its recording and its environment.

    ``sources`` tells by robot what its map is made of; empty where that is told later.
    """

    software: str
    config_sha256: str
    table_sha256: str
    recording_sha256: tuple[str, ...]
    recordings: Mapping[str, str]
    environments: Mapping[str, str]
    sources: Mapping[str, str] = field(default_factory=dict)

    def columns(self, receiver: str, donor: str) -> Row:
        return {
            "environment": both(self.environments[receiver], self.environments[donor]),
            "recording": both(self.recordings[receiver], self.recordings[donor]),
            "software": self.software,
            "config_sha256": self.config_sha256,
            "table_sha256": self.table_sha256,
            "recording_sha256": list(self.recording_sha256),
            "pair_sha256": pair_sha256(self.sources[receiver], self.sources[donor]) if self.sources else None,
        }


def both(one: str, other: str) -> str:
    """One name where both are the same, else the two joined, in order; no name has a ``+`` of its own."""
    return "+".join(sorted({name.replace("+", "_") for name in (one, other)}))


@dataclass(slots=True, eq=False)
class _Draft:
    """An example that is not whole yet: what is known of it, and how to judge where the merge stands in the end."""

    columns: dict[str, object]
    yardstick: Yardstick | None = None
    looks: Looks = field(default_factory=Looks)
    last: Event | None = None


@dataclass(slots=True)
class Collector:
    """A sink and an onlooker that makes examples of all attempts, and hands their rows to ``write``.

    ``truths`` is what is known of pairs of robots. What a map type cannot show is left out of the pictures, and told in
    ``undrawn``. ``finish`` writes the merges that stand at the end.
    """

    origin: Origin
    workshop: Workshop
    write: Callable[[Row], None]
    truths: Truths = field(default_factory=dict)
    _drawings: Drawings = field(default_factory=Drawings)
    _encountered: dict[tuple[str, str], Encountered] = field(default_factory=dict)
    _drafts: dict[str, _Draft] = field(default_factory=dict)
    _rejected: dict[tuple[str, str], str] = field(default_factory=dict)  # by which rule a pair was turned away last
    _rejections: dict[tuple[str, str], int] = field(default_factory=dict)
    _written: int = 0

    @property
    def undrawn(self) -> Sequence[str]:
        """Why there are no pictures of maps of some types, in sentences."""
        return [
            f"the examples have no pictures of maps of type {name}: {why}"
            for name, why in self._drawings.undrawn.items()
        ]

    def encountered(self, encountered: Encountered) -> None:
        self._encountered[encountered.receiver, encountered.donor] = encountered

    def attempted(self, attempted: Attempted) -> None:
        donor = attempted.donation.provenance.source
        met = self._encountered[attempted.receiver, donor]
        attempt, meeting = attempted.attempt, attempted.attempt.meeting
        own, theirs = self._own(met), self._donor(met, attempted)
        columns = self._columns_of(met, own, theirs)
        columns |= {"compared_type": meeting.map_type.name if meeting else "", **_of_matches(attempted)}
        match, yardstick = attempt.match, self._yardstick(met, attempted)
        if own and theirs and match is not None:
            columns |= _of_window(own, theirs, match)
        if yardstick is not None:
            T, scale = (None, 1.0) if match is None else (match.T_receiver_donor, match.scale)
            columns |= yardstick.columns(T, scale)
        self._drafts[attempted.merge_id] = _Draft(columns, yardstick)

    def measured(self, merge_id: str, sample: Sample, verdict: Verdict | None) -> None:
        if (draft := self._drafts.get(merge_id)) is not None:
            draft.looks.add(sample, verdict)

    def observed(self, observation: Observation) -> None:
        """Nothing: examples are of attempts."""

    def mapped(self, snapshot: Snapshot) -> None:
        """Nothing: what an attempt saw was drawn when it was made."""

    def happened(self, event: Event) -> None:
        pair = (event.receiver, event.donor)
        if event.kind == "rejected":
            self._reject(event)
        elif event.kind in ATTEMPTED:
            self._rejected.pop(pair, None)
            draft = self._drafts.get(event.merge_id) or self._without_attempt(event)
            draft.columns |= {"verdict": ATTEMPTED[event.kind], **_of_event(event)}
            self._told(draft, event)
        elif (merge := self._drafts.get(event.merge_id)) is not None and event.kind != "failed":
            self._told(merge, event)

    def finish(self) -> None:
        """Write the merges that still stand."""
        for merge_id in list(self._drafts):
            draft = self._drafts.pop(merge_id)
            if draft.last is not None:
                self._write(draft)

    def _told(self, draft: _Draft, event: Event) -> None:
        """Note what has become of an attempt; what nothing more can happen to is written."""
        draft.last = event
        if event.state not in ("provisional", "confirmed"):
            self._drafts.pop(event.merge_id, None)
            self._write(draft)

    def _write(self, draft: _Draft) -> None:
        columns, last = draft.columns, draft.last
        if last is not None and last.state != "candidate" and last.merge_id:
            T = last.T_receiver_donor
            columns |= {"state": last.state, "state_reason": last.reason, **draft.looks.columns()}
            columns["T_final"] = None if T is None else T.matrix
            if draft.yardstick is not None and T is not None:
                columns["truth_final"] = draft.yardstick.word(T, last.scale)
        self.write({**columns, "position": self._written})
        self._written += 1

    def _reject(self, event: Event) -> None:
        """One example for all the times in a row that a pair was turned away by the same rule."""
        pair = (event.receiver, event.donor)
        if self._rejected.get(pair) == event.rule:
            return
        self._rejected[pair] = event.rule
        number = self._rejections[pair] = self._rejections.get(pair, 0) + 1
        met = self._encountered.get(pair)
        columns = self.origin.columns(*pair) if met is None else self._columns_of(met, self._own(met), None)
        example_id = f"{event.receiver}.{event.donor}.{number}x"  # no merge has such an id: those end in a digit
        told = {"verdict": "rejected", **_of_event(event), "example_id": example_id, "merge_id": None}
        self._write(_Draft({**columns, **told}))

    def _without_attempt(self, event: Event) -> _Draft:
        """What is known of an attempt that came to nothing before there was anything to match."""
        met = self._encountered.get((event.receiver, event.donor))
        if met is None:
            return _Draft(dict(self.origin.columns(event.receiver, event.donor)))
        return _Draft(self._columns_of(met, self._own(met), None))

    def _columns_of(self, met: Encountered, own: Drawn | None, theirs: Drawn | None) -> dict[str, object]:
        return {
            **self.origin.columns(met.receiver, met.donor),
            **_of_metadata(met.own, met.other),
            **({} if own is None else own.columns("own")),
            **({} if theirs is None else theirs.columns("donor")),
        }

    def _own(self, met: Encountered) -> Drawn | None:
        key = ("own", met.receiver, met.reversal.version, *_marks(met.own))
        return self._drawings.of(key, OWN, met.map_type, met.reversal.own)

    def _donor(self, met: Encountered, attempted: Attempted) -> Drawn | None:
        layer, meeting = attempted.donation.layer, attempted.attempt.meeting
        key = ("donor", *attempted.donation.provenance, *_marks(met.other))
        if meeting is not None and meeting.map_type.name == layer.map_type:
            return self._drawings.of(key, DONOR, meeting.map_type, lambda: meeting.source)
        map_type = self.workshop.map_type(layer.map_type)
        return self._drawings.of(key, DONOR, map_type, lambda: map_type.view(layer))

    def _yardstick(self, met: Encountered, attempted: Attempted) -> Yardstick | None:
        known, meeting = self.truths.get((met.receiver, met.donor)), attempted.attempt.meeting
        if known is None or known.T_receiver_donor is None:
            return None if known is None else Yardstick.of(known, None)
        if known.truth is not None or meeting is None:
            return None if known.truth is None else Yardstick.of(known, known.truth)
        try:
            truth = Truth.of(meeting.map_type, meeting.target, meeting.donor_layer, known.T_receiver_donor, known.scale)
        except (MapError, PluginError):  # what fails there fails in the run, too, which tells of it
            return None
        return Yardstick.of(known, truth)


def _marks(metadata: MapMetadata) -> tuple[Hashable, ...]:
    """By which a map is told from other versions of it."""
    return metadata.type, metadata.bounds_m, metadata.known_area_m2, metadata.observations


def _of_metadata(own: MapMetadata, other: MapMetadata) -> Row:
    ratio = own.resolution_m / other.resolution_m if own.resolution_m and other.resolution_m else None
    return {
        "receiver_type": own.type,
        "donor_type": other.type,
        "receiver_resolution_m": own.resolution_m,
        "donor_resolution_m": other.resolution_m,
        "resolution_ratio": ratio,
        "receiver_quality": own.quality,
        "donor_quality": other.quality,
        "receiver_area_m2": own.known_area_m2,
        "donor_area_m2": other.known_area_m2,
    }


def _of_matches(attempted: Attempted) -> Row:
    """All hypotheses, which of them was judged, and everything that was told or measured of those that were shown."""
    attempt = attempted.attempt
    numbers = {
        _place_of(shown.match, attempt.found): numbers_of(shown.match, shown.measurements)
        for shown in attempt.candidates
    }
    chosen = None if attempt.match is None else _place_of(attempt.match, attempt.found)
    told = {} if attempt.match is None else numbers_of(attempt.match, {m.name: m for m in attempt.measurements})
    return {
        "hypotheses": [
            {**_pose(match.T_receiver_donor), "scale": match.scale, "score": match.score} for match in attempt.found
        ],
        "chosen": chosen,
        "evidence": told,
        "rivals": [
            {"hypothesis": place, "name": name, "value": value}
            for place, of_one in numbers.items()
            if place != chosen
            for name, value in of_one.items()
        ],
    }


def _place_of(match: Match, found: Sequence[Match]) -> int | None:
    """Which of the found hypotheses it is; the margins of those that are left without others are new."""
    return next((n for n, one in enumerate(found) if one.T_receiver_donor is match.T_receiver_donor), None)


def _of_window(own: Drawn, theirs: Drawn, match: Match) -> Row:
    window = window_of(own.raster, theirs.raster, match.T_receiver_donor, match.scale)
    return {
        "overlap": window.overlap,
        "overlay_picture": picture(overlay_png(window.fine_own, window.fine_donor)),
        "classes_own": window.own.reshape(-1),
        "classes_donor": window.donor.reshape(-1),
        "window_px_w": window.canvas.columns,
        "window_px_h": window.canvas.rows,
        "window_px_m": window.canvas.cell_m,
        "window_x_m": window.canvas.x_m,
        "window_y_m": window.canvas.y_m,
    }


def _of_event(event: Event) -> Row:
    """What the event tells of the attempt."""
    T = event.T_receiver_donor
    return {
        "example_id": event.merge_id,
        "merge_id": event.merge_id,
        "seq": event.seq,
        "stamp": event.stamp_ns,
        "receiver": event.receiver,
        "donor": event.donor,
        "receiver_version": event.receiver_version,
        "donor_version": event.donor_version,
        "reversal": event.reversal,
        "rule": event.rule,
        "matcher": event.matcher,
        "acceptor": event.by if event.kind in ATTEMPTED else "",
        "fuser": event.fuser,
        "verifier": event.verifier,
        "reason": event.reason,
        "T_receiver_donor": None if T is None else T.matrix,
        **_pose(T),
        "scale": event.scale,
        "covariance": event.covariance,
        "score": event.score,
        "margin": event.margin,
    }


def _pose(T: Transform | None) -> Row:
    if T is None:
        return {"x_m": None, "y_m": None, "yaw_rad": None}
    return {"x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad}

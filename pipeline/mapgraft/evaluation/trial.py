"""One procedure on one pair: decide, match, accept, map on, verify; what ``run`` does, by the same engine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Literal, NamedTuple

from mapgraft.config import ReversalName
from mapgraft.contracts import MapType, Match, Measurement, Observation, Transform
from mapgraft.decision import DecisionTable
from mapgraft.errors import PluginError
from mapgraft.evaluation.building import DONOR, RECEIVER, Pair
from mapgraft.events import Event
from mapgraft.history import History, Journal
from mapgraft.outputs.null_sink import NullSink
from mapgraft.persons import Hand
from mapgraft.procedures import Workshop
from mapgraft.reversal import new_reversal
from mapgraft.robot import Robot
from mapgraft.witness import Witness

if TYPE_CHECKING:
    from mapgraft.examples.collecting import Collector

Verdict = Literal["rejected", "unmatched", "ambiguous", "provisional"]


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """What came of it.

    ``best`` is the matcher's first hypothesis with its ``measurements``; ``T_accepted`` the transform that was accepted
    and ``T_final`` the one at which the merge stands after further mapping, or was reverted, both with ``scale``.
    ``state`` is the merge's state then, with ``later``, the last measurements; empty where nothing was accepted.
    ``match_s`` is None where the decision table turned the pair away. ``observed_s`` is what each further scan took
    with the merge standing, ``searched_s`` what of that were searches for a better transform, 0 for most scans, and
    ``final_s`` what the last look took, None where nothing was merged.
    """

    rule: str
    verdict: Verdict
    reason: str
    best: Match | None
    measurements: Mapping[str, Measurement]
    T_accepted: Transform | None
    state: Literal["", "provisional", "confirmed", "reverted"]
    state_reason: str
    T_final: Transform | None
    scale: float
    later: Mapping[str, Measurement]
    match_s: float | None
    observed_s: tuple[float, ...]
    searched_s: tuple[float, ...]
    final_s: float | None


def offering(pair: Pair, table: DecisionTable, workshop: Workshop) -> Robot:
    """The donor of a pair as a robot that has mapped its window."""
    return _robot(DONOR, pair.donor.map_type, table, workshop, "ledger", History(NullSink()), pair.donor.observations)


def attempt(
    pair: Pair,
    donor: Robot,
    table: DecisionTable,
    workshop: Workshop,
    reversal: ReversalName,
    collector: Collector | None = None,
) -> Trial:
    """Let the receiver consider the donor's map, map on, and verify; a ``collector`` looks on.

    Raises PluginError, which names the pair, when a plugin fails: a run goes on without it, a judgement does not.
    """
    witness, history = Witness(), History(collector or NullSink())
    if collector is not None:
        history.onlookers.append(collector)
    workshop.watch = witness.watch
    try:
        side = pair.receiver
        receiver = _robot(RECEIVER, side.map_type, table, workshop, reversal, history, side.observations)
        stamp_ns = side.observations[-1].stamp_ns
        offer = donor.offer()
        if receiver.wants(offer, len(offer), stamp_ns):
            receiver.consider(offer, donor.layer(), stamp_ns)
        attempted = history.events[-1]
        took = _map_on(receiver, pair.further, witness) if receiver.merges else _Took()
        _require_no_failure(history.events)
    except PluginError as error:
        raise PluginError(f"pair {pair.plan.number}: {error}") from error
    finally:
        workshop.watch = None
    return _told(witness, history.events, attempted, took)


def _robot(
    name: str,
    map_type: MapType,
    table: DecisionTable,
    workshop: Workshop,
    reversal_name: ReversalName,
    history: History,
    observations: Sequence[Observation],
) -> Robot:
    reversal = new_reversal(reversal_name, map_type)
    journal = Journal(history, name, map_type, reversal, snapshots=False)
    robot = Robot(name, map_type, reversal, table, workshop, Hand(), journal)
    for observation in observations:
        robot.observe(observation)
    _require_no_failure(history.events)
    return robot


def _require_no_failure(events: Sequence[Event]) -> None:
    failed = next((event for event in events if event.kind == "failed"), None)
    if failed is not None:
        raise PluginError(f"rule {failed.rule!r}: {failed.reason}" if failed.rule else failed.reason)


class _Took(NamedTuple):
    """Seconds: of each further scan, of the searches in it, and of the last look."""

    observed_s: tuple[float, ...] = ()
    searched_s: tuple[float, ...] = ()
    final_s: float | None = None


def _map_on(receiver: Robot, further: Sequence[Observation], witness: Witness) -> _Took:
    """Observe further scans, verifying as they come, and take a last look."""
    if not further:
        return _Took()
    observed_s, searched_s = [], []
    for observation in further:
        began_s, before_s = perf_counter(), witness.around_prior_s
        receiver.observe(observation)
        observed_s.append(perf_counter() - began_s)
        searched_s.append(witness.around_prior_s - before_s)
    began_s = perf_counter()
    receiver.finish(further[-1].stamp_ns)
    return _Took(tuple(observed_s), tuple(searched_s), perf_counter() - began_s)


def _told(witness: Witness, events: Sequence[Event], attempted: Event, took: _Took) -> Trial:
    verdicts: dict[str, Verdict] = {"rejected": "rejected", "unmatched": "unmatched", "ambiguous": "ambiguous"}
    merged = next((event for event in events if event.kind == "merged"), None)
    first = merged or attempted
    last = next((event for event in reversed(events) if merged and event.merge_id == merged.merge_id), None)
    later = next((event for event in reversed(events) if event.measurements and event is not merged), None)
    found = witness.found[0] if witness.found else ()
    shown = witness.candidates[0] if witness.candidates else ()
    best = shown[0].match if shown else found[0] if found else None
    return Trial(
        rule=first.rule,
        verdict="provisional" if merged else verdicts[first.kind],
        reason=first.reason,
        best=best,
        measurements=shown[0].measurements if shown else {},
        T_accepted=merged.T_receiver_donor if merged else None,
        state=_state(last),
        state_reason=last.reason if last else "",
        T_final=last.T_receiver_donor if last else None,
        scale=merged.scale if merged else 1.0,
        later={m.name: m for m in later.measurements} if merged and later else {},
        match_s=witness.match_s[0] if witness.match_s else None,
        **took._asdict(),
    )


def _state(last: Event | None) -> Literal["", "provisional", "confirmed", "reverted"]:
    if last is None or last.state == "candidate" or last.state == "attached" or last.state == "detached":
        return ""
    return last.state

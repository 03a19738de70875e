"""An event as a ``mapgraft_msgs/msg/MergeEvent`` and back; and as a line of a log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from mapgraft.contracts import Exactness, Measurement, Transform
from mapgraft.events import Event, Kind
from mapgraft.outputs.cdr import CdrWriter

DEBUG, INFO, WARN, ERROR = 10, 20, 30, 40  # levels of rcl_interfaces/msg/Log

_LEVELS: Mapping[Kind, int] = {
    "offered": DEBUG,
    "verified": DEBUG,
    "ambiguous": WARN,
    "reverted": WARN,
    "detached": WARN,
    "disputed": WARN,
    "disbelieved": WARN,
    "failed": ERROR,
}
_PLAIN = (
    *("kind", "receiver", "donor", "merge_id", "state", "reason", "by", "rule", "matcher", "fuser", "verifier"),
    *("reversal", "seq", "scale", "hypotheses", "donor_epoch", "donor_version", "receiver_version", "bytes_received"),
)
_NAN = math.nan


def encode_event(event: Event, frame_id: str) -> bytes:
    """CDR of the message; its fields in the order of ``MergeEvent.msg``."""
    out, T = CdrWriter(), event.T_receiver_donor
    out.stamp(event.stamp_ns)
    out.text(frame_id)
    out.wide("<q", event.seq)
    for text in (event.kind, event.receiver, event.donor, event.merge_id, event.state, event.reason, event.by):
        out.text(text)
    for text in (event.rule, event.matcher, event.fuser, event.verifier, event.reversal):
        out.text(text)
    out.numbers(None if T is None else T.matrix)
    x_m, y_m, yaw_rad = (_NAN, _NAN, _NAN) if T is None else (T.x_m, T.y_m, T.yaw_rad)
    out.wide("<4d", x_m, y_m, yaw_rad, event.scale)
    out.numbers(event.covariance)
    out.wide("<2d", _NAN if event.score is None else event.score, _NAN if event.margin is None else event.margin)
    out.wide("<4q", event.hypotheses, event.donor_epoch, event.donor_version, event.receiver_version)
    out.wide("<q", event.bytes_received)
    out.integers("<I", len(event.measurements))
    for measurement in event.measurements:
        _measurement(out, measurement)
    _pairs(out, event.evidence)
    out.integers("<I", 0 if event.exactness is None else 1)
    if event.exactness is not None:
        _exactness(out, event.exactness)
    out.integers("<I", len(event.through))
    for merge_id in event.through:
        out.text(merge_id)
    return out.finish()


def encode_log(event: Event, logger: str) -> bytes:
    """CDR of the ``rcl_interfaces/msg/Log`` that tells the event to a person."""
    out = CdrWriter()
    out.stamp(event.stamp_ns)
    out.flag_byte(_LEVELS.get(event.kind, INFO))
    for text in (logger, sentence(event), "", event.kind):
        out.text(text)
    out.integers("<I", 0)
    return out.finish()


def event_of(message: Any) -> Event:
    """The event in a decoded message; equal to the one that was written, bit for bit."""
    stamp, matrix = message.header.stamp, np.array(message.t_receiver_donor)
    return Event(
        **{name: getattr(message, name) for name in _PLAIN},
        stamp_ns=stamp.sec * 1_000_000_000 + stamp.nanosec,
        T_receiver_donor=Transform(matrix.reshape(4, 4)) if len(matrix) else None,
        covariance=np.array(message.covariance).reshape(6, 6) if len(message.covariance) else None,
        score=_number(message.score),
        margin=_number(message.margin),
        measurements=tuple(_measurement_of(m) for m in message.measurements),
        evidence={pair.name: pair.value for pair in message.evidence},
        exactness=_exactness_of(message.exactness[0]) if message.exactness else None,
        through=tuple(message.through),
    )


def sentence(event: Event) -> str:
    """What happened, for a person who reads a log: who, what, where, why."""
    T = event.T_receiver_donor
    where = "" if T is None else f" at x={T.x_m:z.2f} m, y={T.y_m:z.2f} m, yaw={math.degrees(T.yaw_rad):z.1f}°"
    name = event.merge_id or (f"{event.receiver}.{event.donor}" if event.donor else event.receiver)
    return f"{name} {event.kind}{where}" + (f": {event.reason}" if event.reason else "")


def _measurement(out: CdrWriter, m: Measurement) -> None:
    out.text(m.name)
    out.wide("<d", m.value)
    out.text(m.unit)
    out.wide("<q", m.support)
    out.text(m.better)
    _pairs(out, m.details)


def _measurement_of(m: Any) -> Measurement:
    better: Literal["higher", "lower"] = "higher" if m.better == "higher" else "lower"
    return Measurement(m.name, m.value, m.unit, m.support, better, {pair.name: pair.value for pair in m.details})


def _exactness(out: CdrWriter, e: Exactness) -> None:
    out.flag_byte(e.exact)
    out.wide("<3q", e.cells_reset, e.cells_contaminated, e.cells_lost)
    out.text(e.reason)


def _exactness_of(e: Any) -> Exactness:
    return Exactness(bool(e.exact), e.cells_reset, e.cells_contaminated, e.cells_lost, e.reason)


def _pairs(out: CdrWriter, numbers: Mapping[str, float]) -> None:
    out.integers("<I", len(numbers))
    for name, value in numbers.items():
        out.text(name)
        out.wide("<d", value)


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value

"""Events in CDR: what is read back is the event, bit for bit."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mapgraft.contracts import Exactness, Measurement, Transform
from mapgraft.events import Event
from mapgraft.outputs.event_message import encode_event, encode_log, event_of, sentence
from mapgraft.outputs.messages import LOG_TYPE, MERGE_EVENT, MessageEncoder

ENCODER = MessageEncoder()
STORE = get_typestore(Stores.EMPTY)  # knows what the file says and nothing else
STORE.register(get_types_from_msg(ENCODER.definition(MERGE_EVENT), MERGE_EVENT))
STEADY = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
TEXT = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=12)
NUMBER = st.floats(allow_nan=False)
COUNT = st.integers(-(2**63), 2**63 - 1)
PAIRS = st.dictionaries(TEXT, NUMBER, max_size=3)
MEASUREMENTS = st.builds(Measurement, TEXT, NUMBER, TEXT, COUNT, st.sampled_from(["higher", "lower"]), PAIRS)
EVENTS = st.builds(
    Event,
    seq=COUNT,
    stamp_ns=st.integers(0, 2**31 * 10**9 - 1),
    kind=st.sampled_from(["offered", "merged", "reverted"]),
    receiver=TEXT,
    donor=TEXT,
    merge_id=TEXT,
    state=st.sampled_from(["", "provisional"]),
    reason=TEXT,
    by=TEXT,
    rule=TEXT,
    matcher=TEXT,
    fuser=TEXT,
    verifier=TEXT,
    reversal=TEXT,
    T_receiver_donor=st.none() | st.builds(Transform.planar, *[st.floats(-99, 99)] * 3),
    scale=NUMBER,
    covariance=st.none() | st.builds(lambda v: np.arange(36.0).reshape(6, 6) * v, st.floats(-9, 9)),
    score=st.none() | NUMBER,
    margin=st.none() | NUMBER,
    hypotheses=COUNT,
    donor_epoch=COUNT,
    donor_version=COUNT,
    receiver_version=COUNT,
    bytes_received=COUNT,
    measurements=st.lists(MEASUREMENTS, max_size=3).map(tuple),
    evidence=PAIRS,
    exactness=st.none() | st.builds(Exactness, st.booleans(), COUNT, COUNT, COUNT, TEXT),
)


def same(a: Event, b: Event) -> bool:
    plain = [name for name in Event.__slots__ if name != "covariance"]
    assert {name: getattr(a, name) for name in plain} == {name: getattr(b, name) for name in plain}
    return (a.covariance is None) == (b.covariance is None) and np.array_equal(
        np.zeros(0) if a.covariance is None else a.covariance, np.zeros(0) if b.covariance is None else b.covariance
    )


@STEADY
@given(EVENTS, TEXT)
def test_an_event_is_read_back_as_it_was_and_rosbags_writes_the_same_bytes(event: Event, frame: str) -> None:
    data = encode_event(event, frame)
    message = STORE.deserialize_cdr(data, MERGE_EVENT)
    assert same(event_of(message), event)
    assert bytes(STORE.serialize_cdr(message, MERGE_EVENT, little_endian=True)) == data


@STEADY
@given(EVENTS)
def test_the_line_of_the_log_is_a_log_message(event: Event) -> None:
    data = encode_log(event, "mapgraft.a")
    message = ENCODER.decode(LOG_TYPE, data)
    assert (message.name, message.msg) == ("mapgraft.a", sentence(event))
    assert message.stamp.sec * 10**9 + message.stamp.nanosec == event.stamp_ns
    fields = {"level": message.level, "name": message.name, "msg": message.msg, "function": message.function}
    assert ENCODER.encode(LOG_TYPE, fields, event.stamp_ns, "") == data


def test_nan_in_a_measurement_survives_and_missing_numbers_are_none() -> None:
    event = Event(0, 0, "verified", "a", "b", measurements=(Measurement("m", math.nan, "1", 0, "lower"),))
    again = event_of(ENCODER.decode(MERGE_EVENT, encode_event(event, "a/map")))
    assert math.isnan(again.measurements[0].value)
    assert again.score is None and again.margin is None and again.T_receiver_donor is None


def test_a_sentence_says_who_what_where_and_why() -> None:
    event = Event(3, 0, "reverted", "a", "b", "a.b.1", reason="too far", T_receiver_donor=Transform.planar(1, 2, 0.5))
    assert sentence(event) == "a.b.1 reverted at x=1.00 m, y=2.00 m, yaw=28.6°: too far"
    assert sentence(Event(0, 0, "offered", "a", "b")) == "a.b offered"

"""The fast ways to a laser scan give bit for bit what rosbags gives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mapgraft.contracts.sources import ScanMessage, SchemaText
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.mcap_file import McapSource
from mapgraft.recording.decoding.codecs import RosCodec, codec_for

THOROUGH = settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

FLOAT32 = st.floats(width=32)
SCAN = st.fixed_dictionaries(
    {
        "stamp_ns": st.integers(0, 2**31 * 10**9 - 1),
        "ranges": arrays.arrays(np.float32, st.integers(0, 9), elements=FLOAT32),
        "frame": st.sampled_from(["", "l", "laser", "/laser", "läser", "base_link_of_a_robot"]),
        "angle_min": FLOAT32,
        "angle_increment": FLOAT32,
        "time_increment": FLOAT32,
        "range_min": FLOAT32,
        "range_max": FLOAT32,
        "intensities": arrays.arrays(np.float32, st.sampled_from([0, 3, 9]), elements=FLOAT32),
    }
)


def same_bits(scan: ScanMessage, message: Any) -> bool:
    """Whether a scan holds what rosbags decoded, NaN and all."""
    stamp = message.header.stamp
    numbers = [message.angle_min, message.angle_increment, message.time_increment, message.range_min, message.range_max]
    return (
        scan.stamp_ns == stamp.sec * 10**9 + stamp.nanosec
        and scan.frame_id == message.header.frame_id.removeprefix("/")
        and np.array(scan[2:7]).tobytes() == np.array(numbers).tobytes()
        and scan.ranges_m.dtype == np.float32
        and scan.ranges_m.tobytes() == message.ranges.tobytes()
    )


@pytest.fixture(params=["cdr", "ros1"])
def scans(request: Any, ros1_scans: Any, ros2_scans: Any) -> Any:
    return ros1_scans if request.param == "ros1" else ros2_scans


@THOROUGH
@given(many=st.lists(SCAN, min_size=1, max_size=12))
def test_message_by_message(scans: Any, many: list[dict[str, Any]]) -> None:
    codec = codec_for("ros1" if scans.ros == 1 else "cdr", SchemaText(*scans.schema))
    assert isinstance(codec, RosCodec)
    assert codec.is_plain_scan
    for fields in many:
        data = scans.encoded(scans.message(**fields))
        assert same_bits(codec.decode_scan(data), codec.decode(data))


@THOROUGH
@given(many=st.lists(SCAN, min_size=1, max_size=9), alike=st.booleans(), mixed=st.booleans())
def test_chunk_by_chunk(write_mcap: Any, scans: Any, many: list[dict[str, Any]], alike: bool, mixed: bool) -> None:
    """All scans of a chunk at once, alike or not, evenly spaced or not: the same as one by one."""
    if alike:
        shape = {name: many[0][name] for name in ("frame", "ranges", "intensities")}
        many = [{**fields, **shape, "ranges": np.roll(shape["ranges"], n)} for n, fields in enumerate(many)]
    base = scans.sample(0)
    chunk = []
    for n, fields in enumerate(many):
        chunk.append(base._replace(log_ns=n, data=scans.encoded(scans.message(**fields))))
        if mixed and n % 2:
            chunk.append(scans.sample(n, "/other", beams=n))
    source = McapSource(write_mcap([chunk], profile=""))
    found = [recorded.scan for recorded in source.scans(["/scan"])]
    messages = list(source.messages(["/scan"]))
    assert len(found) == len(many) == len(messages)
    assert all(same_bits(scan, source.decode(raw)) for scan, raw in zip(found, messages, strict=True))
    assert all(same_bits(source.decode_scan(raw), source.decode(raw)) for raw in messages)


def test_big_endian_scans(write_mcap: Any, ros2_scans: Any) -> None:
    message = ros2_scans.message(9, [1.0, 2.0, np.nan])
    chunk = [
        ros2_scans.sample(n)._replace(data=ros2_scans.encoded(message, little_endian=little))
        for n, little in enumerate([True, False, True])
    ]
    source = McapSource(write_mcap([chunk]))
    scans = [recorded.scan for recorded in source.scans()]
    little = source.decode(next(source.messages()))
    assert len(scans) == 3
    assert all(same_bits(scan, little) and scan.ranges_m.dtype.isnative for scan in scans)


@THOROUGH
@given(data=st.binary(max_size=200), cut=st.integers(0, 120))
def test_bytes_that_are_no_scan(scans: Any, data: bytes, cut: int) -> None:
    """Anything may come; it decodes as rosbags decodes it, or raises RecordingError as rosbags raises its own."""
    codec = codec_for("ros1" if scans.ros == 1 else "cdr", SchemaText(*scans.schema))
    assert isinstance(codec, RosCodec)
    whole = scans.encoded(scans.message(3, [1.0, 2.0]))
    codec.decode_scan(whole)
    for broken in (data, whole[:cut], whole[:cut] + data):
        try:
            message = codec.decode(broken)
        except RecordingError:
            with pytest.raises(RecordingError):
                codec.decode_scan(broken)
        else:
            assert same_bits(codec.decode_scan(broken), message)

"""CARMEN logs, real and made."""

from __future__ import annotations

import gzip
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mapgraft.contracts.sources import Fault
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.carmen_file import CarmenSource
from mapgraft.recording.containers.carmen_lines import CarmenOdometry, CarmenScan, beam_angles
from mapgraft.recording.decoding.poses import poses_of
from mapgraft.recording.decoding.scans import scan_payload

THOROUGH = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def causes(source: CarmenSource) -> dict[str, int]:
    return {fault.cause: fault.count for fault in source.faults}


def flaser(stamp: object, ranges: Any = (1.0, 2.0), pose: str = "1 2 0.5", keyword: str = "FLASER") -> str:
    values = " ".join(f"{value:g}" for value in ranges)
    return f"{keyword} {len(ranges)} {values} {pose} 3 4 0.25 {stamp} robot {stamp}"


def odom(stamp: object) -> str:
    return f"ODOM 3 4 0.25 0.1 0.2 0 {stamp} robot {stamp}"


@pytest.fixture
def log(tmp_path: Path) -> Any:
    """``log(*lines)``: a source of a log with these lines."""

    def write(*lines: str, name: str = "made.log") -> CarmenSource:
        (tmp_path / name).write_text("\n".join(lines) + "\n")
        return CarmenSource(tmp_path / name)

    return write


@pytest.mark.parametrize(
    ("beams", "first_deg", "last_deg"),
    [
        (180, -90, 89),
        (181, -90, 90),
        (360, -90, 89.5),
        (361, -90, 90),
        (401, -50, 50),
        (400, -50, 49.75),
        (1, -90, -90),
    ],
)
def test_beams_of_a_laser_known_by_its_count(beams: int, first_deg: float, last_deg: float) -> None:
    start, step = beam_angles(beams)
    assert math.degrees(start) == pytest.approx(first_deg)
    assert math.degrees(start + (beams - 1) * step) == pytest.approx(last_deg)


def test_every_kind_of_line(log: Any) -> None:
    robotlaser = "ROBOTLASER1 0 -1.0 2.0 0.5 30.0 0.01 0 3 1.5 2.5 30.0 1 0.7 1 2 0.5 3 4 0.25 0.1 0.2 0.5 0.3 9 3 r 3"
    source = log(
        "# a comment",
        "PARAM robot_use_laser on nohost 0",
        odom(1),
        flaser(2),
        robotlaser,
        flaser(4, keyword="RLASER"),
        "TRUEPOS 7 8 0.5 3 4 0.25 5 r 5",
        "LASER_READING 2 1.0 2.0 1 2 0.5 6",
        "NEFF 30",
    )
    assert [(c.topic, c.message_type, c.encoding, c.count) for c in source.channels] == [
        ("FLASER", "carmen/msg/LaserScan", "carmen", 1),
        ("LASER_READING", "carmen/msg/LaserScan", "carmen", 1),
        ("ODOM", "carmen/msg/Odometry", "carmen", 1),
        ("RLASER", "carmen/msg/LaserScan", "carmen", 1),
        ("ROBOTLASER1", "carmen/msg/LaserScan", "carmen", 1),
        ("TRUEPOS", "carmen/msg/Odometry", "carmen", 1),
    ]
    messages = [source.decode(raw) for raw in source.messages()]
    assert [message.stamp_ns for message in messages] == [10**9 * n for n in range(1, 7)]
    assert messages[0] == CarmenOdometry(10**9, "odom", (3.0, 4.0, 0.25))
    front, first, rear, truth, reading = messages[1:]
    assert isinstance(front, CarmenScan)
    assert (front.laser, front.laser_pose, front.robot_pose) == ("front_laser", (1.0, 2.0, 0.5), (3.0, 4.0, 0.25))
    assert isinstance(first, CarmenScan)
    assert (first.start_rad, first.step_rad, first.no_return_m) == (-1.0, 0.5, 30.0)
    assert first.ranges_m.tolist() == [1.5, 2.5, 30.0]
    assert (first.laser_pose, first.robot_pose) == ((1.0, 2.0, 0.5), (3.0, 4.0, 0.25))
    assert isinstance(rear, CarmenScan)
    assert rear.laser == "rear_laser"
    assert truth == CarmenOdometry(5 * 10**9, "world", (7.0, 8.0, 0.5))
    assert isinstance(reading, CarmenScan)
    assert causes(source) == {"poses_raw": 1}
    scans = {recorded.channel.topic: recorded.scan for recorded in source.scans()}
    assert sorted(scans) == ["FLASER", "LASER_READING", "RLASER", "ROBOTLASER1"]
    assert scans["ROBOTLASER1"].ranges_m.tolist() == [1.5, 2.5, math.inf]
    placed, body = poses_of("carmen/msg/LaserScan", front)
    assert (placed.frame, placed.child, body.frame, body.child) == ("map", "front_laser", "odom", "base_link")
    assert placed.transform().yaw_rad == pytest.approx(0.5)


def test_windows_and_topics(log: Any) -> None:
    source = log(*(line for n in range(1, 9) for line in (flaser(n), odom(n + 0.5))))
    assert (source.start_ns, source.end_ns) == (10**9, 8_500_000_000)
    assert [m.log_ns for m in source.messages(["ODOM"], 3 * 10**9, 5_500_000_000)] == [
        3_500_000_000,
        4_500_000_000,
        5_500_000_000,
    ]
    assert list(source.messages([])) == []


def test_lines_that_cannot_be_read_are_counted_once(log: Any) -> None:
    broken = [
        "FLASER 5 1 2",
        "FLASER x",
        "FLASER -1 0",
        "ODOM 1 2",
        "FLASER 2 1 x 0 0 0 0 0 0 3 r 3",
        "ODOM a b c 1 r 1",
    ]
    source = log(flaser(1), *broken, flaser(4), "FLASER 2 1 2 0 0 0 0 0 0 nan r 1")
    assert len(list(source.messages(["FLASER"]))) >= 2
    assert len(list(source.scans())) == 2
    assert causes(source)["line_unreadable"] == 7
    list(source.messages())
    assert causes(source)["line_unreadable"] == 7


def test_no_return_ranges(log: Any) -> None:
    def no_return(*ranges: float) -> float:
        found = log(*(flaser(n + 1, ranges) for n in range(30)))
        return float(next(iter(found.scans())).scan.range_max_m)

    assert no_return(1, 5, 81.83) == 81.8  # error codes of a SICK
    assert no_return(1, 5, 50.0) == pytest.approx(49.995)  # a value that dominates the longest ones
    assert no_return(1, 2, 3, 4, 4.01, 3.9, 4.02, 3.95) == math.inf  # walls at every range
    assert no_return(0, 0, 0) == math.inf


def test_stamps_that_do_not_advance_leave_the_index_as_clock(log: Any) -> None:
    lines = [odom("1.01893e+09"), *(line for _ in range(4) for line in (flaser("1.01893e+09"), odom("1.01893e+09")))]
    source = log(*lines, odom("6.01"))
    times = [(m.channel.topic, m.log_ns) for m in source.messages()]
    assert [t for topic, t in times if topic == "FLASER"] == [1_000, 10**9, 2 * 10**9, 3 * 10**9]
    assert [t for _, t in times] == sorted(t for _, t in times)
    assert causes(source) == {"stamps_unusable": 4, "line_without_time": 1}
    assert [recorded.scan.stamp_ns for recorded in source.scans()] == [t for topic, t in times if topic == "FLASER"]


def test_the_loggers_stamps_stand_in(log: Any) -> None:
    source = log(*(f"FLASER 1 1 0 0 0 0 0 0 0 r {n}" for n in range(1, 6)))
    assert [m.log_ns for m in source.messages()] == [n * 10**9 for n in range(1, 6)]
    assert causes(source) == {"stamps_unusable": 5}


def test_a_log_without_any_stamp(log: Any) -> None:
    source = log(*(line for _ in range(3) for line in (flaser(0), odom(0))))
    assert [m.log_ns for m in source.messages()] == [0, 1000, 10**9, 10**9 + 1000, 2 * 10**9, 2 * 10**9 + 1000]


def test_stamps_backward_and_anew(log: Any) -> None:
    source = log(flaser(100), flaser(103), flaser(102), flaser(104), flaser(5), flaser(6))
    recorded = list(source.scans())
    assert [scan.log_ns for scan in recorded] == [
        100_000_000_000,
        103_000_000_000,
        103_000_000_000,
        104_000_000_000,
        104_001_000_000,
        105_001_000_000,
    ]
    assert recorded[2].scan.stamp_ns == 102 * 10**9
    assert causes(source) == {"lines_out_of_order": 1, "clock_restarted": 1}


@THOROUGH
@given(
    lines=st.lists(
        st.tuples(st.booleans(), st.one_of(st.integers(0, 200), st.sampled_from([0, 1e-70, 1e9, 5e8, -3.5]))),
        max_size=20,
    )
)
def test_log_times_never_fall_back(log: Any, lines: list[tuple[bool, float]]) -> None:
    source = log(flaser(1), *(flaser(stamp) if scan else odom(stamp) for scan, stamp in lines))
    for _ in range(2):
        times = [message.log_ns for message in source.messages()]
        assert times == sorted(times)
        assert (source.start_ns, source.end_ns) == (times[0], times[-1])
    assert sum(scan for scan, _ in lines) + 1 == len(list(source.scans()))


@THOROUGH
@given(where=st.floats(0, 1))
def test_gzip_cut_anywhere(tmp_path: Path, where: float) -> None:
    text = "\n".join(flaser(n, [1 + n / 7 + k / 13 for k in range(40)]) for n in range(1, 60)).encode()
    packed = gzip.compress(text, mtime=0)
    path = tmp_path / "cut.log.gz"
    path.write_bytes(packed[: int(where * (len(packed) - 1))])
    try:
        source = CarmenSource(path)
    except RecordingError:
        assert where < 0.5
        return
    assert causes(source)["cut_off"] == 1
    stamps = [message.log_ns // 10**9 for message in source.messages()]
    assert stamps == list(range(1, len(stamps) + 1))


def test_a_line_without_end(tmp_path: Path) -> None:
    path = tmp_path / "endless.log"
    path.write_bytes(b"x" * (3 << 20) + b"\n" + flaser(1).encode())
    source = CarmenSource(path)
    assert causes(source) == {"line_unreadable": 1}
    assert len(list(source.messages())) == 1


REAL = {
    # scans, beams, no-return range, astray odometry lines, further faults
    "intel": (910, 180, 81.8, {"lines_out_of_order"}),
    "aces": (440, 180, 49.995, set()),
    "belgioioso": (395, 361, 81.8, {"stamps_unusable"}),
    "freiburg-101": (292, 360, 81.8, set()),
}


@pytest.mark.parametrize("name", REAL)
def test_real_logs(shared_data: Path, name: str) -> None:
    count, beams, no_return_m, odd = REAL[name]
    source = CarmenSource(shared_data / "carmen" / f"{name}-corrected.log.gz")
    scans = list(source.scans())
    assert len(scans) == count
    assert {len(recorded.scan.ranges_m) for recorded in scans} == {beams}
    assert all(recorded.scan.range_max_m == pytest.approx(no_return_m) for recorded in scans)
    faults: dict[str, Fault] = {f"{fault.cause} {fault.topic}": fault for fault in source.faults}
    assert faults["line_without_time ODOM"].count == count  # each scan's pose, repeated by the corrector without a time
    assert {fault.cause for fault in source.faults} == {"line_without_time", *odd} or name == "intel"
    if name == "intel":
        assert faults["lines_out_of_order FLASER"].count == 4
        assert source.end_ns == pytest.approx(2691.3e9, rel=1e-6)
    if name == "belgioioso":
        assert [recorded.log_ns for recorded in scans[1:]] == [n * 10**9 for n in range(1, count)]
    payload = scan_payload(scans[0].scan)
    assert np.allclose(payload.directions[0], [0, -1])
    silent = ~payload.hits
    assert (payload.ranges_m[silent] == np.float32(no_return_m)).all()


@pytest.mark.parametrize("stamp", ["1e999999", "1e999999999999", "-1e30", "nan", "inf"])
def test_stamps_that_no_number_holds_cost_their_line(tmp_path: Path, stamp: str) -> None:
    path = tmp_path / "a.log"
    lines = [f"FLASER 2 1.0 2.0 0 0 0 0 0 0 {t} host {t}\n" for t in ("1.0", stamp, "2.0", "3.0")]
    path.write_text("".join(lines))
    with CarmenSource(path) as source:
        assert [message.log_ns for message in source.messages()] == [10**9, 2 * 10**9, 3 * 10**9]
        assert source.faults.count("line_unreadable") == 1


@pytest.mark.parametrize("stamp", ["0e300", "0e999999999999", "-0e99"])
def test_zero_is_zero_however_it_is_written(tmp_path: Path, stamp: str) -> None:
    path = tmp_path / "a.log"
    path.write_text(f"FLASER 2 1.0 2.0 0 0 0 0 0 0 {stamp} host {stamp}\n")
    with CarmenSource(path) as source:
        assert [message.log_ns for message in source.messages()] == [0]

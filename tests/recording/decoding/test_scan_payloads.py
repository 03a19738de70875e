"""What the numbers of a laser scan mean."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mapgraft.contracts import Transform
from mapgraft.contracts.sources import ScanMessage
from mapgraft.errors import RecordingError
from mapgraft.recording.decoding.scans import beam_directions, scan_payload

INF, NAN = math.inf, math.nan


def message(
    ranges: object, range_min_m: float = 0.5, range_max_m: float = 10.0, start: float = -1.0, step: float = 0.5
) -> ScanMessage:
    values = np.array(ranges, np.float32)
    values.setflags(write=False)
    return ScanMessage(7, "laser", start, step, 0.0, range_min_m, range_max_m, values)


@pytest.mark.parametrize(
    ("limits", "given_m", "expected_m", "hit"),
    [
        ((0.5, 10.0), 3.0, 3.0, True),
        ((0.5, 10.0), 0.5, 0.5, True),
        ((0.5, 10.0), 0.4, NAN, None),
        ((0.5, 10.0), 0.0, NAN, None),
        ((0.0, 10.0), 0.0, NAN, None),
        ((0.5, 10.0), -1.0, NAN, None),
        ((0.5, 10.0), -INF, NAN, None),
        ((0.5, 10.0), NAN, NAN, None),
        ((0.5, 10.0), INF, 10.0, False),
        ((0.5, 10.0), 12.0, 10.0, False),
        ((0.5, 10.0), 10.0, 10.0, False),
        ((0.5, 0.0), INF, NAN, None),
        ((0.5, 0.0), 12.0, 12.0, True),
        ((0.5, NAN), 12.0, 12.0, True),
        ((0.5, INF), INF, NAN, None),
        ((0.5, -1.0), 12.0, 12.0, True),
        ((NAN, 10.0), 0.1, 0.1, True),
        ((-1.0, 10.0), 0.1, 0.1, True),
    ],
)
def test_one_range(limits: tuple[float, float], given_m: float, expected_m: float, hit: bool | None) -> None:
    scan = scan_payload(message([given_m], *limits))
    assert np.array_equal(scan.ranges_m, np.array([expected_m], np.float32), equal_nan=True)
    if hit is not None:
        assert scan.hits.tolist() == [hit]
    assert len(scan.rays(Transform.identity()).hits) == (hit is not None)


@given(
    arrays.arrays(np.float32, st.integers(0, 30), elements=st.floats(width=32)),
    st.floats(width=32),
    st.floats(width=32),
)
def test_laws_of_all_ranges(ranges: np.ndarray, shortest: float, longest: float) -> None:
    given_message = message(ranges, shortest, longest)
    before = given_message.ranges_m.tobytes()
    scan = scan_payload(given_message)
    assert given_message.ranges_m.tobytes() == before
    assert (scan.ranges_m.dtype, scan.hits.dtype, scan.directions.shape) == (np.float32, np.bool_, (len(ranges), 2))
    valid = ~np.isnan(scan.ranges_m)
    assert np.isfinite(scan.ranges_m[valid]).all()
    assert (scan.ranges_m[valid] > 0).all()
    assert (scan.ranges_m[valid & scan.hits] == ranges[valid & scan.hits]).all()
    with np.errstate(over="ignore"):
        longest = float(np.float32(longest))
    if math.isfinite(longest) and longest > 0:
        assert (scan.ranges_m[valid & ~scan.hits] == np.float32(longest)).all()
        assert (scan.ranges_m[valid & scan.hits] < np.float32(longest)).all()
    assert scan.ranges_m.flags.aligned
    assert not scan.ranges_m.flags.writeable


def test_directions_are_shared_between_scans_of_one_geometry() -> None:
    first, second = scan_payload(message([1, 2, 3])), scan_payload(message([4, 5, 6]))
    assert first.directions is second.directions
    assert not first.directions.flags.writeable
    assert np.allclose(first.directions, [[math.cos(a), math.sin(a)] for a in (-1.0, -0.5, 0.0)])
    other = scan_payload(message([1, 2, 3], step=0.25))
    assert not np.allclose(other.directions, first.directions)


@pytest.mark.parametrize(("start", "step"), [(NAN, 0.1), (0.0, INF), (-INF, 0.1)])
def test_angles_must_be_finite(start: float, step: float) -> None:
    with pytest.raises(RecordingError, match="angles must be finite"):
        scan_payload(message([1.0], start=start, step=step))


def test_a_scan_without_beams() -> None:
    scan = scan_payload(message([]))
    assert scan.ranges_m.shape == (0,)
    assert beam_directions(0.0, 0.1, 0).shape == (0, 2)

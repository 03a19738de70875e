"""Transforms in metres and in pixels: the same places."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import GridMessage, Transform
from mapgraft.matching.pixels import Frame, frame_of, in_metres, in_pixels, moved, planar, scale_of, yaw_of

poses = st.builds(Transform.planar, st.floats(-80, 80), st.floats(-80, 80), st.floats(-math.pi, math.pi))


def frame(height: int, width: int, resolution_m: float, T_map_origin: Transform) -> Frame:
    return frame_of(GridMessage(np.zeros((height, width), np.int8), resolution_m, T_map_origin))


def test_a_pixels_centre_lies_where_its_cell_does() -> None:
    image = frame(10, 20, 0.5, Transform.planar(1.0, 2.0, 0.0))
    corners = moved(image.M_map_px, np.array([(0.0, 0.0), (0.0, 9.0), (19.0, 9.0), (-0.5, 9.5)]))
    assert corners == pytest.approx(np.array([(1.25, 6.75), (1.25, 2.25), (10.75, 2.25), (1.0, 2.0)]))


@settings(deadline=None)
@given(poses, poses, poses, st.sampled_from([(0.05, 0.05), (0.05, 0.01), (0.01, 0.05)]), st.floats(0.5, 2.0))
def test_metres_and_pixels_tell_the_same(
    T_a_b: Transform, origin_a: Transform, origin_b: Transform, resolutions: tuple[float, float], scale: float
) -> None:
    a, b = frame(300, 400, resolutions[0], origin_a), frame(120, 90, resolutions[1], origin_b)
    S = planar(T_a_b, scale)
    pixels = in_pixels(a, b, S)
    here = np.array([(0.0, 0.0), (89.0, 119.0), (40.0, 7.0)])
    assert moved(a.M_map_px, moved(pixels, here)) == pytest.approx(moved(S, moved(b.M_map_px, here)), abs=1e-9)
    assert scale_of(pixels) == pytest.approx(scale * resolutions[1] / resolutions[0])
    assert in_metres(a, b, pixels) == pytest.approx(S, abs=1e-9)


def test_the_list_of_real_maps_is_read_as_it_was_meant(shared_data: Path) -> None:
    folder = shared_data / "maps" / "grid_pairs"
    for entry in json.loads((folder / "pairs.json").read_text()):
        import cv2

        frames = []
        for side in "ab":
            height, width = cv2.imread(str(folder / entry[side]), cv2.IMREAD_UNCHANGED).shape[:2]
            frames.append(frame(height, width, entry[f"res_{side}"], Transform.planar(*entry[f"origin_{side}"])))
        S = in_metres(*frames, np.array([*entry["T_px_b2a"], 0, 0, 1]).reshape(3, 3))
        told = entry["T_m_b2a"]
        assert S[:2, 2] == pytest.approx((told["x"], told["y"]), abs=2e-3), entry["id"]
        assert math.degrees(yaw_of(S)) == pytest.approx(told["yaw_deg"], abs=2e-3)
        assert scale_of(S) == pytest.approx(1.0, abs=0.01)

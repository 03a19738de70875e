"""Answers held against the truth: by walls, by keypoints, and where nothing may be merged."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.matching.judging import Judged, LeftOut, judge, rigid_about, summed_up
from mapgraft.matching.pair_list import MapFile, read_lists
from mapgraft.matching.pairing import Pairer
from mapgraft.matching.pixels import moved
from mapgraft.matching.ready_map import ReadyMap, Shelf

Bench = tuple[Shelf, Pairer]
SHAPE = (520, 560)


def judged(bench: Bench, folder: Path, entries: Sequence[dict[str, Any]]) -> tuple[list[Judged], list[LeftOut]]:
    shelf, pairer = bench
    path = folder / "pairs.json"
    path.write_text(json.dumps(entries))
    listed = read_lists([path], [])

    def read(file: MapFile, side: int) -> ReadyMap:
        return shelf.read(file.path, {"resolution_m": file.resolution_m})

    return judge(listed.pairs, listed, read, pairer, 40.0, lambda: None)


@pytest.fixture
def maps(save: Callable[..., Path], floor, turn, similarity) -> NDArray[np.float64]:
    """``a.png`` and ``b.png``, the same floor turned; T_px_a_b."""
    T_px_b_a = similarity(-70.0, 60.0, 460.0)
    save("a.png", floor(0.05))
    save("b.png", turn(floor(0.05), T_px_b_a, SHAPE))
    return np.linalg.inv(T_px_b_a)


def entry(T_px_a_b: NDArray[np.float64], **more: Any) -> dict[str, Any]:
    told = {"a": "a.png", "b": "b.png", "res_a": 0.05, "res_b": 0.05, "T_px_b2a": T_px_a_b[:2].ravel().tolist()}
    return {**told, **more}


def test_the_truth_is_right_and_another_place_is_wrong(bench: Bench, tmp_path: Path, maps) -> None:
    aside = maps.copy()
    aside[0, 2] += 20.0  # 1 m
    (right, wrong), left = judged(bench, tmp_path, [entry(maps, id="right"), entry(aside, id="aside")])
    assert not left
    assert right.scored.merged_right
    assert right.scored.accepted == right.scored.best
    assert wrong.scored.accepted is not None
    assert wrong.scored.merged_wrong
    assert wrong.scored.accepted.error_m == pytest.approx(1.0, abs=0.2)
    assert right.scored.overlap == pytest.approx(1.0, abs=0.05)


def test_keypoints_are_measured_in_pixels_of_a(bench: Bench, tmp_path: Path, maps) -> None:
    b = np.array([(100.0, 80.0), (300.0, 200.0), (200.0, 400.0)])
    a = moved(maps, b)
    told = {"keypoints_b": b.tolist(), "id": "near"}
    near = entry(maps, keypoints_a=(a + np.array([30.0, 0.0])).tolist(), **told)
    far = entry(maps, keypoints_a=(a + np.array([60.0, 0.0])).tolist(), **told)
    (one, two), _ = judged(bench, tmp_path, [near, far])
    assert one.scored.best is not None
    assert one.scored.best.error_px == pytest.approx(30.0, abs=5.0)
    assert one.scored.best.error_m is None
    assert (one.scored.right, two.scored.right) == (True, False)


def test_pairs_without_a_usable_truth_are_left_out_with_the_reason(bench: Bench, tmp_path: Path, maps) -> None:
    larger = maps.copy()
    larger[:2, :2] *= 0.8
    found, left = judged(bench, tmp_path, [entry(larger, id="scaled"), entry(maps, id="odd", suspect=True)])
    assert not found
    assert [pair.id for pair in left] == ["scaled", "odd"]
    assert "its scale is not known" in left[0].reason
    assert "suspect" in left[1].reason


def test_what_was_right_wrong_and_merged_by_mistake_is_counted_as_evaluate_does(
    bench: Bench, tmp_path: Path, maps
) -> None:
    aside = maps.copy()
    aside[0, 2] += 20.0
    pairs = [entry(maps, id="right"), entry(aside, id="wrong")]
    pairs += [{"a": "a.png", "b": "b.png", "res_a": 0.05, "res_b": 0.05, "unrelated": True}]
    pairs += [{"a": "a.png", "b": "b.png", "res_a": 0.05, "res_b": 0.05, "T_px_b2a": pairs[0]["T_px_b2a"], "id": "two"}]
    summary, times = summed_up(judged(bench, tmp_path, pairs)[0])
    assert (summary.pairs, summary.across, summary.rejected) == (4, 1, 0)
    assert (summary.right, summary.wrong, summary.without_hypothesis) == (2, 2, 0)
    assert (summary.acceptance.right.count, summary.acceptance.wrong.count) == (2, 2)
    assert [bin_.recall.of for bin_ in summary.recall] == [0, 0, 0, 0, 3]
    assert (summary.recall_from_some_overlap.count, summary.acceptance.right_of_right.of) == (2, 2)
    assert (summary.acceptance.wrong_across.count, summary.acceptance.wrong_across.of) == (1, 1)
    assert summary.auc["score"].value == 0.5, "all answers are the same one"
    assert (summary.auc["score"].right, summary.auc["score"].wrong) == (2, 2)
    assert summary.errors.error_m.median < 0.2
    assert summary.errors.error_px.count == 0
    assert (summary.covariance.degenerate.of, summary.covariance.degenerate_of_all.of) == (2, 4)
    assert summary.covariance.inside.of == 0, "a truth in pixels is too coarse for that"
    assert 0.0 < times.match_ms.median <= times.match_ms.largest
    assert (times.match_ms.count, times.verify_ms.count) == (4, 0)


def test_a_truth_with_a_little_scale_becomes_rigid_where_the_walls_are() -> None:
    S = np.array([[1.01, 0.0, 3.0], [0.0, 1.01, 4.0], [0.0, 0.0, 1.0]])
    centre = np.array([100.0, -50.0])
    T = rigid_about(S, centre)
    assert T.apply(centre[None]) == pytest.approx(moved(S, centre[None]))
    assert abs(np.linalg.det(T.matrix) - 1.0) < 1e-12

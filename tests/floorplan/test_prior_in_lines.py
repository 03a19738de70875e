"""A plan among line segments: as strong as one look, however its walls were drawn, and at whatever scale."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import Contribution, Donation, EmptyMapError, Match, Provenance, Transform
from mapgraft_floorplan import raster_file
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.lines_conversion import PlanToLines
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.prior_fuser import PlanPrior
from mapgraft_lines.layer import LOOKS
from mapgraft_lines.map_type import LineSegments
from mapgraft_lines.segments import from_segments

LINES = LineSegments()
ACROSS = np.linspace(1.03, 5.03, 401)
LOOKS_THROUGH = 6  # one look in five must have seen a wall that stands, and the prior is one


def along(xs: NDArray[np.float64], y: float) -> NDArray[np.float64]:
    """Pieces (n, 4) from place to place at a height."""
    return np.column_stack((xs[:-1], np.full(len(xs) - 1, y), xs[1:], np.full(len(xs) - 1, y)))


def image_of_a_wall(folder: Path) -> NDArray[np.float64]:
    """The outlines of a wall of 4 × 0.04 m in an image of 0.01 m."""
    image = np.full((300, 700), 255, np.uint8)
    cv2.rectangle(image, (103, 298 - 102), (502, 298 - 99), 0, -1)
    path = folder / "a.png"
    cv2.imwrite(str(path), image)
    return raster_file.read(path, resolution_m=0.01).segments_m


@pytest.fixture(scope="module", params=["one line", "two faces", "pieces of 1 cm", "outlines of an image"])
def drawn(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> NDArray[np.float64]:
    """One wall of 4 m at y = 1.03 m."""
    ends = ACROSS[[0, -1]]
    if request.param == "one line":
        return along(ends, 1.03)
    if request.param == "two faces":
        return np.vstack((along(ends, 0.97), along(ends, 1.09)))
    if request.param == "pieces of 1 cm":
        return along(ACROSS, 1.03)
    return image_of_a_wall(tmp_path_factory.mktemp("plan"))


def prior_of(walls: NDArray[np.float64], scale: float = 1.0) -> Contribution:
    plan = PlanLayer(Walls.of_metres(walls / scale), scale_known=scale == 1.0, observations=1)
    donation = Donation(PlanToLines().convert(plan, FloorPlanType(), LINES), Provenance("plan", 1, 1))
    return PlanPrior().fuse(LINES, LINES.view(None), donation, Match(Transform.identity(), 1.0, 1.0, scale))


def looked_through(times: int):
    """A robot's map of nothing but free space, all of it seen so many times."""
    at = np.stack(np.meshgrid(np.arange(0.1, 7.0, 0.25), np.arange(0.1, 3.0, 0.25)), axis=-1).reshape(-1, 2)
    return from_segments(LINES, np.empty((0, 2, 2)), free_m=at, free_looks=times)


@pytest.mark.parametrize("scale", [1.0, 0.3, 4.0])
def test_it_is_one_look_however_it_was_drawn(drawn: NDArray[np.float64], scale: float) -> None:
    made = prior_of(drawn, scale)
    assert made.role == "prior"
    assert made.summary["prior"] == 1.0
    entered = LINES.view(None, [made])
    assert set(entered.total.pieces.counts[:, LOOKS].tolist()) == {1}
    assert entered.walls.lengths_m[0] == pytest.approx(4.0, abs=0.15)


def test_the_same_few_looks_override_it_however_it_was_drawn(drawn: NDArray[np.float64]) -> None:
    made = prior_of(drawn)
    assert LINES.view(looked_through(LOOKS_THROUGH - 1), [made]).walls.lengths_m.sum() > 3.5
    assert len(LINES.view(looked_through(LOOKS_THROUGH), [made]).walls) == 0


def test_it_hardly_moves_a_wall_that_was_seen(drawn: NDArray[np.float64]) -> None:
    seen = from_segments(LINES, np.array([[(1.03, 1.08), (5.03, 1.08)]]), 0.02, looks=4)
    walls = LINES.view(seen, [prior_of(drawn)]).walls
    assert walls.ends_m[0][:, 1] == pytest.approx(1.08, abs=0.01)


def test_nothing_is_no_prior() -> None:
    with pytest.raises(EmptyMapError):
        prior_of(np.empty((0, 4)))

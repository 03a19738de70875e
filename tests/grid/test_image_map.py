"""Ready-made maps as bare images."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, MapError
from mapgraft_grid import image_map, map_server

YAML = "image: {image}\nresolution: 0.05\norigin: [1.0, -2.0, 0.5]\nnegate: {negate}\n"
YAML += "occupied_thresh: 0.65\nfree_thresh: 0.196\n"


def saved(folder: Path, image: NDArray[np.generic], name: str = "map.png") -> Path:
    path = folder / name
    assert cv2.imwrite(str(path), image)
    return path


@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize("name", ["map.png", "map.pgm", "map.bmp", "map.tif"])
def test_every_gray_means_what_it_means_to_map_server(tmp_path: Path, name: str, negate: bool) -> None:
    path = saved(tmp_path, np.arange(256, dtype=np.uint8).reshape(8, 32), name)
    (tmp_path / "map.yaml").write_text(YAML.format(image=name, negate=int(negate)))
    theirs = map_server.read(tmp_path / "map.yaml")
    ours = image_map.read(path, resolution_m=0.05, origin=(1.0, -2.0, 0.5), negate=negate)
    assert (ours.cells == theirs.cells).all()
    assert ours.resolution_m == theirs.resolution_m
    assert ours.T_map_origin == theirs.T_map_origin
    assert ours.cells.flags.c_contiguous


def test_grays_of_map_savers_and_of_others_without_any_option(tmp_path: Path) -> None:
    cells = image_map.read(saved(tmp_path, np.array([[0, 127, 128, 205, 254, 255]], np.uint8)), resolution_m=0.1).cells
    assert cells.tolist() == [[100, -1, -1, -1, 0, 0]]


def test_unknown_gray_goes_before_the_thresholds(tmp_path: Path) -> None:
    path = saved(tmp_path, np.array([[0, 230, 255]], np.uint8))
    assert image_map.read(path, resolution_m=0.1).cells.tolist() == [[100, 0, 0]]
    assert image_map.read(path, resolution_m=0.1, unknown_gray=230).cells.tolist() == [[100, -1, 0]]


def test_what_is_transparent_is_unknown_and_a_tint_is_gray(tmp_path: Path) -> None:
    image = np.zeros((2, 2, 4), np.uint8)
    image[..., 3] = 255
    image[0, 0, 3] = 0
    image[1] = (250, 245, 255, 255)
    assert image_map.read(saved(tmp_path, image), resolution_m=0.1).cells.tolist() == [[0, 0], [-1, 100]]


def test_the_first_row_of_the_image_is_the_top(tmp_path: Path) -> None:
    image = np.full((3, 2), 254, np.uint8)
    image[0, 1] = 0
    assert image_map.read(saved(tmp_path, image), resolution_m=0.1).cells[2, 1] == 100


def test_what_is_probably_not_meant_is_warned_of(tmp_path: Path) -> None:
    said: list[str] = []
    path = saved(tmp_path, np.full((50, 50), 30, np.uint8))
    image_map.read(path, resolution_m=0.1, warn=said.append)
    assert len(said) == 1
    assert "negate" in said[0]
    said.clear()
    image_map.read(path, resolution_m=0.1, negate=True, warn=said.append)
    assert not said


def test_what_cannot_be_used_is_one_sentence(tmp_path: Path) -> None:
    good = saved(tmp_path, np.full((5, 5), 254, np.uint8))
    with pytest.raises(ConfigError, match=r"robots: \{map: \{options: \{resolution_m: 0.05\}\}\}"):
        image_map.read(good)
    (tmp_path / "map.yaml").write_text("")
    with pytest.raises(ConfigError, match=r"name map\.yaml"):
        image_map.read(good)
    for wrong in (0, -1.0, float("nan"), "0.05", True):
        with pytest.raises(ConfigError, match="above 0"):
            image_map.read(good, resolution_m=wrong)
    for wrong in (-1, 256, 1.5, True):
        with pytest.raises(ConfigError, match="0 … 255"):
            image_map.read(good, resolution_m=0.1, unknown_gray=wrong)
    for wrong in ((0, 0), "here", None, (0, 0, "x")):
        with pytest.raises(ConfigError, match="three numbers"):
            image_map.read(good, resolution_m=0.1, origin=wrong)
    coloured = np.zeros((5, 5, 3), np.uint8)
    coloured[..., 0] = 255
    with pytest.raises(MapError, match="in colour"):
        image_map.read(saved(tmp_path, coloured, "colour.png"), resolution_m=0.1)
    with pytest.raises(MapError, match="cannot be read"):
        image_map.read(tmp_path / "none.png", resolution_m=0.1)
    (tmp_path / "text.png").write_text("no image")
    with pytest.raises(MapError, match="no image"):
        image_map.read(tmp_path / "text.png", resolution_m=0.1)


def test_an_image_too_large_to_be_read_is_refused_by_its_header(tmp_path: Path) -> None:
    path = tmp_path / "huge.pgm"
    path.write_bytes(b"P5\n100000 100000\n255\n")
    with pytest.raises(MapError, match="100000 × 100000 pixels"):
        image_map.read(path, resolution_m=0.05)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "m.pgm"
    os.mkfifo(pipe)
    with pytest.raises(MapError, match="is not a file"):
        image_map.read(pipe, resolution_m=0.05)

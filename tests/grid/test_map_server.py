"""map_server's files: what we write others read, and what others wrote we read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, MapError, Observation
from mapgraft_grid import map_server
from mapgraft_grid.map_type import OccupancyGrid

MakeMessage = Callable[..., Observation]

YAML = """image: {image}
resolution: 0.05
origin: [1.0, -2.0, 0.5]
negate: {negate}
occupied_thresh: 0.65
free_thresh: 0.196
mode: {mode}
"""
GRAYS = np.array([[0, 80, 100, 205], [204, 206, 254, 255]], np.uint8)  # top row first


def _write(folder: Path, image: str = "map.pgm", negate: str = "0", mode: str = "trinary", text: str = YAML) -> Path:
    path = folder / "map.yaml"
    path.write_text(text.format(image=image, negate=negate, mode=mode))
    return path


def _pgm(gray: NDArray[np.uint8]) -> bytes:
    return f"P5\n# made by hand\n{gray.shape[1]} {gray.shape[0]}\n255\n".encode() + gray.tobytes()


def _server(gray: int, negate: bool, mode: str) -> int:
    """One pixel as nav2's map_io.cpp reads it."""
    if mode == "raw":
        return gray if gray <= 100 else -1
    occupancy = (gray if negate else 255 - gray) / 255.0
    if occupancy > 0.65:
        return 100
    if occupancy < 0.196:
        return 0
    return -1 if mode == "trinary" else int(1 + 98 * (occupancy - 0.196) / (0.65 - 0.196))


@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("suffix", ["pgm", "plain.pgm", "png", "bmp"])
def test_pixels_mean_what_map_server_says(tmp_path: Path, negate: bool, mode: str, suffix: str) -> None:
    image = tmp_path / f"map.{suffix}"
    if suffix == "pgm":
        image.write_bytes(_pgm(GRAYS))
    elif suffix == "plain.pgm":
        image.write_text("P2 # plain\n4 2\n# and\n255\n" + "\n".join(" ".join(map(str, row)) for row in GRAYS))
    else:
        assert cv2.imwrite(str(image), GRAYS)
    found = map_server.read(_write(tmp_path, image.name, str(int(negate)), mode))
    expected = [[_server(int(gray), negate, mode) for gray in row] for row in GRAYS[::-1]]
    assert found.cells.tolist() == expected
    assert found.resolution_m == 0.05
    T = found.T_map_origin
    assert (T.x_m, T.y_m, T.yaw_rad) == pytest.approx((1.0, -2.0, 0.5))


def test_colours_sixteen_bits_and_transparency(tmp_path: Path) -> None:
    colour = np.dstack([GRAYS, GRAYS, GRAYS])
    cv2.imwrite(str(tmp_path / "colour.png"), colour)
    gray = map_server.read(_write(tmp_path, "colour.png", mode="scale")).cells
    assert gray.tolist() == [[_server(int(g), False, "scale") for g in row] for row in GRAYS[::-1]]
    alpha = np.full_like(GRAYS, 255)
    alpha[0, 1] = 128
    cv2.imwrite(str(tmp_path / "clear.png"), np.dstack([colour, alpha]))
    clear = map_server.read(_write(tmp_path, "clear.png", mode="scale")).cells
    assert clear[1, 2] == _server(100, False, "scale")
    assert clear[1, 1] == -1 or _server(80, False, "scale") == 100
    deep = GRAYS.astype(">u2") * 257
    (tmp_path / "deep.pgm").write_bytes(b"P5 4 2 65535\n" + deep.tobytes())
    assert (map_server.read(_write(tmp_path, "deep.pgm", mode="scale")).cells == gray).all()


@settings(max_examples=30, deadline=None)
@given(shape=st.tuples(st.integers(1, 90), st.integers(1, 90)), seed=st.integers(0, 2**31))
def test_what_is_written_reads_back(
    tmp_path_factory: pytest.TempPathFactory, message_of: MakeMessage, shape: tuple[int, int], seed: int
) -> None:
    folder = tmp_path_factory.mktemp("maps")
    cells = np.random.default_rng(seed).choice(np.array([-1, 0, 100], np.int8), shape)
    cells[0, 0] = cells[-1, -1] = 100
    grid = OccupancyGrid()
    layer = grid.new_layer()
    grid.integrate(layer, message_of(cells, 0.07, (-1.234, 5.678, 0.0)))
    made = grid.files(grid.view(layer), "robot")
    assert sorted(made) == ["robot.pgm", "robot.yaml"]
    assert made == grid.files(grid.view(layer), "robot")
    for name, content in made.items():
        (folder / name).write_bytes(content)
    warnings: list[str] = []
    found = map_server.read(folder / "robot.yaml", warn=warnings.append)
    assert (found.cells == cells).all()
    assert found.resolution_m == 0.07
    assert (found.T_map_origin.x_m, found.T_map_origin.y_m) == pytest.approx((-1.234, 5.678))
    assert not warnings
    image = cv2.imread(str(folder / "robot.pgm"), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert set(np.unique(image)) <= {0, 205, 254}
    assert (image[::-1] == np.where(cells < 0, 205, np.where(cells > 50, 0, 254))).all()


def test_the_message_shows_what_the_file_shows(message_of: MakeMessage) -> None:
    cells = np.array([[-1, 0, 100], [100, 100, 0]], np.int8)
    grid = OccupancyGrid()
    layer = grid.new_layer()
    grid.integrate(layer, message_of(cells, 0.1, (1.0, 2.0, 0.0)))
    (message,) = grid.messages(grid.view(layer))
    assert (message.suffix, message.message_type) == ("map", "nav_msgs/msg/OccupancyGrid")
    info, data = message.fields["info"], message.fields["data"]
    assert isinstance(info, dict)
    assert isinstance(data, np.ndarray)
    assert (info["width"], info["height"], info["resolution"]) == (3, 2, 0.1)
    assert (info["origin"]["position"]["x"], info["origin"]["position"]["y"]) == pytest.approx((1.0, 2.0))
    assert data.dtype == np.int8
    assert data.tolist() == [-1, 1, 99, 99, 99, 1]


def test_thresholds_that_lose_the_unknown_are_told(shared_data: Path) -> None:
    path = shared_data / "maps" / "mac_1st_floor_final.yaml"
    warnings: list[str] = []
    lost = map_server.read(path, warn=warnings.append)
    assert len(warnings) == 1
    assert "free_thresh 0.25" in warnings[0]
    assert "unknown_gray: 205" in warnings[0]
    mended = map_server.read(path, unknown_gray=205, warn=warnings.append)
    assert len(warnings) == 1
    assert (lost.cells == -1).sum() == 0
    share = (mended.cells == -1).mean()
    assert 0.5 < share < 0.95
    assert ((mended.cells == lost.cells) | (mended.cells == -1)).all()


def test_real_files_make_a_round_trip(shared_data: Path, tmp_path: Path) -> None:
    for path, gray in (("maps/mac_1st_floor_final.yaml", 205), ("floorplans/mrl_arena.yaml", None)):
        message = map_server.read(shared_data / path, unknown_gray=gray)
        grid = OccupancyGrid()
        layer = grid.new_layer()
        identity = type(message.T_map_origin).identity()
        grid.integrate(layer, Observation("plan", 0, 0, "map", "grid_message", message, identity, identity))
        for name, content in grid.files(grid.view(layer), "again").items():
            (tmp_path / name).write_bytes(content)
        again = map_server.read(tmp_path / "again.yaml")
        rows, columns = np.flatnonzero((message.cells >= 0).any(1)), np.flatnonzero((message.cells >= 0).any(0))
        known = message.cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        assert (again.cells == known).all()
        assert again.T_map_origin.x_m == pytest.approx(message.T_map_origin.x_m + columns[0] * message.resolution_m)
        assert again.T_map_origin.y_m == pytest.approx(message.T_map_origin.y_m + rows[0] * message.resolution_m)


BAD_YAML = {
    "image: map.pgm\nresolution: 0\norigin: [0, 0, 0]": "must be above 0",
    "image: map.pgm\nresolution: .nan\norigin: [0, 0, 0]": "must be a number",
    "image: map.pgm\nresolution: five\norigin: [0, 0, 0]": "must be a number",
    "image: map.pgm\nresolution: 0.1\norigin: [0, 0]": "must be .x, y, yaw.",
    "image: map.pgm\nresolution: 0.1\norigin: [0, 0, .inf]": "must be a number",
    "image: map.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nmode: other": "trinary, scale or raw",
    "image: map.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 2": "0 or 1",
    "image: map.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nfree_thresh: 0.9": "occupied_thresh",
    "image: [1]\nresolution: 0.1\norigin: [0, 0, 0]": "must be a file name",
    "image: none.pgm\nresolution: 0.1\norigin: [0, 0, 0]": r"none\.pgm, which map\.yaml names, cannot be read",
    "image: ../map.pgm\nresolution: 0.1\norigin: [0, 0, 0]": "outside its folder",
    "image: /etc/map.pgm\nresolution: 0.1\norigin: [0, 0, 0]": "image: map.pgm",
    "resolution: 0.1": "does not say image, origin",
    "- 1\n- 2": "must describe a map",
    "image: [map.pgm": "is not YAML at line 1, column 16: expected",
    "a: 1\na: 2": "is not YAML",
    "!!python/object:os.system {}": "is not YAML",
    "\x00": "is not YAML",
}


@pytest.mark.parametrize("text", BAD_YAML, ids=BAD_YAML.values())
def test_bad_descriptions_are_told_in_one_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / "map.pgm").write_bytes(_pgm(GRAYS))
    path = tmp_path / "map.yaml"
    path.write_text(text)
    with pytest.raises(MapError, match=BAD_YAML[text]) as caught:
        map_server.read(path)
    assert "\n" not in str(caught.value)


BAD_IMAGES = {
    b"": "no image",
    b"GIF89a nonsense": "no image",
    b"P5\n4 2\n255\n1234567": "cut short",
    b"P5\n4\n": "header is incomplete",
    b"P5\n4 2\n0\n12345678": "largest gray",
    b"P5\n4 2\n100\n\xff2345678": "above its largest",
    b"P5\n1000000 1000000\n255\n": "1000000 × 1000000 pixels",
    b"P5\n0 4\n255\n": "0 × 4 pixels",
    b"P2\n4 2\n255\n1 2 3": "cut short",
    b"P2\n2 1\n255\n1 x": "cut short or damaged",
    b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x0fB@\x00\x0fB@\x08\x00\x00\x00\x00": "1000000 × 1000000 pixels",
}


@pytest.mark.parametrize("content", BAD_IMAGES, ids=BAD_IMAGES.values())
def test_bad_images_are_told_in_one_sentence(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "map.pgm").write_bytes(content)
    with pytest.raises(MapError, match=BAD_IMAGES[content]) as caught:
        map_server.read(_write(tmp_path))
    assert "\n" not in str(caught.value)


def test_a_missing_description_is_told(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="cannot be read: No such file"):
        map_server.read(tmp_path / "map.yaml")
    with pytest.raises(MapError, match="cannot be read: Is a directory"):
        map_server.read(tmp_path)
    (tmp_path / "map.pgm").write_bytes(_pgm(GRAYS))
    with pytest.raises(ConfigError, match="unknown_gray must lie"):
        map_server.read(_write(tmp_path), unknown_gray=300)

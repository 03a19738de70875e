"""Fixtures of matching: floors drawn as images, rules that stay the same, and what reads and matches them."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable
from pathlib import Path

import beacon_files
import beacons as beacon_plugin
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.config import Config
from mapgraft.decision import build_table
from mapgraft.matching.pairing import Pairer
from mapgraft.matching.ready_map import Shelf
from mapgraft.plugins import GROUP, Origin, Plugins, load_plugin, load_plugins
from mapgraft.procedures import Workshop

Image = NDArray[np.uint8]
Bench = tuple[Shelf, Pairer]

RULES = """
- name: grids
  when: {own.type: occupancy_grid, other.type: occupancy_grid, resolution_ratio: {min: 0.1, max: 10}}
  match: {use: carpin}
  accept: {use: thresholds, margin_min: 0.01, metrics: {similarity: {min: 0.9}}}
  fuse: {use: log_odds}
  verify: {use: thresholds, metrics: {similarity: {min: 0.9}}}
- name: never
  when: {own.type: occupancy_grid, own.known_area_m2: {max: 1}}
  reject: less than a square metre is known
"""


def drawn(resolution_m: float) -> Image:
    """A floor of 20 × 14 m without any symmetry: 0 walls, 254 free, 205 unknown around it, 1 m on each side."""
    canvas = np.full((round(16 / resolution_m), round(22 / resolution_m)), 205, np.uint8)
    thick = max(1, round(0.15 / resolution_m))

    def px(*metres: float) -> list[int]:
        return [round((value + 1.0) / resolution_m) for value in metres]

    outline = [(0, 0), (20, 0), (20, 9), (14, 9), (14, 14), (0, 14)]
    cv2.fillPoly(canvas, [np.array([px(*corner) for corner in outline])], 254)
    walls = [*zip(outline, [*outline[1:], outline[0]], strict=True)]
    walls += [((5, 0), (5, 4)), ((5, 5.2), (5, 14)), ((5, 6), (9, 6)), ((10.3, 6), (20, 6)), ((12, 0), (12, 3.5))]
    walls += [((8, 9), (8, 14)), ((8, 9), (12.5, 9)), ((16, 2), (17.5, 3)), ((2, 8), (3, 8)), ((1.5, 11), (3.5, 12))]
    for start, end in walls:
        cv2.line(canvas, px(*start), px(*end), 0, thick)
    return canvas


def turned(image: Image, T_px_new_old: NDArray[np.float64], shape: tuple[int, int]) -> Image:
    """The image where a (3, 3) transform of pixel centres moves it, on a canvas (h, w); unknown where nothing was."""
    width, height = shape[1], shape[0]
    return cv2.warpAffine(image, T_px_new_old[:2], (width, height), flags=cv2.INTER_NEAREST, borderValue=205)


def in_px(yaw_deg: float, x: float, y: float, scale: float = 1.0) -> NDArray[np.float64]:
    """A similarity of pixels (x right, y down) that turns clockwise as one sees it."""
    a = np.radians(yaw_deg)
    c, s = scale * np.cos(a), scale * np.sin(a)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


@pytest.fixture
def save(tmp_path: Path) -> Callable[[str, Image], Path]:
    """Writes an image into a folder of its own test."""

    def write(name: str, image: Image) -> Path:
        path = tmp_path / name
        assert cv2.imwrite(str(path), image)
        return path

    return write


@pytest.fixture
def floor() -> Callable[[float], Image]:
    return drawn


@pytest.fixture
def turn() -> Callable[..., Image]:
    return turned


@pytest.fixture
def similarity() -> Callable[..., NDArray[np.float64]]:
    return in_px


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    path = tmp_path / "rules.yaml"
    path.write_text(RULES)
    return path


@pytest.fixture
def bench(rules: Path) -> Bench:
    """What reads and what matches, by rules of the tests' own."""
    plugins = load_plugins()
    workshop = Workshop(plugins)
    return Shelf(plugins, Config(), workshop), Pairer(workshop, build_table(plugins, rules))


@pytest.fixture
def with_beacons(rules: Path) -> tuple[Shelf, Pairer]:
    """The same with a map type that has no pixels, and files of it that end in ``.beacons``."""
    own = ("occupancy_grid", "standard")
    names = [entry_point.name for entry_point in importlib.metadata.entry_points(group=GROUP)]
    plugins: Plugins = load_plugins(without=[name for name in names if name not in own])
    load_plugin(plugins, beacon_plugin, Origin("beacons", "beacon-plugin", "1.0"))
    load_plugin(plugins, beacon_files, Origin("beacon_files", "beacon-files", "1.0"))
    workshop = Workshop(plugins)
    return Shelf(plugins, Config(), workshop), Pairer(workshop, build_table(plugins))

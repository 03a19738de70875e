"""What pages are made of: templates that escape, pictures and charts that depend on nothing else."""

from __future__ import annotations

import base64
import re
from importlib.resources import files

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from jinja2 import UndefinedError

from mapgraft.pages import picture, png, png_uri, readable, render

TEMPLATES = sorted(p.name for p in (files("mapgraft.pages") / "templates").iterdir())


def test_a_page_says_what_it_may_load() -> None:
    page = render("base.html", version="1 <b>")
    assert "default-src 'none'; img-src data:; style-src 'unsafe-inline'" in page
    assert "mapgraft 1 &lt;b&gt;" in page


def test_what_is_missing_is_a_fault() -> None:
    with pytest.raises(UndefinedError, match="version"):
        render("base.html")


@pytest.mark.parametrize("name", TEMPLATES)
def test_no_template_loads_or_runs_anything_or_lets_anything_through(name: str) -> None:
    text = (files("mapgraft.pages") / "templates" / name).read_text(encoding="utf-8")
    assert not re.search(r"https?:|<script|<link|@import|url\(|\|\s*safe|autoescape|\son[a-z]+=", text)


@given(st.text())
def test_readable_text_has_nothing_hidden(text: str) -> None:
    shown = readable(text)
    assert len(shown) == len(text)
    assert all(c.isprintable() or c in "\n\t" or c.isspace() for c in shown)
    assert readable(shown) == shown


def test_letters_of_any_script_stay() -> None:
    assert readable("Raum 3, Größe ← 部屋 ✓") == "Raum 3, Größe ← 部屋 ✓"
    assert readable("a\x1b[31m\u202eb\x00") == "a\ufffd[31m\ufffdb\ufffd"


PALETTE = arrays(np.uint8, st.tuples(st.integers(2, 40), st.just(3)))


@given(st.data(), PALETTE, st.integers(1, 30), st.integers(1, 30))
def test_a_picture_of_palette_colours_reads_back(data: st.DataObject, palette: np.ndarray, h: int, w: int) -> None:
    pixels = data.draw(arrays(np.uint8, (h, w), elements=st.integers(0, len(palette) - 1)))
    read = cv2.imdecode(np.frombuffer(png(pixels, palette), np.uint8), cv2.IMREAD_COLOR)
    assert (read[..., ::-1] == palette[pixels]).all()


@given(arrays(np.uint8, st.tuples(st.integers(1, 20), st.integers(1, 20), st.sampled_from([3, 4]))))
def test_a_picture_of_true_colours_reads_back(pixels: np.ndarray) -> None:
    read = cv2.imdecode(np.frombuffer(png(pixels), np.uint8), cv2.IMREAD_UNCHANGED)
    turned = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR if pixels.shape[2] == 3 else cv2.COLOR_RGBA2BGRA)
    assert (read == turned).all()


def test_transparent_colours_stay_transparent() -> None:
    palette = np.array([[1, 2, 3, 0], [4, 5, 6, 255]], np.uint8)
    uri = png_uri(np.array([[0, 1]], np.uint8), palette)
    data = base64.b64decode(uri.removeprefix("data:image/png;base64,"))
    read = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert read[0, :, 3].tolist() == [0, 255]


@pytest.mark.parametrize("shape", [(0, 3), (2, 2, 2), (3,), (2, 2, 3, 1)])
def test_what_is_no_picture_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="a picture is"):
        png(np.zeros(shape, np.uint8))
    with pytest.raises(ValueError, match="palette"):
        png(np.zeros((2, 2), np.uint8))


@given(st.integers(20, 2000), st.floats(1e-3, 50.0))
def test_a_scale_bar_is_round_and_fits(width: int, pixel_m: float) -> None:
    made = picture(np.zeros((4, width), np.uint8), "nothing", np.zeros((2, 3), np.uint8), pixel_m)
    value, unit = made.bar_text.split()
    length_m = float(value) * {"m": 1.0, "cm": 0.01}[unit]
    assert 9.9 <= made.bar_percent <= 25.1
    assert length_m == pytest.approx(made.bar_percent / 100 * width * pixel_m, rel=1e-3)
    assert f"{length_m:e}"[0] in "125"

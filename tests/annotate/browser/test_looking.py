"""What is seen: views, colours, sizes, names and roles, at both widths and in both schemes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from PIL import Image

SCHEMES = ("light", "dark")
WIDTHS = {1280: {"width": 1280, "height": 800}, 390: {"width": 390, "height": 844}}
TARGET_PX = 44

# Machado, Oliveira and Fernandes (2009), severity 1, on linear RGB
BLINDNESS = {
    "none": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
APART = 14.0  # CIE76 in Lab; about 2.3 is just noticeable

# All texts that are visible, with the colours of text and ground; buttons and fields with their sizes.
TEXTS = """() => {
  const solid = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const ground = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const colour = solid(getComputedStyle(e).backgroundColor);
      if (colour.length === 3 || colour[3] === 1) return colour.slice(0, 3);
    }
    return [255, 255, 255];
  };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim() || !element.checkVisibility({ visibilityProperty: true })) continue;
    if (element.closest(".hidden, .skip, svg, noscript, :disabled")) continue;
    const style = getComputedStyle(element);
    const ink = solid(style.color).slice(0, 3);
    found.push([walker.currentNode.data.trim(), ink, ground(element), Number(style.opacity)]);
  }
  return found;
}"""

# What can be operated: its accessible name as far as this page gives them, its role, its size.
OPERATED = """() => [...document.querySelectorAll("button, a, input, textarea, summary, [tabindex='0'], [role]")]
  .filter((e) => e.checkVisibility({ visibilityProperty: true }) && !e.closest(".hidden, .skip"))
  .map((e) => {
    const ids = (e.getAttribute("aria-labelledby") || "").split(" ").filter(Boolean);
    const labelled = ids.map((id) => document.getElementById(id)?.textContent).join(" ");
    const name = labelled || e.getAttribute("aria-label") || e.labels?.[0]?.textContent || e.textContent || "";
    const { width, height } = e.getBoundingClientRect();
    return { tag: e.tagName.toLowerCase(), id: e.id, role: e.getAttribute("role"), name: name.trim(), width, height };
  })"""


def linear(colour: Sequence[float]) -> np.ndarray:
    values = np.asarray(colour, float) / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def contrast(one: Sequence[float], other: Sequence[float]) -> float:
    """The ratio of WCAG 2."""
    light, dark = sorted((float(linear(colour) @ (0.2126, 0.7152, 0.0722)) for colour in (one, other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def lab(rgb: np.ndarray) -> np.ndarray:
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ np.clip(rgb, 0.0, 1.0) / (0.9505, 1.0, 1.089)
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def painted(page: Any) -> np.ndarray:
    """The stage's pixels without what is drawn over them."""
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    page.locator("#marks").evaluate("e => e.setAttribute('visibility', 'hidden')")
    png = page.locator("#stage").screenshot(scale="css")
    page.locator("#marks").evaluate("e => e.removeAttribute('visibility')")
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), int)


def colours(page: Any) -> dict[str, tuple[int, ...]]:
    """The colours of the maps as the style sheet has them now."""
    names = ["void", "known", "own-free", "own-wall", "donor-free", "donor-wall", "one-free", "one-wall"]
    names += ["both-free", "both-wall", "donor-hits", "own-hits"]
    read = "names => names.map(n => getComputedStyle(document.body).getPropertyValue('--map-' + n).trim())"
    found = page.evaluate(read, names)
    return {name: tuple(bytes.fromhex(value[1:])) for name, value in zip(names, found, strict=True)}


def share(pixels: np.ndarray, colour: tuple[int, ...]) -> float:
    return float((np.abs(pixels - colour).max(axis=2) <= 2).mean())


@pytest.mark.parametrize("scheme", SCHEMES)
def test_three_views_show_what_they_say(server: Any, visit: Any, scheme: str) -> None:
    page = visit(server, f"views-{scheme}", color_scheme=scheme)
    known = colours(page)
    both = painted(page)
    assert share(both, known["own-wall"]) > 0.005
    assert share(both, known["donor-wall"]) > 0.005
    page.keyboard.press("s")
    assert "only alpha" in page.locator("#alone").inner_text()
    own = painted(page)
    assert share(own, known["own-wall"]) > 0.01
    assert share(own, known["donor-wall"]) < 0.001
    page.keyboard.press("s")
    assert "only beta" in page.locator("#alone").inner_text()
    donor = painted(page)
    assert share(donor, known["donor-wall"]) > 0.01
    assert share(donor, known["own-wall"]) < 0.001
    page.keyboard.press("d")
    page.keyboard.press("Shift+ArrowLeft")  # something contradicts then
    difference = painted(page)
    for name in ("both-free", "donor-hits", "own-hits"):
        assert share(difference, known[name]) > 0.001, name
    page.keyboard.press("o")
    page.locator("#opacity").fill("0")
    faded = painted(page)
    assert share(faded, known["donor-wall"]) < 0.001
    assert share(faded, known["own-wall"]) > 0.005


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_colour_blind_tell_the_maps_apart(server: Any, visit: Any, scheme: str) -> None:
    page = visit(server, f"blind-{scheme}", color_scheme=scheme)
    known = colours(page)
    together = [
        ("own-wall", "donor-wall", "void", "known"),
        ("donor-hits", "own-hits", "both-wall", "both-free"),
    ]
    for kind, matrix in BLINDNESS.items():
        for one, other in (pair for view in together for pair in combinations(view, 2)):
            a, b = (lab(matrix @ linear(known[name])) for name in (one, other))
            assert np.linalg.norm(a - b) > APART, (kind, one, other, np.linalg.norm(a - b))


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("width", WIDTHS)
def test_texts_have_contrast_and_nothing_overflows(server: Any, visit: Any, scheme: str, width: int) -> None:
    page = visit(server, f"reading-{scheme}-{width}", color_scheme=scheme, viewport=WIDTHS[width])
    page.keyboard.press("w")
    page.wait_for_selector("#last:not(:empty)")
    page.keyboard.press("i")
    for step in ("page", "help"):
        if step == "help":
            page.keyboard.press("?")
        texts = page.evaluate(TEXTS)
        assert len(texts) > 30
        low = [text for text, ink, ground, seen in texts if contrast(blend(ink, ground, seen), ground) < 4.5]
        assert low == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(
            "document.getElementById('help').scrollWidth <= document.getElementById('help').clientWidth + 1"
        )


def blend(ink: Sequence[float], ground: Sequence[float], seen: float) -> np.ndarray:
    return seen * np.asarray(ink, float) + (1.0 - seen) * np.asarray(ground, float)


@pytest.mark.parametrize("width", WIDTHS)
def test_the_first_page_asks_for_a_name(server: Any, chromium: Any, width: int) -> None:
    page = chromium.new_context(viewport=WIDTHS[width], color_scheme="dark").new_page()
    page.goto(server.address)
    texts = page.evaluate(TEXTS)
    assert [text for text, ink, ground, seen in texts if contrast(blend(ink, ground, seen), ground) < 4.5] == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.get_by_label("Your name").bounding_box()["height"] >= TARGET_PX
    assert page.get_by_role("button", name="Begin").is_visible()
    page.context.close()


@pytest.mark.parametrize("width", WIDTHS)
def test_everything_has_a_name_and_fingers_hit_it(server: Any, visit: Any, width: int) -> None:
    page = visit(server, f"naming-{width}", viewport=WIDTHS[width], has_touch=width < 400)
    found = page.evaluate(OPERATED)
    assert len(found) > 20
    for one in found:
        if one["role"] not in ("status", "alert"):
            assert one["name"], one
        touched = one["tag"] in ("button", "input", "textarea", "summary") or one["id"] == "stage"
        if width < 400 and touched:
            assert min(one["width"], one["height"]) >= TARGET_PX - 0.5, one
    knob = page.locator("[data-mark=grip]").get_attribute("r")
    assert 2 * float(knob) >= TARGET_PX
    tree = page.locator("body").aria_snapshot()
    for said in (
        'heading "Does beta',
        "application",
        'button "Right',
        'group "View"',
        'slider "Opacity',
        'progressbar "Answered',
    ):
        assert said in tree, said
    assert page.locator("html").get_attribute("lang") == "en"
    assert page.locator("h1").count() == 1
    ids = page.evaluate("[...document.querySelectorAll('[id]')].map(e => e.id)")
    assert len(ids) == len(set(ids))


def test_focus_is_seen_and_what_comes_next_is_said(server: Any, visit: Any) -> None:
    page = visit(server, "hearing")
    for _ in range(12):
        page.keyboard.press("Tab")
        outline = page.evaluate("getComputedStyle(document.activeElement).outline")
        assert "3px" in outline and "solid" in outline
    said = page.locator("#said")
    page.keyboard.press("w")
    page.wait_for_function(EXPECTED, arg="Saved: wrong.")
    text = said.text_content()
    assert "Does beta’s map lie right on alpha’s?" in text
    assert "1 of 160 answered" in text
    page.keyboard.press("z")
    page.wait_for_function(EXPECTED, arg="Undone.")
    page.keyboard.press("ArrowRight")
    page.wait_for_function(EXPECTED, arg="from the proposal")
    page.keyboard.press("d")
    page.wait_for_function(EXPECTED, arg="What they say of each other")
    page.keyboard.press("i")
    assert "Both know" in page.locator("#words").inner_text()
    page.keyboard.press("ArrowLeft")
    assert page.locator("#words").inner_text() == ""  # it was about where the map lay


EXPECTED = "words => document.getElementById('said').textContent.includes(words)"


def test_nothing_moves_by_itself_where_that_is_not_wanted(server: Any, visit: Any) -> None:
    calm = visit(server, "calm", reduced_motion="reduce")
    calm.keyboard.press("b")
    assert calm.locator("#blink").get_attribute("aria-pressed") == "false"
    assert calm.locator("#alone").inner_text() == "only alpha"
    calm.wait_for_timeout(1200)
    assert calm.locator("#alone").inner_text() == "only alpha"
    calm.keyboard.press("b")
    assert calm.locator("#alone").inner_text() == "only beta"
    moving = visit(server, "moving")
    moving.keyboard.press("b")
    moving.locator("#alone", has_text="only beta").wait_for()
    moving.locator("#alone", has_text="only alpha").wait_for()
    moving.keyboard.press("o")
    assert moving.locator("#blink").get_attribute("aria-pressed") == "false"


def test_the_scale_bar_is_true(server: Any, visit: Any) -> None:
    page = visit(server, "measuring")
    for _ in range(3):
        page.keyboard.press("-")
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        said = page.locator("[data-mark=length]").text_content().split()
        metres = float(said[0]) * (0.01 if said[1] == "cm" else 1.0)
        left, right = page.locator("[data-mark=bar]").evaluate(
            "e => { const b = e.getBBox(); return [b.x, b.x + b.width]; }"
        )
        points = page.locator("[data-mark=ghost]").get_attribute("points").split()
        corners = np.array([point.split(",") for point in points], float)
        width_m = 55 * 0.2  # of the donor's maps among the toys
        assert (right - left) / metres == pytest.approx(np.linalg.norm(corners[1] - corners[0]) / width_m, rel=1e-3)

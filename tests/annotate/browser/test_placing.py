"""The overlaid map is moved and turned by mouse, fingers and keys, and where it is left is what is stored."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from toy_examples import write_toys

from mapgraft.contracts import Transform
from mapgraft.examples import ExampleFolder, Word

CELLS, DEGREES = 2, 0.5  # by which what is stored may differ from where it was dropped


@dataclass(frozen=True)
class Drawn:
    """What is drawn on the stage, as seen on the screen: corners of the donor's map where it lies, and as proposed."""

    outline: np.ndarray
    ghost: np.ndarray
    knob: tuple[float, float]
    pivot: tuple[float, float]
    proposed: Transform
    corners: np.ndarray  # of the donor's map, in its own frame

    def seen(self) -> Transform:
        """Where the donor's map lies by what one sees, the scale of the screen taken from the proposal."""
        pixels_m, turn = similar(self.proposed.apply(self.corners), self.ghost)
        assert math.isclose(turn, 0.0, abs_tol=1e-6)  # north is up
        _, yaw_rad = similar(self.corners, self.outline)
        turned = Transform.planar(0.0, 0.0, yaw_rad).apply(self.corners)
        lies = self.proposed.apply(self.corners) + (self.outline - self.ghost) * (1, -1) / pixels_m
        return Transform.planar(*(lies - turned).mean(axis=0).tolist(), yaw_rad)

    def on_screen(self, T: Transform) -> np.ndarray:
        """Where the corners would be seen under a transform."""
        pixels_m, _ = similar(self.proposed.apply(self.corners), self.ghost)
        return self.ghost + (T.apply(self.corners) - self.proposed.apply(self.corners)) * pixels_m * (1, -1)


def similar(metres: np.ndarray, pixels: np.ndarray) -> tuple[float, float]:
    """Scale and turn that lead from metres to pixels of the screen, whose y points down."""
    a, b = metres - metres.mean(axis=0), (pixels - pixels.mean(axis=0)) * (1, -1)
    za, zb = a[:, 0] + 1j * a[:, 1], b[:, 0] + 1j * b[:, 1]
    ratio = complex(np.vdot(za, zb) / np.vdot(za, za))
    return abs(ratio), math.atan2(ratio.imag, ratio.real)


def drawn(page: Any) -> Drawn:
    def points(name: str) -> np.ndarray:
        found = page.locator(f"[data-mark={name}]").get_attribute("points")
        return np.array([pair.split(",") for pair in found.split()], float)

    def centre(name: str) -> tuple[float, float]:
        mark = page.locator(f"[data-mark={name}]")
        return float(mark.get_attribute("cx")), float(mark.get_attribute("cy"))

    places = json.loads(page.locator("#example").get_attribute("data-places"))
    proposed, donor = places["hypotheses"][0], places["donor"]
    w, h = (size * donor["px_m"] for size in SIZE_PX)
    corners = np.array([(0, 0), (w, 0), (w, h), (0, h)]) + np.array([donor["x_m"], donor["y_m"]])
    T = Transform.planar(proposed["x_m"], proposed["y_m"], proposed["yaw_rad"])
    return Drawn(points("outline"), points("ghost"), centre("knob"), centre("pivot"), T, corners)


SIZE_PX = (55, 45)  # of the donor's maps among the toys


def settled(page: Any) -> Drawn:
    """What is drawn, when all is drawn that was asked for."""
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return drawn(page)


def drag(page: Any, start: Sequence[float], end: Sequence[float], steps: int = 8) -> None:
    edge = page.locator("#stage").bounding_box()
    page.mouse.move(edge["x"] + start[0], edge["y"] + start[1])
    page.mouse.down()
    page.mouse.move(edge["x"] + end[0], edge["y"] + end[1], steps=steps)
    page.mouse.up()


def turn_knob(page: Any, angle: float) -> None:
    """Take the knob, and lead it around the point that is turned about, counter-clockwise."""
    now = settled(page)
    edge = page.locator("#stage").bounding_box()
    (px, py), (kx, ky) = now.pivot, now.knob
    start, arm = math.atan2(py - ky, kx - px), math.hypot(kx - px, ky - py)
    page.mouse.move(edge["x"] + kx, edge["y"] + ky)
    page.mouse.down()
    for part in np.linspace(0.0, angle, 16)[1:].tolist():
        page.mouse.move(edge["x"] + px + arm * math.cos(start + part), edge["y"] + py - arm * math.sin(start + part))
    page.mouse.up()


def answer(page: Any, key: str) -> None:
    before = page.locator("#stage").get_attribute("data-shown")
    page.keyboard.press(key)
    page.wait_for_selector(f"#stage[data-shown]:not([data-shown='{before}'])")


def last_word(folder: Path, annotator: str) -> Word:
    return [word for word in ExampleFolder(folder).words() if word.annotator == annotator][-1]


def example_of(folder: Path, annotator: str) -> dict[str, Any]:
    return ExampleFolder(folder).row(last_word(folder, annotator).key, ["truth", "truth_T", "T_receiver_donor"])


def until_wrong(page: Any, folder: Path, name: str) -> Transform:
    """Skip to an example whose proposal is wrong; where its map really belongs."""
    for _ in range(30):
        n = int(page.locator("#example").get_attribute("data-n"))
        row = ExampleFolder(folder).row(ExampleFolder(folder).keys[n], ["truth", "truth_T"])
        if row["truth"] == "wrong":
            return Transform(np.reshape(row["truth_T"], (4, 4)))
        answer(page, "n")
    raise AssertionError("thirty right ones in a row")


def test_a_map_is_dragged_and_turned_into_place(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "placing")
    truth = until_wrong(page, examples, "placing")
    page.keyboard.press("f")  # everything, so that there is room
    now = settled(page)
    turn_knob(page, math.remainder(truth.yaw_rad - now.proposed.yaw_rad, math.tau))
    now = settled(page)
    way = (now.on_screen(truth) - now.outline).mean(axis=0)
    middle = np.array([400.0, 300.0])
    drag(page, middle, middle + way)
    dropped = settled(page).seen()
    answer(page, "r")
    word = last_word(examples, "placing")
    assert word.label == "wrong"  # what was proposed
    assert word.T_receiver_donor is not None
    corners = now.corners
    assert np.abs(word.T_receiver_donor.apply(corners) - dropped.apply(corners)).max() <= CELLS * 0.2
    shift_m, turn_rad = word.T_receiver_donor.difference(dropped)
    assert shift_m <= CELLS * 0.2
    assert math.degrees(turn_rad) <= DEGREES
    shift_m, turn_rad = word.T_receiver_donor.difference(truth)  # and it was led to where it belongs
    assert shift_m <= CELLS * 0.2
    assert math.degrees(turn_rad) <= DEGREES


def test_arrow_keys_move_by_cells_and_turn_by_half_degrees(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "stepping")
    start = settled(page).proposed
    step = json.loads(page.locator("#example").get_attribute("data-places"))["step_m"]
    for key in ("ArrowRight", "ArrowRight", "ArrowUp", "Shift+ArrowLeft", "Shift+ArrowDown"):
        page.keyboard.press(key)
    moved = settled(page).seen()
    assert (moved.x_m - start.x_m, moved.y_m - start.y_m) == pytest.approx((-8 * step, -9 * step), abs=1e-6)
    pivot = settled(page).pivot
    for key in (",", "[", "[", ".", "<", "{", ">", "]"):
        page.keyboard.press(key)
    turned = settled(page)
    assert math.degrees(turned.seen().yaw_rad - start.yaw_rad) == pytest.approx(1.5 + 10.0 - 5.0 - 1.0)
    assert turned.pivot == pytest.approx(pivot, abs=1e-6)  # what it is turned about stays


def test_what_was_moved_a_little_is_right_with_the_place(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "refining")
    start = settled(page).proposed
    step = json.loads(page.locator("#example").get_attribute("data-places"))["step_m"]
    page.keyboard.press("ArrowLeft")
    assert page.locator("#right").inner_text().split("\n")[0].startswith("Right")
    assert "place refined" in page.locator("#right").inner_text()
    answer(page, "r")
    word = last_word(examples, "refining")
    assert word.label == "right"
    assert word.T_receiver_donor is not None
    assert word.T_receiver_donor.x_m == pytest.approx(start.x_m - step)
    assert word.T_receiver_donor.yaw_rad == pytest.approx(start.yaw_rad)


def test_wrong_and_unsure_give_no_place_and_put_back_takes_a_move_back(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "leaving")
    page.keyboard.press("Shift+ArrowLeft")
    answer(page, "w")
    assert (last_word(examples, "leaving").label, last_word(examples, "leaving").T_receiver_donor) == ("wrong", None)
    page.keyboard.press("Shift+ArrowUp")
    page.keyboard.press("<")
    page.keyboard.press("0")
    now = settled(page)
    assert np.allclose(now.outline, now.ghost)
    assert "as proposed" in page.locator("#pose").inner_text()
    answer(page, "r")
    word = last_word(examples, "leaving")
    assert word.label == "right"
    assert word.T_receiver_donor is not None
    assert np.allclose(word.T_receiver_donor.matrix, word.T_judged.matrix)


def test_a_map_that_is_dropped_where_it_was_snaps_back(server: Any, visit: Any) -> None:
    page = visit(server, "snapping")
    drag(page, (400, 300), (520, 340))
    assert not np.allclose(settled(page).outline, settled(page).ghost)
    drag(page, (520, 340), (403, 302))
    now = settled(page)
    assert np.allclose(now.outline, now.ghost)
    assert "Snapped back" in page.locator("#said").inner_text()


def test_shift_drag_turns_and_panning_moves_the_view_only(server: Any, visit: Any) -> None:
    page = visit(server, "dragging")
    now = settled(page)
    page.keyboard.down("Shift")
    px, py = now.pivot
    drag(page, (px + 100, py), (px, py - 100))
    page.keyboard.up("Shift")
    turned = settled(page)
    assert turned.seen().yaw_rad - now.proposed.yaw_rad == pytest.approx(math.pi / 2, abs=0.01)
    page.keyboard.press("v")
    drag(page, (300, 300), (350, 320))
    after = settled(page)
    assert after.seen().difference(turned.seen())[0] < 1e-6
    assert np.allclose(after.outline - turned.outline, (50, 20), atol=0.5)
    page.keyboard.press("v")
    page.mouse.move(500, 400)
    page.mouse.wheel(0, -400)
    zoomed = settled(page)
    assert np.ptp(zoomed.outline[:, 0]) > 1.3 * np.ptp(after.outline[:, 0])
    assert zoomed.seen().difference(turned.seen())[0] < 1e-6


def test_another_proposed_place_can_be_called_right(tmp_path: Path, start: Callable[..., Any], visit: Any) -> None:
    write_toys(tmp_path, 1)
    there = {"x_m": 1.5, "y_m": -2.0, "yaw_rad": 0.75, "scale": 1.0, "score": 1.0}
    rewrite(tmp_path, hypotheses=lambda old: [*old, there])
    page = visit(start(tmp_path), "choosing")
    assert page.get_by_role("group", name="Proposed places").get_by_role("button").count() == 2
    page.keyboard.press("2")
    assert page.locator("#pose").inner_text().startswith("x 1.50 m, y -2.00 m, 43.0°")
    assert "where it lies now" in page.locator("#right").inner_text()
    page.keyboard.press("r")
    page.locator("#example.done").wait_for()
    word = last_word(tmp_path, "choosing")
    assert word.label == "wrong"  # what is judged is what the robot held for best
    assert word.T_receiver_donor is not None
    assert np.allclose(word.T_receiver_donor.matrix, Transform.planar(1.5, -2.0, 0.75).matrix)


def test_where_nothing_was_proposed_a_place_is_asked_for(tmp_path: Path, start: Callable[..., Any], visit: Any) -> None:
    write_toys(tmp_path, 2)
    nowhere = dict.fromkeys(("x_m", "y_m", "yaw_rad", "score", "margin"), lambda _old: None)
    matrix = {"T_receiver_donor": lambda _old: [math.nan] * 16}
    rewrite(tmp_path, hypotheses=lambda _old: [], **matrix, **nowhere)
    page = visit(start(tmp_path), "nowhere")
    assert page.locator("#question").inner_text() == "Where does beta’s map belong on alpha’s?"
    assert "nothing was proposed" in page.locator("#pose").inner_text()
    x_m, y_m = (float(word) for word in re.findall(r"(-?[\d.]+) m", page.locator("#pose").inner_text())[:2])
    page.keyboard.press("Shift+ArrowRight")
    step = json.loads(page.locator("#example").get_attribute("data-places"))["step_m"]
    answer(page, "r")
    word = last_word(tmp_path, "nowhere")
    assert word.label == "right"
    assert word.T_receiver_donor is not None
    assert (word.T_receiver_donor.x_m, word.T_receiver_donor.y_m) == pytest.approx((x_m + 10 * step, y_m), abs=0.006)
    page.keyboard.press("w")
    page.locator("#example.done").wait_for()
    assert (last_word(tmp_path, "nowhere").label, last_word(tmp_path, "nowhere").T_receiver_donor) == ("wrong", None)


def rewrite(folder: Path, **columns: Callable[[Any], Any]) -> None:
    """Write the examples again with other values in some columns."""
    (path,) = (folder / "examples").glob("run_id=*/part-*.parquet")
    table = pq.ParquetFile(path).read()
    for name, change in columns.items():
        at = table.schema.get_field_index(name)
        values = pa.array([change(old) for old in table[name].to_pylist()], table.schema.field(at).type)
        table = table.set_column(at, table.schema.field(at), values)
    pq.write_table(table, path)


def test_one_finger_moves_and_two_turn_and_zoom(server: Any, visit: Any) -> None:
    page = visit(server, "fingers", viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    edge = page.locator("#stage").bounding_box()
    touch = page.context.new_cdp_session(page)

    def at(kind: str, *fingers: tuple[float, float]) -> None:
        points = [{"x": edge["x"] + x, "y": edge["y"] + y, "id": i} for i, (x, y) in enumerate(fingers)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    start = settled(page)
    at("touchStart", (100, 100))
    for part in range(1, 7):
        at("touchMove", (100 + 10 * part, 100 + 5 * part))
    at("touchEnd")
    moved = settled(page)
    assert np.allclose(moved.outline - start.outline, (60, 30), atol=1.5)
    at("touchStart", (120, 200))
    at("touchStart", (120, 200), (220, 200))
    for part in np.linspace(0.0, math.radians(40), 20).tolist():
        x, y = 60 * math.cos(part), 60 * math.sin(part)
        at("touchMove", (170 - x, 200 + y), (170 + x, 200 - y))  # counter-clockwise on the screen
    at("touchEnd")
    turned = settled(page)
    turn = math.degrees(turned.seen().yaw_rad - moved.seen().yaw_rad)
    assert 30.0 < turn < 40.0  # the first degrees are the fingers' own
    at("touchStart", (150, 200))
    at("touchStart", (150, 200), (190, 200))
    for spread in range(20, 81, 4):
        at("touchMove", (170 - spread, 200), (170 + spread, 200))
    at("touchEnd")
    zoomed = settled(page)
    assert np.ptp(zoomed.outline[:, 0]) > 2.0 * np.ptp(turned.outline[:, 0])
    assert zoomed.seen().difference(turned.seen())[0] < 1e-6
    assert page.evaluate("scrollY") == 0


@pytest.mark.parametrize("how", ["moved", "turned"])
def test_a_drag_that_goes_on_does_not_take_the_next_map_along(server: Any, visit: Any, how: str) -> None:
    """Somebody goes on by a key with the button still down: what is dragged was the map before."""
    page = visit(server, f"dragging{how}")
    now, edge = settled(page), page.locator("#stage").bounding_box()
    x, y = now.knob if how == "turned" else (edge["width"] / 2, edge["height"] / 2)
    page.mouse.move(edge["x"] + x, edge["y"] + y)
    page.mouse.down()
    page.mouse.move(edge["x"] + x + 40, edge["y"] + y + 30, steps=4)
    assert not np.allclose(settled(page).outline, now.outline)
    answer(page, "n")
    before = settled(page)
    page.mouse.move(edge["x"] + x + 90, edge["y"] + y + 70, steps=4)
    assert np.allclose(settled(page).outline, before.outline)
    said = page.locator("#said").text_content()
    page.mouse.up()
    assert np.allclose(settled(page).outline, before.outline)
    assert page.locator("#said").text_content() == said  # nothing was dropped
    assert page.locator("#stage").get_attribute("data-act") is None
    drag(page, (x, y), (x + 40, y + 30))
    assert not np.allclose(settled(page).outline, before.outline)  # the next drag is one again


def test_a_drag_that_ends_when_all_is_answered_says_nothing(
    tmp_path: Path, start: Callable[..., Any], visit: Any
) -> None:
    write_toys(tmp_path, 1)
    page = visit(start(tmp_path), "Ida")
    edge = page.locator("#stage").bounding_box()
    page.mouse.move(edge["x"] + edge["width"] / 2, edge["y"] + edge["height"] / 2)
    page.mouse.down()
    page.mouse.move(edge["x"] + edge["width"] / 2 + 40, edge["y"] + edge["height"] / 2, steps=4)
    page.keyboard.press("r")
    page.locator("#example.done").wait_for()
    page.mouse.move(edge["x"] + 50, edge["y"] + 50, steps=4)
    page.mouse.up()  # scripts that fail are complaints, which no test may have
    assert page.locator("#question").inner_text() == "All answered"

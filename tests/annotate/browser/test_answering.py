"""Answers by keyboard and mouse: saved at once, undone, skipped, and gone on with after a reload."""

from __future__ import annotations

from collections import Counter
from itertools import cycle, islice
from pathlib import Path
from typing import Any

from mapgraft.examples import ExampleFolder, last_words

KEYS = {"r": "right", "w": "wrong", "u": "unsure"}


def shown(page: Any) -> int:
    """The example that is on the page, maps and all."""
    page.wait_for_selector("#stage[data-shown]:not([aria-busy])")
    return int(page.locator("#stage").get_attribute("data-shown"))


def another(page: Any, before: int) -> int:
    """The example that comes after another."""
    page.wait_for_selector(f"#stage[data-shown]:not([data-shown='{before}'])")
    return shown(page)


def answered(page: Any, key: str) -> int:
    """Answer with a key, wait for the next, and return which example was answered."""
    before = shown(page)
    page.keyboard.press(key)
    another(page, before)
    return before


def said(folder: Path, annotator: str) -> list[str]:
    return [word.label for word in ExampleFolder(folder).words() if word.annotator == annotator]


def test_fifty_merges_are_judged_by_keyboard(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "fifty")
    keys = list(islice(cycle("rrwu"), 50))
    judged = [answered(page, key) for key in keys]
    assert len(set(judged)) == 50
    assert page.locator("#progress b").inner_text() == "50"
    words = [word for word in ExampleFolder(examples).words() if word.annotator == "fifty"]
    assert [word.label for word in words] == [KEYS[key] for key in keys]
    assert Counter(word.label for word in last_words(words).values()) == {"right": 26, "wrong": 12, "unsure": 12}
    assert all(word.elapsed_s is not None and 0.0 <= word.elapsed_s < 60.0 for word in words)


def test_undo_takes_the_last_answers_back_one_by_one(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "undoing")
    page.locator("#note").fill("two floors")
    page.keyboard.press("Escape")
    first = answered(page, "w")
    second = answered(page, "r")
    for expected in (second, first):
        page.keyboard.press("z")
        page.wait_for_selector(f"#stage[data-shown='{expected}']")
    assert page.locator("#progress b").inner_text() == "0"
    assert page.locator("#note").input_value() == "two floors"  # what was written is not lost
    assert page.locator("#last").inner_text() == ""
    assert said(examples, "undoing") == ["wrong", "right", "withdrawn", "withdrawn"]
    page.keyboard.press("z")
    page.wait_for_selector("#alarm:not([hidden])")
    assert "nothing to undo" in page.locator("#alarm").inner_text()
    assert shown(page) == first
    page.complaints[:] = [said for said in page.complaints if "409" not in said]
    answered(page, "u")
    assert said(examples, "undoing")[-1] == "unsure"
    assert not page.locator("#alarm").is_visible()


def test_a_reload_goes_on_where_one_was(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "reloading")
    before = [answered(page, key) for key in "rwr"]
    current = shown(page)
    page.reload()
    assert shown(page) == current
    assert page.locator("#progress b").inner_text() == "3"
    assert current not in before
    answered(page, "u")
    assert said(examples, "reloading") == ["right", "wrong", "right", "unsure"]


def test_skipped_examples_come_again_and_nothing_is_written(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "skipping")
    first = answered(page, "n")
    second = answered(page, " ")
    assert first != second
    assert said(examples, "skipping") == []
    assert page.locator("#progress b").inner_text() == "0"


def test_a_reason_is_saved_with_the_answer(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "reasons")
    page.keyboard.press("t")
    page.keyboard.type("worn carpet, rrr www")  # letters are text here, no answers
    page.keyboard.press("Escape")
    page.get_by_role("button", name="map is bent").click()
    answered(page, "w")
    answered(page, "r")
    words = [word for word in ExampleFolder(examples).words() if word.annotator == "reasons"]
    assert [(word.label, word.comment) for word in words] == [
        ("wrong", "worn carpet, rrr www; map is bent"),
        ("right", ""),
    ]


def test_a_key_that_is_held_answers_once(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "holding")
    before = shown(page)
    for _ in range(5):
        page.keyboard.down("r")  # the second and later ones are repeats
    page.keyboard.up("r")
    another(page, before)
    page.wait_for_selector("#last:not(:empty)")
    assert said(examples, "holding") == ["right"]


def test_what_the_robot_made_of_it_is_told_after_the_answer_only(server: Any, visit: Any) -> None:
    page = visit(server, "revealing")
    hidden = page.content().lower()
    for word in (
        "score",
        "verdict",
        "provisional",
        "confirmed",
        "reverted",
        "unmatched",
        "ambiguous",
        "posterior",
        "alpha.beta",
    ):
        assert word not in hidden, word
    answered(page, "r")
    page.wait_for_selector("#last:not(:empty)")
    told = page.locator("#last").inner_text()
    assert "Your last answer: right" in told
    assert "score" in told
    assert "By trusted poses" in told
    page.locator("#last summary").click()
    assert page.get_by_role("rowheader", name="posterior").is_visible()


def test_the_whole_path_goes_by_keyboard_alone(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "keyboard")
    page.context.clear_cookies()
    page.goto(server.address)
    page.keyboard.type("tabbing")  # the field has the focus
    page.keyboard.press("Enter")
    page.wait_for_selector("#stage[data-shown]")
    first = shown(page)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "stage"
    order = [page.evaluate("document.activeElement.id || document.activeElement.textContent.trim()")]
    for _ in range(40):
        page.keyboard.press("Tab")
        order.append(page.evaluate("document.activeElement.id || document.activeElement.textContent.trim()"))
        if order[-1] == "unsure":
            break
    assert order.index("right") < order.index("wrong") < order.index("unsure")
    page.keyboard.press("Enter")
    another(page, first)
    assert page.evaluate("document.activeElement.id") == "unsure"  # the focus stays where it was
    assert said(examples, "tabbing") == ["unsure"]


def test_one_key_answers_can_be_switched_off(server: Any, examples: Path, visit: Any) -> None:
    page = visit(server, "dictating")
    page.keyboard.press("?")
    page.get_by_label("Answer with one key").uncheck()
    page.keyboard.press("Escape")
    before = shown(page)
    for key in "rwunz":
        page.keyboard.press(key)
    page.get_by_role("button", name="Unsure").click()
    another(page, before)
    assert said(examples, "dictating") == ["unsure"]
    page.reload()
    page.wait_for_selector("#stage[data-shown]")
    page.keyboard.press("r")
    page.keyboard.press("?")
    assert not page.get_by_label("Answer with one key").is_checked()  # remembered
    assert said(examples, "dictating") == ["unsure"]


def test_an_answer_that_was_not_saved_is_never_called_saved(server: Any, examples: Path, visit: Any) -> None:
    """Whether the server is silent or refuses: the screen reader hears it neither then nor with what comes next."""
    page = visit(server, "failing")
    for fault in (lambda route: route.abort(), lambda route: route.fulfill(status=500, body="the disk is full")):
        page.route("**/label/*", fault)
        before = shown(page)
        page.keyboard.press("r")
        page.wait_for_selector("#alarm:not([hidden])")
        page.unroute("**/label/*")
        page.keyboard.press("n")
        another(page, before)
        assert "Saved" not in page.locator("#said").text_content()
    page.complaints.clear()
    answered(page, "w")
    page.wait_for_function("document.getElementById('said').textContent.startsWith('Saved: wrong.')")
    assert said(examples, "failing") == ["wrong"]

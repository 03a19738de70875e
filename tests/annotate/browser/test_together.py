"""Two people at once, and a server that is killed: no answer is lost."""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from toy_examples import write_toys

from mapgraft.examples import ExampleFolder


def answered(page: Any, key: str) -> int:
    return answered_together([page], key)[0]


def answered_together(pages: Sequence[Any], key: str) -> list[int]:
    """Everybody answers before anybody waits: the answers are on their way at the same time."""
    before = [int(page.locator("#stage").get_attribute("data-shown")) for page in pages]
    for page in pages:
        page.keyboard.press(key)
    for page, was in zip(pages, before, strict=True):
        page.wait_for_selector(f"#stage[data-shown]:not([data-shown='{was}'])")
    return before


def said(folder: Path) -> list[tuple[str, str, str]]:
    return [(word.annotator, word.key.example_id, word.label) for word in ExampleFolder(folder).words()]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_toys(tmp_path, 40)
    return tmp_path


def test_two_annotators_answer_at_once(folder: Path, start: Callable[..., Any], visit: Any) -> None:
    server = start(folder)
    anna, bert = visit(server, "Anna"), visit(server, "Bert")
    judged: dict[str, list[int]] = {"Anna": [], "Bert": []}
    for key in "rrwurwrr":
        for name, n in zip(judged, answered_together([anna, bert], key), strict=True):
            judged[name].append(n)
    answered(anna, "r")
    ids = [key.example_id for key in ExampleFolder(folder).keys]
    words = said(folder)
    for name in ("Anna", "Bert"):
        assert [ids.index(example) for who, example, _ in words if who == name][:8] == judged[name]
        assert len(set(judged[name])) == 8
    assert len(words) == 17
    anna.reload()
    anna.wait_for_selector("#stage[data-shown]")
    anna.locator(".others summary").click()
    sheet = anna.locator(".sheet").inner_text()
    assert "Anna\t9" in sheet
    assert "Bert\t8" in sheet
    assert "κ" in sheet


def test_no_answer_is_lost_when_the_server_is_killed(folder: Path, command: Callable[..., Any], visit: Any) -> None:
    server = command(folder)
    page = visit(server, "Clara")
    judged = [answered(page, key) for key in "rwu"]
    server.end(signal.SIGKILL)
    assert [label for _, _, label in said(folder)] == ["right", "wrong", "unsure"]

    waiting = page.locator("#stage").get_attribute("data-shown")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("r")
    page.wait_for_selector("#alarm:not([hidden])")
    assert "Not saved" in page.locator("#alarm").inner_text()
    assert page.locator("#stage").get_attribute("data-shown") == waiting  # nothing is pretended
    page.context.close()

    server.start()
    page = visit(server, "Clara")
    assert page.locator("#progress b").inner_text() == "3"
    judged += [answered(page, key) for key in "rr"]
    assert len(set(judged)) == 5
    server.end(signal.SIGKILL)
    ids = [key.example_id for key in ExampleFolder(folder).keys]
    words = said(folder)
    assert [ids.index(example) for _, example, _ in words] == judged
    assert [label for _, _, label in words] == ["right", "wrong", "unsure", "right", "right"]
    page.context.close()
    page.complaints.clear()  # that a server that was killed twice could not be reached


def test_the_end_of_the_queue_is_told_and_can_be_undone(tmp_path: Path, start: Callable[..., Any], visit: Any) -> None:
    write_toys(tmp_path, 2)
    page = visit(start(tmp_path), "Dora")
    first = answered(page, "r")
    last = page.locator("#stage").get_attribute("data-shown")
    page.keyboard.press("w")
    page.locator("#example.done").wait_for()
    assert not page.locator("#stage").is_visible()
    assert page.locator("#question").inner_text() == "All answered"
    page.keyboard.press("z")
    page.wait_for_selector(f"#stage[data-shown='{last}']:not([aria-busy])")
    assert page.locator("#stage").is_visible()
    page.keyboard.press("u")
    page.locator("#example.done").wait_for()
    assert [label for _, _, label in said(tmp_path)] == ["right", "wrong", "withdrawn", "unsure"]
    assert first != int(last)


def test_names_with_script_are_text(tmp_path: Path, start: Callable[..., Any], visit: Any) -> None:
    hostile = "<script>document.title='taken'</script><img src=x onerror=\"document.title='taken'\">"
    quoted = "'\"><b>{{7*7}}</b>${alert(1)}\u202egnp"
    write_toys(tmp_path, 3)
    rename(tmp_path, receiver=hostile, donor=quoted)
    asked: list[str] = []
    server = start(tmp_path)
    page = visit(server, "Eve")
    page.on("request", lambda request: asked.append(request.url))
    for key in ("s", "d", "i", "o"):
        page.keyboard.press(key)
    assert hostile in page.locator("#question").inner_text()
    assert "'\"><b>{{7*7}}</b>" in page.locator("#question").inner_text()
    assert "\u202e" not in page.content()
    answered(page, "w")
    page.wait_for_selector("#last:not(:empty)")
    assert page.title() == "mapgraft annotate"
    assert page.locator("main img, main script").count() == 0
    host = server.address.split("/")[2]
    assert asked and all(url.split("/")[2] == host for url in asked)


def test_each_example_says_whose_maps_of_which_type(tmp_path: Path, start: Callable[..., Any], visit: Any) -> None:
    kinds = {
        "floor_plan": "floor plan",
        "point_cloud": "point cloud, seen from above",
        "line_segments": "line segments",
    }
    for number, kind in enumerate(kinds):
        write_toys(tmp_path / kind, 1, run_id=f"r{number}")
        types = {"receiver_type": "occupancy_grid", "donor_type": kind}
        rename(tmp_path / kind, receiver=f"own-{kind}", donor=f"donor-{kind}", **types)
    page = visit(start(*(tmp_path / kind for kind in kinds)), "Finn")
    seen = set()
    for _ in kinds:
        kind = page.locator("#question .donor").inner_text().removeprefix("donor-")
        assert f"own-{kind}" in page.locator("#question").inner_text()
        legend = page.locator(".legend.overlay").inner_text().split()
        assert legend == [f"own-{kind}", f"donor-{kind},", "overlaid", "walls", "of", "both"]
        assert page.locator("#stage").get_attribute("aria-label") == f"donor-{kind}’s map, laid on own-{kind}’s"
        facts = page.locator("dl.facts").first.inner_text()
        assert kinds[kind] in facts
        assert "grid map" in facts
        seen.add(kind)
        if len(seen) < len(kinds):
            answered(page, "u")
    assert seen == set(kinds)


def rename(folder: Path, **names: str) -> None:
    """Write the examples again with other names of robots, or of map types."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    (path,) = (folder / "examples").glob("run_id=*/part-*.parquet")
    table = pq.ParquetFile(path).read()
    for column, name in names.items():
        at = table.schema.get_field_index(column)
        values = pa.array([name] * len(table)).dictionary_encode().cast(table.schema.field(at).type)
        table = table.set_column(at, table.schema.field(at), values)
    pq.write_table(table, path)

"""The page of a run: whole, true to what happened, complete in itself, the same each time, and harmless."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from plots import ALPHA, AT, UNDERSCORE, Plot, PlotType, told

from mapgraft.config import Config, RobotConfig
from mapgraft.contracts import Map, OutputMessage
from mapgraft.events import DonorMap, Event, Snapshot
from mapgraft.outputs.report import page_of
from mapgraft.outputs.report.page import MOST_BYTES, MOST_MERGES

HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>{{ 7*191 }}&amp;\x1b[31m\u202egnp.exe"


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return page_of(folder)


def test_it_is_well_formed_and_its_links_lead_somewhere(page: str, read) -> None:
    found = read(page)
    ids = found.attributes("id")
    assert len(ids) == len(set(ids))
    assert {href.removeprefix("#") for href in found.attributes("href")} <= set(ids)
    assert all(len(re.findall(pattern, page)) == 1 for pattern in ("<!DOCTYPE html>", "<h1", "<main>", "</head>"))


def test_it_loads_nothing_and_runs_nothing(page: str, read) -> None:
    found = read(page)
    assert not {tag for tag, _ in found.tags} & {"script", "link", "iframe", "object", "embed", "base", "form"}
    assert all(src.startswith("data:image/png;base64,") for src in found.attributes("src"))
    assert not any(name.startswith("on") for _, attrs in found.tags for name in attrs)
    assert "http:" not in page and "https:" not in page and "@import" not in page and "url(" not in page
    policy = next(attrs["content"] for tag, attrs in found.tags if attrs.get("http-equiv"))
    assert policy == "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"


def test_every_merge_is_told_with_its_state_and_reasons(page: str, read) -> None:
    text = read(page).text
    for event in (item for item in told() if isinstance(item, Event)):
        assert event.merge_id in text or event.kind in ("unmatched", "ambiguous")
        if event.kind not in ("offered", "verified"):
            assert event.reason in text
    assert f"{ALPHA} ← {AT}" in text and f"{UNDERSCORE} ← {ALPHA}" in text
    assert "Approximate: 120 cells were set back to unknown, 3 still hold something of the donor, 2 lost" in text
    assert "cells seen since the merge stay" in text
    assert "x 20.000 ± 0.100 m, y 3.000 ± 0.141 m, yaw 17.19 ± 1.81°" in text


def test_what_was_not_merged_is_told_per_pair(page: str, read) -> None:
    text = read(page).text
    assert "no rule fits: 'all' needs a known scale" in text and "decision table" in text
    assert "alpha ← beta_2 1 time rejected, 1 time unmatched, 1 time ambiguous" in text


def test_robots_and_recordings_are_told(page: str, read) -> None:
    text = read(page).text
    assert "ab" * 32 in text and "cd" * 32 in text and "a.mcap" in text
    assert "600" in text and "12.0 m" in text  # observations and path of each robot
    assert "49.0 m²" in text and "known unit" not in text
    assert re.search(r"with merges [\d.]+ % more is known", text)
    assert "a.mcap: 3 scans were left out" in text


def test_every_mark_of_the_legend_looks_its_own_way(page: str) -> None:
    legend = page[page.index("stands: provisional, confirmed") - 6000 :].partition("stands: provisional")[0]
    marks = re.findall(r'<g class="mark \w+ (\w+)">\s*(.*?)\s*</g></svg>([^<]+)</li>', legend, re.DOTALL)
    assert {"put off as ambiguous", "in dispute, or no longer believed"} <= {text for _, _, text in marks}
    assert len({(tone, shape) for tone, shape, _ in marks}) == len(marks) == 10


def test_neither_the_machine_nor_the_hour_is_in_it(page: str) -> None:
    assert "somebody" not in page and "2026" not in page and "here" not in re.findall(r">([^<]+)<", page)


def test_the_same_folder_gives_the_same_bytes_wherever_it_lies(page: str, folder: Path, tmp_path: Path) -> None:
    assert page_of(folder) == page
    elsewhere = tmp_path / "another place"
    shutil.copytree(folder, elsewhere)
    assert page_of(elsewhere) == page


@pytest.mark.parametrize("side", ("receiver", "donor"))
def test_names_are_shown_and_never_obeyed(side: str, many, finish, read, tmp_path: Path) -> None:
    story = many(4, **{side: HOSTILE})
    config = Config(robots={"a": RobotConfig(source=HOSTILE)})
    page = page_of(finish(tmp_path / "out", story, config))
    found = read(page)
    assert "<script" not in page and "\x1b" not in page and "\u202e" not in page
    assert not any("onerror" in attrs for _, attrs in found.tags)
    assert "<script>alert(1)</script>" in found.text and "{{ 7*191 }}&amp;" in found.text and "1337" not in found.text


def test_very_long_names_stay_readable(many, finish, read, tmp_path: Path) -> None:
    long = "x" * 4000
    page = page_of(finish(tmp_path / "out", many(3, donor=long), None))
    found = read(page)
    labels = [attrs["aria-label"] for _, attrs in found.tags if "aria-label" in attrs]
    assert all(len(label) < 200 for label in (*labels, *found.attributes("alt")))
    assert len(page) < 400_000


def test_of_many_merges_the_telling_ones_are_told_and_all_are_listed(many, finish, read, tmp_path: Path) -> None:
    page = page_of(finish(tmp_path / "out", many(150)))
    found = read(page)
    cards = [attrs["id"] for tag, attrs in found.tags if tag == "article" and "id" in attrs]
    assert len(cards) == MOST_MERGES
    assert cards == [f"merge-{n}" for n in range(148, 148 - 3 * MOST_MERGES, -3)]  # the latest reverted ones
    assert f"{MOST_MERGES} of 150 merges are told below" in found.text
    for n in range(150):
        assert f"alpha.bravo.{n + 1} " in found.text
        assert f"{'reverted' if n % 3 == 0 else 'merged'} because of {n} " in found.text
    assert sum(map(len, found.attributes("src"))) < MOST_BYTES * 1.05 and len(page) < 5_000_000


def test_the_pictures_of_a_merge_show_it_before_and_after(many, finish, read, tmp_path: Path) -> None:
    found = read(page_of(finish(tmp_path / "out", many(1))))
    assert [alt for alt in found.attributes("alt") if "end" not in alt] == [
        "alpha's map and bravo's on each other at the merge",
        "where alpha's map and bravo's agree and contradict at the merge",
        "alpha's merged map with what came in",
        "alpha's map and bravo's on each other just before it was reverted",
        "where alpha's map and bravo's agree and contradict just before it was reverted",
        "alpha's merged map before the revert",
        "alpha's map after alpha.bravo.1 was reverted",
    ]
    own, other = (
        {(x, y) for x in xs for y in ys} for xs, ys in ((range(30), range(20)), (range(10, 45), range(5, 25)))
    )
    joint = own & other
    against = sum((x % 7 == 0) != (x % 5 == 0) for x, _ in joint)
    percent = 100 * against / len(joint)
    assert (
        f"{len(joint) * 0.25:.1f} m² known to both: {100 - percent:.1f} % agree, {percent:.1f} % contradict"
        in found.text
    )


def test_the_numbers_with_limits_come_first(many, finish, read, tmp_path: Path) -> None:
    found = read(page_of(finish(tmp_path / "out", many(2))))
    assert "log_odds : 1; reverted at 1.5" in found.text
    assert "similarity : 0.6; confirmed at 0.85" in found.text


def test_nothing_merged_and_nobody_to_merge_with_is_said(finish, read, tmp_path: Path) -> None:
    story = [item for item in told() if not isinstance(item, Event)]
    assert "No merge was made." in read(page_of(finish(tmp_path / "three", story))).text
    alone = [item for item in story if item.robot == ALPHA]
    text = read(page_of(finish(tmp_path / "one", alone))).text
    assert "No merge was made: there was only one robot." in text and "Nothing was decided" in text


def test_without_snapshots_it_says_why_there_are_no_pictures(many, finish, read, tmp_path: Path) -> None:
    story = [item for item in many(2) if isinstance(item, Event)]
    text = read(page_of(finish(tmp_path / "out", story))).text
    assert "There are no pictures of merges" in text and "alpha.bravo.1" in text


class Outlines(PlotType):
    """The type of ``plots``, shown in a message that nobody draws."""

    def messages(self, map_: Map) -> list[OutputMessage]:
        return [OutputMessage("outline", "geometry_msgs/msg/PolygonStamped", {})]


def test_maps_that_have_no_picture_are_named(many, finish, read, tmp_path: Path) -> None:
    outlines = Outlines()
    shown = {"a": DonorMap(outlines, Plot({(0, 0): 0}))}
    changes = {"map_type": outlines, "donors": shown}
    story = [replace(item, **changes) if isinstance(item, Snapshot) else item for item in many(2)]
    found = read(page_of(finish(tmp_path / "out", story)))
    assert "No picture: its map is shown as geometry_msgs/msg/PolygonStamped." in found.text
    assert not found.attributes("src")


def test_it_needs_no_plugin(folder: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from mapgraft.commands.report import page_of\n"
        "page_of(Path(sys.argv[1]))\n"
        "print({name.split('.')[0] for name in sys.modules if name.startswith('mapgraft_')})"
    )
    done = subprocess.run([sys.executable, "-c", code, folder], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "{'mapgraft_schemas'}"


def test_what_the_configuration_changes_is_listed_without_places(finish, read, tmp_path: Path) -> None:
    config = Config.model_validate(
        {"reversal": "multi_map", "rules": "/home/somebody/rules.yaml", "robots": {"a": {"map": {"resolution_m": 0.1}}}}
    )
    page = page_of(finish(tmp_path / "out", list(told()), config))
    text = read(page).text
    assert "reversal multi_map ledger" in text and "robots.a.map.resolution_m 0.1 –" in text
    assert "rules.yaml" in text and "somebody" not in page

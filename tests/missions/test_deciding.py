"""Attempts that are put off name the place that would decide, in the events, the tables and the report."""

from __future__ import annotations

import pyarrow.parquet as pq
import pytest

import mapgraft
from mapgraft.plugins import load_plugins
from mapgraft_recordings import demo_files

FILES = demo_files()[0][:2]


@pytest.fixture(scope="module")
def put_off(tmp_path_factory):
    """A run in which nothing is sure enough, and its folder."""
    from mapgraft.decision import build_table

    table = build_table(load_plugins())
    (rule,) = [r.rule for r in table.records if r.rule.name == "grids of any resolution"]
    told = rule.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    told["accept"] = {**told["accept"], "provisional": 0.9999999}
    folder = tmp_path_factory.mktemp("run") / "out"
    config = {"rules": [told], "exchange": {"use": "at", "seconds": [120]}, "mission": {"end_s": 122}}
    return mapgraft.run(FILES, config, folder), folder


def test_the_event_names_the_place(put_off):
    result, _ = put_off
    events = [event for event in result.events if event.kind == "ambiguous"]
    assert {event.receiver for event in events} == {"alpha", "bravo"}
    for event in events:
        (place,) = [m for m in event.measurements if m.name == "deciding_place"]
        assert place.value == event.evidence["deciding_nats"] > 1.0
        (finding,) = place.findings
        stand = (event.evidence["deciding_x_m"], event.evidence["deciding_y_m"], 0.0)
        assert finding.kind == "deciding place" and finding.start_m == stand
        assert f"from ({stand[0]:.1f}, {stand[1]:.1f}) m a look at " in event.reason
        own = result.maps[event.receiver].own.dense()
        row, column = (
            (at - origin) / own.resolution_m for at, origin in zip(stand[1::-1], own.origin_m[::-1], strict=True)
        )
        around = own.classes[int(row) - 3 : int(row) + 4, int(column) - 3 : int(column) + 4]
        assert (around == 1).any()  # in its own free space


def test_it_is_in_the_tables_and_on_the_map_of_the_report(put_off):
    result, folder = put_off
    rows = pq.read_table(folder / "metrics").to_pylist()
    assert sum(row["metric"] == "deciding_place" for row in rows) == 2
    page = (folder / "report.html").read_text()
    assert page.count('<circle class="look"') == 2 and page.count("to decide about") == 2
    place = next(event for event in result.events if event.kind == "ambiguous").evidence
    assert f"look from ({place['deciding_x_m']:.1f}, {place['deciding_y_m']:.1f}) m" in page

"""Tables: the paper's numbers, averages beside them, and the files they become."""

from __future__ import annotations

import csv
import io
import math

import pyarrow.parquet as pq
import pytest

from mapgraft.experiments.andersone2021.outcome import Watched
from mapgraft.experiments.andersone2021.settings import PAPER
from mapgraft.experiments.andersone2021.telling.as_published import costs_table, paper_tables
from mapgraft.experiments.andersone2021.telling.beyond import searches_table, verdicts_table, ways_table
from mapgraft.experiments.andersone2021.telling.detection import curves
from mapgraft.experiments.andersone2021.telling.published import published
from mapgraft.experiments.andersone2021.telling.tables import (
    Column,
    Number,
    Row,
    Table,
    csv_text,
    markdown,
    parquet_bytes,
)


@pytest.fixture
def table() -> Table:
    columns = [Column("a", "first", 2, "ledger", paper=True, ends=True), Column("b", "second", 0)]
    rows = [
        Row("one", ("x",), {"a": Number(1.234, 1.0, 1.5), "b": Number(1234.0)}, {"a": Number(2.0)}),
        Row("two", ("y",), {"a": Number(math.nan)}, {}, decimals=1),
    ]
    return Table("t", "A title", "A note.", ("label",), columns, rows)


def test_numbers_are_spelt_with_their_ends():
    assert Number(0.98765).text(3) == "0.988"
    assert Number(0.5, 0.25, 0.75).text(2) == "0.50 (0.25–0.75)"
    assert Number(math.nan, 0.0, 1.0).text(3) == "–"
    assert Number(-0.0001).text(2) == "0.00"
    assert Number(-12345.6).text(1) == "-12,345.6"


def test_markdown_has_the_papers_column_beside_ours(table):
    lines = markdown(table).splitlines()
    assert lines[:4] == ["### A title", "", "A note.", ""]
    assert lines[4:] == [
        "| label | first | paper | second |",
        "| --- | ---: | ---: | ---: |",
        "| x | 1.23 (1.00–1.50) | 2.00 | 1,234 |",
        "| y | – | – | – |",
    ]


def test_csv_holds_plain_numbers_under_one_header(table):
    rows = list(csv.DictReader(io.StringIO(csv_text(table))))
    assert rows[0] == {
        "row": "one",
        "label": "x",
        "a": "1.234",
        "a_low": "1.0",
        "a_high": "1.5",
        "a_paper": "2.0",
        "a_paper_low": "",
        "a_paper_high": "",
        "b": "1234.0",
    }
    assert {key: value for key, value in rows[1].items() if value} == {"row": "two", "label": "y"}


def test_parquet_is_long_with_nulls_for_what_is_not_told(table):
    rows = pq.read_table(io.BytesIO(parquet_bytes([table]))).to_pylist()
    assert [(row["row"], row["column"], row["strategy"], row["value"], row["paper_value"]) for row in rows] == [
        ("one", "a", "ledger", 1.234, 2.0),
        ("one", "b", None, 1234.0, None),
        ("two", "a", "ledger", None, None),
    ]
    assert (rows[0]["low"], rows[0]["high"], rows[0]["paper_low"]) == (1.0, 1.5, None)


def test_the_papers_numbers_are_all_there():
    numbers = published().numbers
    assert len(numbers) == 3 * 2 * 2 * 5
    number = published().number(PAPER[0], right=False, strategy="2M", quantity="end_distance")
    assert number == Number(14.570, 3.874, 20.946)
    assert published().number(PAPER[2], right=True, strategy="1M", quantity="end_similarity").value == 0.973
    assert published().number(PAPER[0], right=True, strategy="ledger", quantity="end_similarity") is None
    assert published().where == {"0.07-0.07": "table 1", "0.07-0.1": "table 2", "0.1-0.07": "table 3"}


def test_further_mapping_makes_23_of_the_papers_24_averages_worse():
    worse = []
    for combination in PAPER:
        for right in (True, False):
            for short in ("1M", "2M"):
                for metric, sign in (("similarity", -1.0), ("distance", 1.0)):
                    before, after = (
                        published().number(combination, right, short, f"{moment}_{metric}").value
                        for moment in ("initial", "end")
                    )
                    worse.append(sign * (after - before) > 0.0)
    assert (sum(worse), len(worse)) == (23, 24)


def test_averages_ranges_and_ratios_of_merges_made_by_hand(made, experiment_of):
    merges = [
        made(True, 0, one=(1.0, 0.2), two=(0.98, 1.0), costs_s=(1.0, 1.5, 0.9)),
        made(True, 1, one=(0.9, 0.4), two=(0.96, 3.0), costs_s=(3.0, 4.5, 2.7)),
        made(False, 2, one=(0.95, 2.0), two=(0.9, math.nan)),
    ]
    first, ranges = paper_tables(experiment_of(merges))
    end = first.row("end_similarity")
    assert end.cells["right_1M"].value == pytest.approx(0.95)
    assert end.cells["right_2M"] == end.cells["right_ledger"] == Number(pytest.approx(0.97))
    assert end.paper["right_1M"] == Number(0.986) and "right_ledger" not in end.paper
    assert math.isnan(first.row("end_distance").cells["wrong_2M"].value)
    assert "DM of 1 of them" in first.note and "SM" not in first.note.split("Too little")[1]
    ratios = first.row("update_ratio")
    assert (ratios.cells["right_2M"].value, ratios.cells["right_ledger"].value) == (1.5, pytest.approx(0.9))
    assert ratios.paper["right_2M"].value == pytest.approx(10.516 / 6.816)
    assert first.row("update_time").cells["right_1M"].value == pytest.approx(2000.0) and ratios.timed
    cell = ranges.row("0.07-0.07_end_distance")
    assert cell.cells["right_2M"] == Number(2.0, 1.0, 3.0)
    assert cell.paper["right_2M"] == Number(1.462, 0.270, 4.545)


def test_costs_count_the_map_for_metrics_where_there_is_another(made, experiment_of):
    table = costs_table(experiment_of([made(True, 0), made(True, 1)]))
    assert table.row("0.07-0.07_evidence_ratio").cells["right_ledger"].value == pytest.approx(0.9)
    assert table.row("0.07-0.07_compared_ratio").cells["right_ledger"].value == pytest.approx(1.4 / 1.5)
    merges = [made(True, n, costs_s=(1.0, 1.5, 0.9)) for n in (0, 1)] + [made(True, 2, costs_s=(1.0, 1.5, 99.0))]
    hiccup = costs_table(experiment_of(merges)).row("0.07-0.07_evidence_ratio")
    assert hiccup.cells["right_ledger"].value == pytest.approx(0.9)  # a hiccup of the machine moves no median
    assert table.row("0.07-0.07_revert_ms").cells["right_2M"].value == pytest.approx(100.0)
    assert all(row.timed for row in table.rows)


def test_the_three_ways_in_one_look(made, experiment_of):
    merges = [made(right, n, two=(0.95, 1.0 if right else 9.0)) for n, right in enumerate((True, True, False, False))]
    experiment = experiment_of(merges)
    table = ways_table(experiment, curves(experiment))
    one, two, ledger = table.rows
    assert [row.cells["identical"].value for row in (one, two, ledger)] == [0, 4, 4]
    assert (one.cells["lost"].value, one.cells["contaminated"].value, ledger.cells["lost"].value) == (1, 20, 0)
    assert (two.cells["distance"].value, ledger.cells["distance"].value) == (1.0, 1.0)
    assert "distance" not in one.cells  # it is the same for all: there is nothing to tell by


def test_wrong_merges_that_are_confirmed_are_counted_as_mistaken(made, experiment_of):
    actions = [(True, "revert"), (True, "confirm"), (False, "confirm"), (False, "confirm"), (False, "revert")]
    merges = [made(right, n, watched=Watched("rule", done, "", {}, {})) for n, (right, done) in enumerate(actions)]
    right, wrong = verdicts_table(experiment_of(merges)).rows[:2]
    assert (right.cells["mistaken"].value, wrong.cells["mistaken"].value) == (1, 2)


def test_searches_count_what_was_accepted(made, experiment_of):
    merges = [made(True, 0), made(True, 0, combination=PAPER[1]), made(False, 1)]
    row, _, together = searches_table(experiment_of(merges)).rows
    assert (together.cells["right_draws"].value, together.cells["wrong_draws"].value) == (1, 1)  # one draw, used twice
    assert together.cells["right_overlap"] == Number(0.5, 0.5, 0.5)
    assert {
        name: number.value for name, number in row.cells.items() if "_draws" not in name and "_overlap" not in name
    } == {
        "drawn": 9,
        "unmatched": 1,
        "refused": 1,
        "right": 3,
        "wrong": 4,
        "wrong_share": pytest.approx(400.0 / 7.0),
    }

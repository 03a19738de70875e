"""The experiment as JSON: plain values under documented keys. Times stand apart; all else is the same every time."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mapgraft.evaluation.document import finite
from mapgraft.evaluation.statistics import LEVEL, RESAMPLES
from mapgraft.evaluation.truth import RIGHT_DEG, RIGHT_M
from mapgraft.experiments.andersone2021.outcome import Experiment
from mapgraft.experiments.andersone2021.telling.choices import choices
from mapgraft.experiments.andersone2021.telling.detection import WATCHED, Curve
from mapgraft.experiments.andersone2021.telling.published import SOURCE
from mapgraft.experiments.andersone2021.telling.statements import Statement
from mapgraft.experiments.andersone2021.telling.tables import Column, Number, Row, Table
from mapgraft.experiments.andersone2021.timing import Timing
from mapgraft.outputs.provenance import RunProvenance

DOCUMENT: Final = "experiment.json"  # its name in a folder
FORMAT: Final = "mapgraft experiment andersone2021 1"


@dataclass(frozen=True, slots=True)
class Shown:
    """A figure as a page tells of it; ``file`` is its name in the folder, empty where there is nothing to show."""

    name: str
    title: str
    caption: str
    file: str


def document(
    experiment: Experiment,
    tables: Sequence[Table],
    statements: Sequence[Statement],
    curves: Sequence[Curve],
    figures: Sequence[Shown],
    provenance: RunProvenance,
    why: str = "",
) -> dict[str, Any]:
    """Everything that is told of an experiment; numbers that are not finite are None.

    ``why`` says why these recordings were taken, where nobody named any. How long everything took is not known yet
    (``timing_told``). What depends on the clock is under ``times``:
    there are the cells of timed rows and columns of ``tables``, and what was found of timed ``statements``, by name.
    """
    content: dict[str, Any] = finite(
        {
            "format": FORMAT,
            "paper": SOURCE,
            "version": provenance.version,
            "plugins": dict(sorted(provenance.plugins.items())),
            "config": provenance.config_text,
            "decision_table": provenance.decision_table_text,
            "files": [file.told | {"path": Path(file.path).name} for file in provenance.inputs],
            "why": why,
            "settings": _settings(experiment),
            "choices": [dataclasses.asdict(choice) for choice in choices(experiment)],
            "searches": [dataclasses.asdict(s) | {"combination": s.combination.name} for s in experiment.searches],
            "remarks": list(experiment.remarks),
            "statements": [_statement(one) for one in statements],
            "tables": [_table(table) for table in tables],
            "curves": [_curve(curve) for curve in curves],
            "figures": [dataclasses.asdict(figure) for figure in figures],
            "times": _times(experiment, tables, statements),
        }
    )
    return content


def tables_in(content: Mapping[str, Any]) -> list[Table]:
    """The tables of a document, times included."""
    return [_read_table(table, content["times"]["tables"].get(table["name"], {})) for table in content["tables"]]


def statements_in(content: Mapping[str, Any]) -> list[Statement]:
    """The statements of a document, times included."""
    timed = content["times"]["statements"]
    return [Statement(**{**one, **timed.get(one["name"], {})}) for one in content["statements"]]


def _settings(experiment: Experiment) -> dict[str, Any]:
    return {
        **dataclasses.asdict(experiment.settings),
        "combinations": [
            {"name": c.name, "own_m": c.own_m, "other_m": c.other_m} for c in experiment.settings.combinations
        ],
        "matcher": experiment.matcher,
        "similarity_min": experiment.similarity_min,
        "right_m": RIGHT_M,
        "right_deg": RIGHT_DEG,
        "resamples": RESAMPLES,
        "level": LEVEL,
    }


def _times(experiment: Experiment, tables: Sequence[Table], statements: Sequence[Statement]) -> dict[str, Any]:
    timed = {table.name: {row.name: _cells(table, row, timed=True) for row in table.rows} for table in tables}
    return {
        "elapsed_s": experiment.elapsed_s,
        **timing_told(None),
        "statements": {one.name: {"found": one.found, "holds": one.holds} for one in statements if one.timed},
        "tables": {name: {row: cells for row, cells in rows.items() if cells} for name, rows in timed.items()},
    }


def timing_told(taken: Timing | None) -> dict[str, Any]:
    """How long everything took, and on which machine, as parts of ``times``; nothing where it is not known."""
    if taken is None:
        return {"whole_s": None, "machine": None}
    machine = {"cpus": taken.cpus, "processor": taken.processor, "load": list(taken.load)}
    return {"whole_s": taken.whole_s, "machine": machine}


def _statement(one: Statement) -> dict[str, Any]:
    told = dataclasses.asdict(one)
    return told | {"found": "", "holds": None} if one.timed else told


def _table(table: Table) -> dict[str, Any]:
    return {
        "name": table.name,
        "title": table.title,
        "note": table.note,
        "labels": list(table.labels),
        "columns": [dataclasses.asdict(column) for column in table.columns],
        "rows": [
            {
                "name": row.name,
                "labels": list(row.labels),
                "cells": _cells(table, row, timed=False),
                "paper": _numbers(row.paper),
                "decimals": row.decimals,
                "timed": row.timed,
            }
            for row in table.rows
        ],
    }


def _cells(table: Table, row: Row, *, timed: bool) -> dict[str, list[float]]:
    """The cells of a row that depend on the clock, or those that do not."""
    of_time = {column.name for column in table.columns if column.timed or row.timed}
    return _numbers({name: number for name, number in row.cells.items() if (name in of_time) == timed})


def _numbers(cells: Mapping[str, Number]) -> dict[str, list[float]]:
    """Value, and the ends of its range or interval."""
    return {name: [number.value, number.low, number.high] for name, number in cells.items()}


def _curve(curve: Curve) -> dict[str, Any]:
    """Details of evidence without their points, which are many."""
    told = {
        "number": curve.number,
        "moment": curve.moment,
        "source": curve.source,
        "group": curve.group,
        "area": dataclasses.asdict(curve.area),
        "threshold": dataclasses.asdict(curve.threshold),
        "missing": curve.missing,
    }
    is_detail = curve.source == WATCHED and "." in curve.number and not curve.number.startswith("verifier.")
    return told if is_detail else told | {"points": curve.points.tolist()}


def _read_table(told: Mapping[str, Any], timed: Mapping[str, Any]) -> Table:
    rows = [
        Row(
            row["name"],
            row["labels"],
            _read_cells({**row["cells"], **timed.get(row["name"], {})}),
            _read_cells(row["paper"]),
            row["decimals"],
            row["timed"],
        )
        for row in told["rows"]
    ]
    columns = [Column(**column) for column in told["columns"]]
    return Table(told["name"], told["title"], told["note"], told["labels"], columns, rows)


def _read_cells(told: Mapping[str, Sequence[float | None]]) -> dict[str, Number]:
    return {
        name: Number(*(float("nan") if number is None else number for number in numbers))
        for name, numbers in told.items()
    }

"""Everything that an experiment tells, as files: tables, figures, JSON and the page."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from mapgraft.experiments.andersone2021.outcome import Experiment
from mapgraft.experiments.andersone2021.protocol import Laboratory
from mapgraft.experiments.andersone2021.telling.as_published import costs_table, paper_tables
from mapgraft.experiments.andersone2021.telling.beyond import further_tables
from mapgraft.experiments.andersone2021.telling.charts import (
    areas_figure,
    costs_figure,
    curves_figure,
    histograms,
    resolution_figure,
)
from mapgraft.experiments.andersone2021.telling.detection import Curve, curves, transfers
from mapgraft.experiments.andersone2021.telling.document import DOCUMENT, Shown, document
from mapgraft.experiments.andersone2021.telling.drawn import Drawn
from mapgraft.experiments.andersone2021.telling.page import page
from mapgraft.experiments.andersone2021.telling.pictures import map_figures
from mapgraft.experiments.andersone2021.telling.statements import Statement, statements
from mapgraft.experiments.andersone2021.telling.tables import Table, csv_text, markdown, parquet_bytes
from mapgraft.outputs.provenance import RunProvenance

PAGE: Final = "report.html"
TITLE: Final = "The experiment of Andersone 2021, with a third column"
_HOLDS: Final = {True: "holds", False: "does not hold", None: "cannot be told"}


def present(
    experiment: Experiment, laboratory: Laboratory, provenance: RunProvenance, why: str = ""
) -> Mapping[str, bytes]:
    """File name → content of ``experiment.json``, the tables, the figures and ``report.html``.

    All but times are the same for the same recording, settings and version. ``why`` says why these recordings were
    taken, where nobody named any.
    """
    found = curves(experiment)
    tables = tables_of(experiment, found)
    said = statements(experiment, found)
    drawn = _figures(experiment, laboratory, found)
    pngs = {_file(one): one.png for one in drawn if one.png is not None}
    shown = [Shown(one.name, one.title, one.caption, _file(one) if one.png else "") for one in drawn]
    content = document(experiment, tables, said, found, shown, provenance, why)
    files = {DOCUMENT: json_bytes(content), **_table_files(tables, said), **pngs}
    return {**files, PAGE: page(content, pngs).encode()}


def tables_of(experiment: Experiment, found: Sequence[Curve]) -> list[Table]:
    """All tables, the paper's first."""
    first = [*paper_tables(experiment), costs_table(experiment)]
    return [*first, *further_tables(experiment, found, transfers(experiment))]


def _figures(experiment: Experiment, laboratory: Laboratory, found: Sequence[Curve]) -> list[Drawn]:
    return [
        *map_figures(experiment, laboratory),
        *histograms(experiment, found),
        curves_figure(experiment, found),
        areas_figure(experiment, found),
        resolution_figure(experiment, found),
        costs_figure(experiment),
    ]


def _file(one: Drawn) -> str:
    return f"figures/{one.name}.png"


def json_bytes(content: Mapping[str, Any]) -> bytes:
    """The document as a file."""
    return (json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n").encode()


def _table_files(tables: Sequence[Table], said: Sequence[Statement]) -> dict[str, bytes]:
    """Each table as Markdown and CSV, all of them as one Markdown page and one Parquet file."""
    files = {f"tables/{table.name}.md": markdown(table) for table in tables}
    files |= {f"tables/{table.name}.csv": csv_text(table) for table in tables}
    parts = [f"# {TITLE}\n", statements_markdown(said), *(markdown(table) for table in tables)]
    files["tables.md"] = "\n".join(parts)
    return {**{name: text.encode() for name, text in files.items()}, "tables.parquet": parquet_bytes(tables)}


def statements_markdown(said: Sequence[Statement]) -> str:
    """The claims as a list, each with what was found."""
    return "".join(f"- **{one.claim}** {_HOLDS[one.holds].capitalize()}: {one.found}\n" for one in said)

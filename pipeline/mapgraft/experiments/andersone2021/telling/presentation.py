"""Everything that an experiment tells, as files: tables, figures, JSON and the page."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from mapgraft.experiments.andersone2021.outcome import Experiment
from mapgraft.experiments.andersone2021.protocol import Laboratory
from mapgraft.experiments.andersone2021.telling.as_published import costs_table, paper_tables
from mapgraft.experiments.andersone2021.telling.beyond import further_tables
from mapgraft.experiments.andersone2021.telling.charts import costs_figure, histograms, resolution_figure
from mapgraft.experiments.andersone2021.telling.curve_charts import areas_figure, curves_figures
from mapgraft.experiments.andersone2021.telling.detection import Curve, curves, transfers
from mapgraft.experiments.andersone2021.telling.document import DOCUMENT, Shown, document, timing_told
from mapgraft.experiments.andersone2021.telling.drawn import Drawn
from mapgraft.experiments.andersone2021.telling.page import page
from mapgraft.experiments.andersone2021.telling.pictures import map_figures
from mapgraft.experiments.andersone2021.telling.statements import Statement, statements
from mapgraft.experiments.andersone2021.telling.tables import Table, csv_text, markdown, parquet_bytes
from mapgraft.experiments.andersone2021.timing import Timing
from mapgraft.outputs.provenance import RunProvenance

PAGE: Final = "report.html"
TITLE: Final = "The experiment of Andersone 2021, with a third column"
_HOLDS: Final = {True: "holds", False: "does not hold", None: "cannot be told"}


@dataclass(frozen=True, slots=True, eq=False)
class Presentation:
    """Everything that an experiment tells; ``files`` are tables and figures, file name → content.

    All but times are the same for the same recording, settings and version.
    """

    content: dict[str, Any]
    files: Mapping[str, bytes]

    def last(self, taken: Timing | None = None) -> Mapping[str, bytes]:
        """``experiment.json`` and ``report.html``, which tell how long everything took, where that is known."""
        content = {**self.content, "times": self.content["times"] | timing_told(taken)}
        pngs = {name: png for name, png in self.files.items() if name.endswith(".png")}
        return {DOCUMENT: json_bytes(content), PAGE: page(content, pngs).encode()}


def present(experiment: Experiment, laboratory: Laboratory, provenance: RunProvenance, why: str = "") -> Presentation:
    """Tables, figures and the document of an experiment.

    ``why`` says why these recordings were taken, where nobody named any.
    """
    found = curves(experiment)
    tables = tables_of(experiment, found)
    said = statements(experiment, found)
    drawn = _figures(experiment, laboratory, found)
    shown = [Shown(one.name, one.title, one.caption, _file(one) if one.png else "") for one in drawn]
    pngs = {_file(one): one.png for one in drawn if one.png is not None}
    content = document(experiment, tables, said, found, shown, provenance, why)
    return Presentation(content, {**table_files(tables, said), **pngs})


def tables_of(experiment: Experiment, found: Sequence[Curve]) -> list[Table]:
    """All tables, the paper's first."""
    first = [*paper_tables(experiment), costs_table(experiment)]
    return [*first, *further_tables(experiment, found, transfers(experiment))]


def _figures(experiment: Experiment, laboratory: Laboratory, found: Sequence[Curve]) -> list[Drawn]:
    return [
        *map_figures(experiment, laboratory),
        *histograms(experiment, found),
        *curves_figures(experiment, found),
        areas_figure(experiment, found),
        resolution_figure(experiment, found),
        costs_figure(experiment),
    ]


def _file(one: Drawn) -> str:
    return f"figures/{one.name}.png"


def json_bytes(content: Mapping[str, Any]) -> bytes:
    """The document as a file."""
    return (json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n").encode()


def table_files(tables: Sequence[Table], said: Sequence[Statement]) -> dict[str, bytes]:
    """Each table as Markdown and CSV, all of them as one Markdown page and one Parquet file."""
    files = {f"tables/{table.name}.md": markdown(table) for table in tables}
    files |= {f"tables/{table.name}.csv": csv_text(table) for table in tables}
    parts = [f"# {TITLE}\n", statements_markdown(said), *(markdown(table) for table in tables)]
    files["tables.md"] = "\n".join(parts)
    return {**{name: text.encode() for name, text in files.items()}, "tables.parquet": parquet_bytes(tables)}


def statements_markdown(said: Sequence[Statement]) -> str:
    """The claims as a list, each with what was found."""
    return "".join(f"- **{one.claim}** {_HOLDS[one.holds].capitalize()}: {one.found}\n" for one in said)

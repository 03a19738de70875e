"""Everything that an experiment tells, as files: tables, figures, JSON and the page."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from mapgraft.experiments.andersone2021.as_published import costs_table, paper_tables
from mapgraft.experiments.andersone2021.beyond import further_tables
from mapgraft.experiments.andersone2021.detection import curves, transfers
from mapgraft.experiments.andersone2021.document import document
from mapgraft.experiments.andersone2021.outcome import Experiment
from mapgraft.experiments.andersone2021.protocol import Laboratory
from mapgraft.experiments.andersone2021.statements import Statement, statements
from mapgraft.experiments.andersone2021.tables import Table, csv_text, markdown, parquet_bytes
from mapgraft.outputs.provenance import RunProvenance

DOCUMENT: Final = "experiment.json"
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
    tables = [
        *paper_tables(experiment),
        costs_table(experiment),
        *further_tables(experiment, found, transfers(experiment)),
    ]
    said = statements(experiment, found)
    content = document(experiment, tables, said, found, [], provenance, why)
    return {DOCUMENT: json_bytes(content), **_table_files(tables, said)}


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

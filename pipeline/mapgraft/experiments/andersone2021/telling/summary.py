"""What came of the experiment, for a person at a terminal."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table as Lines
from rich.text import Text

from mapgraft.console import cell
from mapgraft.experiments.andersone2021.outcome import Experiment
from mapgraft.experiments.andersone2021.telling.as_published import paper_tables
from mapgraft.experiments.andersone2021.telling.detection import curves
from mapgraft.experiments.andersone2021.telling.statements import Statement, statements
from mapgraft.experiments.andersone2021.telling.tables import NONE, Row

SHOWN: Final = ("end_similarity", "end_distance", "update_ratio")  # of the paper's tables
_MARKS: Final = {True: ("✓", "green"), False: ("✗", "red"), None: ("?", "yellow")}
_WIDTH: Final = 120


def show(experiment: Experiment, console: Console, out: Path) -> None:
    """Print the paper's tables in small, every claim with what was found, and where everything was written."""
    if not console.is_terminal:
        console.width = max(console.width, _WIDTH)
    console.print(_numbers(experiment))
    console.print(Text("In brackets: the paper.", style="dim"))
    for one in statements(experiment, curves(experiment, watched=False)):
        console.print(_line(one))
    for sentence in experiment.remarks:
        console.print(cell(sentence), style="yellow")
    console.print(cell(f"Written to {out}: the page is report.html, the tables are tables.md"))


def _numbers(experiment: Experiment) -> Lines:
    """SM and DM in the end and the cost of an update, one block per combination of resolutions."""
    tables = [table for table in paper_tables(experiment) if any(row.name in SHOWN for row in table.rows)]
    lines = Lines(box=None, header_style="bold", pad_edge=False)
    lines.add_column("")
    for column in tables[0].columns:
        lines.add_column(cell(column.title), justify="right")
    for combination, table in zip(experiment.settings.combinations, tables, strict=True):
        lines.add_row(cell(combination.name), style="bold")
        for name in SHOWN:
            row = table.row(name)
            lines.add_row(cell(f"  {row.labels[0]}"), *(cell(_text(row, column.name)) for column in table.columns))
    return lines


def _text(row: Row, column: str) -> str:
    """``0.983 (0.977)``: ours and the paper's."""
    ours, paper = row.cells.get(column), row.paper.get(column)
    text = NONE if ours is None else ours.text(3)
    return text if paper is None else f"{text} ({paper.text(3)})"


def _line(one: Statement) -> Text:
    mark, style = _MARKS[one.holds]
    return Text.assemble((f"{mark} ", style), (f"{cell(one.claim)} ", "bold"), str(cell(one.found)))

"""Tables of numbers, each with the paper's beside it where there is one, and how they are written."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

NONE: Final = "–"  # where there is no number
PAPER: Final = "paper"


@dataclass(frozen=True, slots=True)
class Number:
    """A number and, where they are told, the ends of its range or interval; NaN where there is none."""

    value: float
    low: float = math.nan
    high: float = math.nan

    def text(self, decimals: int) -> str:
        """``0.983 (0.954–0.999)``, without the brackets where no ends are told."""
        if math.isnan(self.value):
            return NONE
        text = _spelt(self.value, decimals)
        if math.isnan(self.low) or math.isnan(self.high):
            return text
        return f"{text} ({_spelt(self.low, decimals)}–{_spelt(self.high, decimals)})"


@dataclass(frozen=True, slots=True)
class Column:
    """A column; ``strategy`` names how merges are kept where a column is of one, and ``paper`` adds the paper's.

    ``timed`` columns depend on the clock.
    """

    name: str
    title: str
    decimals: int = 3
    strategy: str = ""
    paper: bool = False
    timed: bool = False
    ends: bool = False  # whether its numbers have ranges or intervals


@dataclass(frozen=True, slots=True)
class Row:
    """Cells by the names of their columns; those that are missing are empty. ``decimals`` go before the columns'.

    ``labels`` say what the row is about, one for each of the table's ``labels``; ``timed`` rows depend on the clock.
    """

    name: str
    labels: Sequence[str]
    cells: Mapping[str, Number]
    paper: Mapping[str, Number]
    decimals: int | None = None
    timed: bool = False

    @classmethod
    def plain(cls, name: str, labels: Sequence[str], decimals: int | None = None, **cells: float) -> Self:
        """A row without ranges and without the paper's numbers."""
        return cls(name, labels, {key: Number(float(value)) for key, value in cells.items()}, {}, decimals)


@dataclass(frozen=True, slots=True)
class Table:
    """What was measured. ``labels`` head the columns that say what a row is about."""

    name: str
    title: str
    note: str
    labels: Sequence[str]
    columns: Sequence[Column]
    rows: Sequence[Row]

    def header(self) -> list[str]:
        """What stands above the columns that persons read."""
        return [*self.labels, *(title for column in self.columns for title in _titles(column))]

    def lines(self) -> Iterator[list[str]]:
        """The rows as persons read them."""
        for row in self.rows:
            yield [*row.labels, *(text for column in self.columns for text in _texts(column, row))]

    def row(self, name: str) -> Row:
        """The row of that name; raises KeyError where there is none."""
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(name)


def markdown(table: Table) -> str:
    """The table with its title and its note."""
    return f"### {table.title}\n\n{table.note}\n\n{table_text(table)}\n"


def table_text(table: Table) -> str:
    """The table alone, in Markdown."""
    return "\n".join("| " + " | ".join(line) + " |" for line in _framed(table))


def csv_text(table: Table) -> str:
    """Plain numbers under one header row; what there is not stays empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    keys = [(column, suffix) for column in table.columns for suffix in _suffixes(column)]
    writer.writerow(["row", *map(_key, table.labels), *(f"{column.name}{suffix}" for column, suffix in keys)])
    for row in table.rows:
        numbers = (_number(row, column, suffix) for column, suffix in keys)
        writer.writerow([row.name, *row.labels, *("" if number is None else repr(number) for number in numbers)])
    return stream.getvalue()


def parquet_bytes(tables: Sequence[Table]) -> bytes:
    """All tables in long form, one row per cell that holds a number; null where a number is not told."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = [line for table in tables for line in _long(table)]
    names = ("table", "row", "column", "strategy")
    numbers = ("value", "low", "high", "paper_value", "paper_low", "paper_high")
    columns: dict[str, Any] = {
        name: pa.array([row[name] for row in rows], pa.string()).dictionary_encode() for name in names
    }
    columns |= {name: pa.array([row[name] for row in rows], pa.float64()) for name in numbers}
    stream = io.BytesIO()
    pq.write_table(pa.table(columns), stream, version="2.6", compression="zstd", use_dictionary=list(names))
    return stream.getvalue()


def finite(number: float) -> float | None:
    """The number, None where files cannot spell it."""
    return number if math.isfinite(number) else None


def _framed(table: Table) -> Iterator[Sequence[str]]:
    yield table.header()
    numbers = len(table.header()) - len(table.labels)
    yield [*("---" for _ in table.labels), *("---:" for _ in range(numbers))]
    yield from table.lines()


def _titles(column: Column) -> list[str]:
    return [column.title, PAPER] if column.paper else [column.title]


def _texts(column: Column, row: Row) -> list[str]:
    decimals = column.decimals if row.decimals is None else row.decimals
    sides = (row.cells, row.paper) if column.paper else (row.cells,)
    found = (side.get(column.name) for side in sides)
    return [NONE if number is None else number.text(decimals) for number in found]


def _suffixes(column: Column) -> list[str]:
    parts = ["", "_low", "_high"] if column.ends else [""]
    return [*parts, *(f"_paper{part}" for part in parts)] if column.paper else parts


def _number(row: Row, column: Column, suffix: str) -> float | None:
    side = row.paper if suffix.startswith("_paper") else row.cells
    number = side.get(column.name)
    if number is None:
        return None
    part = suffix.removeprefix("_paper").removeprefix("_") or "value"
    return finite(float(getattr(number, part)))


def _long(table: Table) -> Iterator[dict[str, Any]]:
    for row in table.rows:
        for column in table.columns:
            ours, paper = row.cells.get(column.name), row.paper.get(column.name)
            if ours is None and paper is None:
                continue
            yield {
                "table": table.name,
                "row": row.name,
                "column": column.name,
                "strategy": column.strategy or None,
                **{part: _part(ours, part) for part in ("value", "low", "high")},
                **{f"paper_{part}": _part(paper, part) for part in ("value", "low", "high")},
            }


def _part(number: Number | None, part: str) -> float | None:
    return None if number is None else finite(float(getattr(number, part)))


def _spelt(value: float, decimals: int) -> str:
    text = f"{value:,.{decimals}f}"
    return text.removeprefix("-") if float(text.replace(",", "")) == 0.0 else text


def _key(label: str) -> str:
    return label.replace(" ", "_")

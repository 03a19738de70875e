"""Write the table of map types into docs/heterogeneous.md from the default decision table.

python docs/write_pairs.py, and with ``--check`` exit with 1 when the page is not up to date.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Final

from mapgraft.decision import DecisionTable, Record, build_table
from mapgraft.plugins import load_plugins

PAGE: Final = Path(__file__).parent / "heterogeneous.md"
TYPES: Final = ("occupancy_grid", "point_cloud", "line_segments", "floor_plan")
BEGIN, END = "<!-- written by docs/write_pairs.py -->\n", "<!-- end -->\n"
_HEAD = """
| receiver | donor | rule | when | they meet as | matcher | what enters |
|---|---|---|---|---|---|---|
"""
_WHEN = {
    "scale_known": lambda known: "" if known else "scale unknown",
    "other.scale_known": lambda known: "" if known else "scale unknown",
    "prior_sigma_m": lambda limit: f"pose known to {limit.max:g} m",
    "own.free_space": lambda _known: "both know what is free",
    "own.known_area_m2": lambda limit: f"own map of {limit.min:g} m²",
    "other.known_area_m2": lambda limit: f"other map of {limit.min:g} m²",
    "own.wall_m": lambda limit: f"own walls of {limit.min:g} m",
    "other.wall_m": lambda limit: f"other walls of {limit.min:g} m",
    "other.walls_m": lambda limit: f"plan with {limit.min:g} m of wall",
}


def applicable(table: DecisionTable, own: str, other: str) -> Iterator[Record]:
    """The rules that two maps of these types can come to, in the order in which they are looked at.

    Those after one that rejects without asking for more than the types are never reached.
    """
    for record in table.records:
        rule = record.rule
        wanted = [(rule.when.get(f"{side}.type"), kind) for side, kind in (("own", own), ("other", other))]
        if any(kind not in (asked if isinstance(asked, list) else [asked]) for asked, kind in wanted if asked):
            continue
        if record.obstacle(own, other) is None:
            yield record
            if not rule.when.keys() - {"own.type", "other.type"}:
                return


def table_text() -> str:
    """One row per rule and ordered pair of types."""
    table = build_table(load_plugins())
    return _HEAD + "".join(row for own, other in product(TYPES, TYPES) for row in _rows(table, own, other))


def _rows(table: DecisionTable, own: str, other: str) -> Iterator[str]:
    for record in applicable(table, own, other):
        rule = record.rule
        if rule.reject is not None:
            yield f"| {own} | {other} | {rule.name} | always | rejected: {rule.reject} | | |\n"
            continue
        told = (_WHEN[name](value) for name, value in rule.when.items() if name in _WHEN)
        when = ", ".join(dict.fromkeys(filter(None, told))) or "otherwise"
        procedure = rule.procedure
        met, matcher, fuser = rule.via or own, procedure.match.use, procedure.fuse.use
        yield f"| {own} | {other} | {rule.name} | {when} | {met} | `{matcher}` | `{fuser}` |\n"


def page() -> str:
    """The whole page as it should be."""
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return before + BEGIN + table_text() + "\n" + END + after


if __name__ == "__main__":
    if "--check" in sys.argv[1:]:
        sys.exit(0 if PAGE.read_text(encoding="utf-8") == page() else 1)
    PAGE.write_text(page(), encoding="utf-8")

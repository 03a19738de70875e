"""Puts a run of ``mapgraft experiment andersone2021`` into docs/paper.md: its numbers, and three of its figures.

    mapgraft experiment andersone2021 intel.log -o intel           # the run that the page tells of
    mapgraft experiment andersone2021 other.log -o other --right 5 --wrong 5  # as many others as wanted
    python tests/bench/tables_of_paper.py intel other --on "two cores of …"  # docs/paper.json, the page, figures
    python tests/bench/tables_of_paper.py                          # writes the page again, from docs/paper.json

``docs/paper.json`` holds what the page shows and no more, so that a test can tell whether the page is what this makes.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any, Final

from mapgraft.experiments.andersone2021.telling.document import FORMAT, statements_in, tables_in
from mapgraft.experiments.andersone2021.telling.statements import Statement
from mapgraft.experiments.andersone2021.telling.tables import Table, table_text

DOCS: Final = Path(__file__).parents[2] / "docs"
PAGE, DATA = DOCS / "paper.md", DOCS / "paper.json"
PICTURES: Final = {"figure7": "paper_wrong_merge.png", "figure9": "paper_reverted.png", "resolution": "paper_dm.png"}
SHOWN: Final = (
    "ways",
    "searches",
    *(f"table{number}" for number in (1, 2, 3, 4)),
    "reversal",
    "resolution",
    "thresholds",
    "verdicts",
)
LEFT_OUT: Final = ("curves", "config", "decision_table", "plugins", "figures", "searches")
_VERDICTS: Final = {True: "holds", False: "**does not hold**", None: "cannot be told"}
_SOURCES: Final = {"ledger": "ledger", "paper": "paper", "tables": "its tables", "rules": "our rules"}
_BLOCK: Final = re.compile(r"(<!-- measured: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

Content = Mapping[str, Any]


def read(folder: Path) -> Content:
    """A run's document; raises SystemExit with a sentence for other folders."""
    path = folder / "experiment.json"
    content: Content = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    if content.get("format") != FORMAT:
        raise SystemExit(f"{folder} holds no run of mapgraft experiment andersone2021: name a folder that it wrote")
    return content


def told(content: Content, others: Sequence[Content], on: str, commit: str) -> dict[str, Any]:
    """What the page shows: a run without what is not shown, others in one line each, and where they were made."""
    files = [{**file, "path": PurePath(file["path"]).name} for file in content["files"]]
    kept = {key: value for key, value in content.items() if key not in LEFT_OUT}
    kept["tables"] = [table for table in kept["tables"] if table["name"] in SHOWN]
    kept["times"] = {**kept["times"], "tables": {n: t for n, t in kept["times"]["tables"].items() if n in SHOWN}}
    return {**kept, "files": files, "on": on, "commit": commit, "others": [_line(one) for one in (content, *others)]}


def _line(content: Content) -> list[str]:
    """One recording: how many merges, and how the main numbers come out."""
    tables = {table.name: table for table in tables_in(content)}
    ways, verdicts = tables["ways"], {row.labels[1]: row.cells for row in tables["verdicts"].rows[:2]}
    said = {one.name: one for one in statements_in(content)}
    counts = [f"{verdicts[kind]['merges'].value:.0f}" for kind in ("right", "wrong")]
    areas = [
        ways.row(way).cells.get(number) for way in ("single_map", "multi_map") for number in ("similarity", "distance")
    ]
    merges = sum(int(count) for count in counts)
    equal = "all" if said["ledger_metrics"].holds else "not all"
    return [
        ", ".join(PurePath(file["path"]).name for file in content["files"]),
        " + ".join(counts),
        *("–" if area is None else area.text(3) for area in areas),
        ways.row("multi_map").cells["update"].text(2),
        ways.row("ledger").cells["update"].text(2),
        f"{equal} of {merges}",
        f"{ways.row('ledger').cells['identical'].text(0)} of {merges}",
        f"{verdicts['wrong']['revert'].text(0)} of {counts[1]}, {verdicts['right']['revert'].text(0)} of {counts[0]}",
        f"{verdicts['wrong']['confirm'].text(0)} of {counts[1]}",
    ]


_OTHERS: Final = [
    "recording",
    "right + wrong",
    "SM, 1M",
    "DM, 1M",
    "SM, 2M",
    "DM, 2M",
    "update, 2M",
    "update, ledger",
    "ledger's metrics are 2M's",
    "ledger: same bytes",
    "our rules revert: wrong, right",
    "our rules confirm: wrong",
]


def blocks(content: Content) -> dict[str, str]:
    """What is measured on the page, by the names of its blocks."""
    tables = {table.name: table for table in tables_in(content)}
    said = statements_in(content)
    return {
        "run": _run(content),
        **{name: _with_note(table) for name, table in tables.items()},
        "thresholds": _with_note(_some(tables["thresholds"])),
        "statements": _statements(said),
        "others": _markdown(_OTHERS, content["others"]),
        "choices": "\n".join(f"- **{one['about']}**: {one['chosen']}" for one in content["choices"]),
    }


def _run(content: Content) -> str:
    given = content["settings"]
    options = [
        f"--{name} {given[name]}" for name, usual in (("right", 20), ("wrong", 20), ("seed", 0)) if given[name] != usual
    ]
    files = " ".join(file["path"] for file in content["files"])
    command = " ".join(["mapgraft experiment andersone2021", files, "-o OUT", *options])
    made = f"mapgraft {content['version']} at {content['commit']}, on {content['on']}"
    return f"```sh\n{command}\n```\n\n{made}; {_taken(content['times'])}."


def _taken(times: Mapping[str, Any]) -> str:
    """How long the merges and everything took, and beside what, as far as the run tells it."""
    merges, whole_s, machine = f"{times['elapsed_s']:.0f} s for the merges", times.get("whole_s"), times.get("machine")
    if whole_s is None or machine is None:
        return f"{merges}, without reading and drawing"
    load = " / ".join(f"{mean:.1f}" for mean in machine["load"])
    beside = f"{machine['cpus']} × {machine['processor'] or 'an unknown processor'}"
    everything = f"{whole_s:.0f} s for everything, from reading to written files"
    return f"{merges}, {everything} ({beside}" + (f", load average {load})" if load else ")")


def _with_note(table: Table) -> str:
    return f"{table.note}\n\n{table_text(table)}"


def _some(table: Table) -> Table:
    rows = [row for row in table.rows if row.labels[1] != "2M"]  # the ledger has the same ones
    return Table(table.name, table.title, table.note, table.labels, table.columns, rows)


def _statements(said: Sequence[Statement]) -> str:
    lines = [[_SOURCES[one.source], one.claim, one.found, _VERDICTS[one.holds]] for one in said]
    return _markdown(["who says it", "claim", "found", ""], lines)


def _markdown(columns: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(line) + " |" for line in (columns, ["---"] * len(columns), *lines))


def lines_of(content: Content) -> str:
    """The content as JSON, one line for each of its keys."""
    lines = (
        f"{json.dumps(key)}:{json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(',', ':'))}"
        for key, value in content.items()
    )
    return "{\n" + ",\n".join(lines) + "\n}\n"


def filled(page: str, content: Content) -> str:
    """The page with its blocks as they should be; raises KeyError for a block that nothing is measured for."""
    measured = blocks(content)
    return _BLOCK.sub(lambda found: f"{found[1]}\n{measured[found[2]]}\n\n{found[3]}", page)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, help="a run, and runs of other recordings")
    parser.add_argument("--on", default="", help="the machine, in words")
    given = parser.parse_args()
    if given.folders:
        if not given.on:
            print("say on which machine this was measured: --on TEXT", file=sys.stderr)
            return 2
        first, *others = map(read, given.folders)
        commit = subprocess.run(
            ["git", "-C", str(DOCS), "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True
        ).stdout.strip()
        DATA.write_text(lines_of(told(first, others, given.on, commit)), encoding="utf-8")
        for name, picture in PICTURES.items():
            shutil.copyfile(given.folders[0] / "figures" / f"{name}.png", DOCS / "pictures" / picture)
    content = json.loads(DATA.read_text(encoding="utf-8"))
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), content), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The page of an experiment, from its JSON and its figures alone: complete in itself."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any, Final

from jinja2 import TemplateError

from mapgraft.errors import OutputError, UsageError
from mapgraft.experiments.andersone2021.telling.beyond import IN_VIEW
from mapgraft.experiments.andersone2021.telling.document import DOCUMENT, FORMAT, statements_in, tables_in
from mapgraft.experiments.andersone2021.telling.statements import Statement
from mapgraft.experiments.andersone2021.telling.tables import Number, Table
from mapgraft.pages import data_uri, readable, render

TEMPLATE: Final = "andersone2021.html"
CLAIMANTS: Final = {
    "ledger": "What the ledger promises",
    "paper": "What the paper says",
    "tables": "What the paper's tables show",
    "rules": "Our own rules",
}
_LEADS: Final[Mapping[str, str]] = {"rules": IN_VIEW}  # what is to be known before the claims
_VERDICTS: Final = {True: ("holds", "good"), False: ("does not hold", "bad"), None: ("cannot be told", "none")}
_DAMAGE: Final = (  # what a document of other keys and types leads to, wherever it is used
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    StopIteration,
    ArithmeticError,
    RecursionError,
    TemplateError,
)
_LONGEST: Final = 200  # characters of what is said about damage
_NOTHING: Final[Mapping[str, Any]] = {"name": "", "title": "", "caption": "", "file": ""}


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure of the page; without ``uri`` the caption says why there is nothing to see."""

    name: str
    title: str
    caption: str
    uri: str
    width_px: int
    height_px: int


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the page: tables and pictures by name, in their order; ``folded`` ones are opened by a click."""

    anchor: str
    title: str
    lead: str
    parts: Sequence[str]
    folded: Sequence[str] = ()


SECTIONS: Final = (
    Section(
        "tables",
        "The paper's tables, with a third column",
        "Each number of the paper stands to the right of ours. 1M: the robot goes on with one merged map. 2M: it keeps "
        "its own map beside the merged one. Ledger: it keeps every source's evidence apart and adds it up where "
        "somebody looks.",
        ("table1", "table2", "table3", "table4", "figure5", "figure6"),
        ("figure6_all", "searches"),
    ),
    Section(
        "revert",
        "After the revert",
        "A wrong merge that was accepted, what each way maintains, and what is left when it is taken out again.",
        ("figure7", "figure8", "figure9", "reversal"),
    ),
    Section(
        "detection",
        "Which numbers tell wrong merges, and from which threshold on",
        "The paper leaves open how thresholds are chosen, because they move with resolution and quality.",
        ("roc", "areas", "resolution:figure", "resolution", "thresholds", "verdicts"),
        ("roc_by_resolution", "detection", "evidence"),
    ),
    Section(
        "costs",
        "What an update costs",
        "All ways take turns on the same scans of the same pairs, so that the ratios hold.",
        ("costs:figure",),
        ("costs",),
    ),
)


def page_of(folder: Path) -> str:
    """The page of a folder that ``mapgraft experiment andersone2021`` wrote, made anew from its JSON and its figures.

    Raises UsageError when there is no such JSON, OutputError when it is damaged.
    """
    path = folder / DOCUMENT
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        names = [told["file"] for told in content["figures"] if told["file"]]
        figures = {name: (folder / name).read_bytes() for name in names if _is_inside(folder, name)}
        return page(content, figures)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}; give the folder of an experiment") from None
    except _DAMAGE as error:
        reason = readable(str(error)).partition("\n")[0][:_LONGEST] or type(error).__name__
        raise OutputError(f"{path} is damaged or of another version ({reason}): run the experiment again") from None


def _is_inside(folder: Path, name: str) -> bool:
    """Whether a figure's name leads to a file of the folder: the JSON may be anybody's."""
    place = (folder / name).resolve()
    return place.is_relative_to(folder.resolve()) and place.is_file()


def page(document: Mapping[str, Any], figures: Mapping[str, bytes]) -> str:
    """The page of a document (``experiment.json``, parsed) and its PNG files by their names in the folder.

    Raises ValueError when the document is of another format.
    """
    if document.get("format") != FORMAT:
        raise ValueError(f"this is no {FORMAT!r} but {document.get('format')!r}")
    tables = {table.name: table for table in tables_in(document)}
    pictures = {told["name"]: _picture(told, figures) for told in document["figures"]}
    said = statements_in(document)
    return render(
        TEMPLATE,
        version=document["version"],
        document=document,
        recordings=", ".join(PurePath(file["path"]).name for file in document["files"]),
        tiles=_tiles(document, tables),
        ways=tables["ways"],
        groups=[(title, _LEADS.get(who, ""), _judged(said, who)) for who, title in CLAIMANTS.items()],
        sections=[_filled(section, tables, pictures) for section in SECTIONS],
        taken=_taken(document["times"]),
    )


def _tiles(document: Mapping[str, Any], tables: Mapping[str, Table]) -> list[tuple[str, str, str]]:
    """Label, number and what is small beside it."""
    ways = tables["ways"]
    merges = sum(row.cells["merges"].value for row in tables["verdicts"].rows[:2])
    same = {row.name: row.cells["identical"].text(0) for row in ways.rows}
    cost = ways.row("ledger").cells["update"].text(2)
    two = ways.row("multi_map").cells["update"].text(2)
    areas = {row.name: row.cells["distance"] for row in ways.rows if "distance" in row.cells}
    tiles = [
        ("merges, each kept in three ways", f"{merges:.0f}", ""),
        ("ledger after the revert: same bytes", same["ledger"], f"1M {same['single_map']}, 2M {same['multi_map']}"),
        ("ledger's update, 1M = 1", cost, f"2M {two}"),
    ]
    if "ledger" in areas:
        tiles.append(_area_tile(areas))
    whole_s = document["times"].get("whole_s")
    whole = "" if whole_s is None else f"everything {whole_s:.0f} s"
    return [*tiles, ("the merges", f"{document['times']['elapsed_s']:.0f} s", whole)]


def _area_tile(areas: Mapping[str, Number]) -> tuple[str, str, str]:
    """The area of the ledger's DM, and in small its interval and that of one map."""
    ours, one = areas["ledger"], areas["single_map"].text(3) if "single_map" in areas else "not told"
    value, _, ends = ours.text(3).partition(" (")
    interval = f"95 %: {ends.removesuffix(')')}; " if ends else ""
    return "DM tells wrong merges (area)", value, f"{interval}1M {one}"


def _taken(times: Mapping[str, Any]) -> list[tuple[str, str]]:
    """How long what took, and on which machine, as far as it is known."""
    told = [("the merges", f"{times['elapsed_s']:.1f} s")]
    if (whole_s := times.get("whole_s")) is not None:
        told.append(("everything", f"{whole_s:.1f} s, from reading to written files"))
    if machine := times.get("machine"):
        told.append(("processor", f"{machine['cpus']} × {machine['processor'] or 'unknown'}"))
        load = " / ".join(f"{mean:.1f}" for mean in machine["load"])
        told += [("load average (1 / 5 / 15 min)", load)] if load else []
    return told


def _judged(said: Sequence[Statement], source: str) -> list[tuple[Statement, str, str]]:
    return [(one, *_VERDICTS[one.holds]) for one in said if one.source == source]


def _filled(
    section: Section, tables: Mapping[str, Table], pictures: Mapping[str, Picture]
) -> tuple[Section, Sequence[Table | Picture], Sequence[Table | Picture]]:
    def part(name: str) -> Table | Picture | None:
        known, _, kind = name.partition(":")
        if kind == "figure" or known not in tables:
            return pictures.get(known)
        return tables[known]

    shown, folded = (
        [found for n in names if (found := part(n)) is not None] for names in (section.parts, section.folded)
    )
    return section, shown, folded


def _picture(told: Mapping[str, Any], figures: Mapping[str, bytes]) -> Picture:
    """The figure as a part of the page; where its file is missing the caption says so."""
    known = {**_NOTHING, **told}
    png = figures.get(known["file"], b"")
    found = Picture(known["name"], known["title"], known["caption"], "", 0, 0)
    if not known["file"]:
        return found
    if not png.startswith(b"\x89PNG") or len(png) < 24:
        return replace(found, caption=f"{known['caption']} The file {known['file']} is not there or no PNG.")
    width, height = struct.unpack(">II", png[16:24])
    return replace(found, uri=data_uri(png), width_px=width, height_px=height)

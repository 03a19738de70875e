"""``mapgraft match``: two ready maps from files, or a list of pairs whose truth is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from mapgraft.config import Config
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.contracts import Measurement
from mapgraft.decision import build_table
from mapgraft.errors import UsageError
from mapgraft.job import as_config
from mapgraft.matching.document import document, pixels_of
from mapgraft.matching.folder import write_folder
from mapgraft.matching.pairing import Hypothesis, Pairer, Pairing
from mapgraft.matching.ready_map import RESOLUTION, ReadyMap, Shelf
from mapgraft.plugins import Plugins, load_plugins
from mapgraft.procedures import Workshop
from mapgraft.substitution import substituted

UNKNOWN_GRAY = "unknown_gray"


@dataclass(frozen=True, slots=True)
class Asked:
    """How the maps are to be read and matched."""

    resolution_m: float | None = None
    other_resolution_m: float | None = None
    unknown_gray: int | None = None
    config: Path | None = None
    rules: Path | None = None
    matcher: str | None = None
    without: Sequence[str] = ()


def match_and_show(
    maps: Sequence[Path], asked: Asked, out: Path | None, *, as_json: bool, all_hypotheses: bool
) -> None:
    """Match two map files, print what came of it, and write the folder if one is given."""
    if len(maps) != 2:
        raise UsageError(f"match takes two map files, A and B, found {len(maps)}; or a list of pairs with --pairs")
    plugins = load_plugins(asked.without)
    config = as_config(asked.config)
    pairer = pairer_of(plugins, config, asked)
    shelf = Shelf(plugins, config, pairer.workshop)
    a, b = (shelf.read(path, given) for path, given in zip(maps, options_of(shelf, maps, asked), strict=True))
    for map_ in dict.fromkeys((a, b)):
        print_remarks(map_)
    pairing = pairer.pair(a, b)
    files = write_folder(out, pairing, pairer.workshop) if out is not None else None
    if as_json:
        times = {"match_s": pairing.match_s, "elapsed_s": pairing.elapsed_s}
        print_json({**document(pairing), **times, **({} if files is None else {"files": files})})
        return
    print_pairing(results(), pairing, all_hypotheses=all_hypotheses)
    if out is not None and files:
        results().print(cell(f"Written to {out}: {', '.join(files)}"))


def print_remarks(map_: ReadyMap) -> None:
    """What is probably not meant as a map file says, on stderr."""
    for remark in map_.remarks:
        remarks().print(cell(f"{remark} (--unknown-gray)" if UNKNOWN_GRAY in remark else remark), style="yellow")


def pairer_of(plugins: Plugins, config: Config, asked: Asked) -> Pairer:
    """What matches by the rules asked for; raises UsageError when they cannot be used."""
    table = substituted(build_table(plugins, asked.rules or config.rules), plugins, matcher=asked.matcher)
    workshop = Workshop(plugins)
    workshop.prepare(table)
    return Pairer(workshop, table)


def options_of(shelf: Shelf, maps: Sequence[Path], asked: Asked) -> list[dict[str, object]]:
    """The options of each of two files; raises UsageError when one was given that its file cannot use."""
    given = [options_for(shelf, path, side, asked) for side, path in enumerate(maps)]
    used = [options.get(RESOLUTION) for options in given]
    _require_used("--unknown-gray", asked.unknown_gray, maps, any(UNKNOWN_GRAY in options for options in given))
    _require_used("--resolution", asked.resolution_m, maps, asked.resolution_m in used)
    _require_used("--other-resolution", asked.other_resolution_m, maps[1:], asked.other_resolution_m == used[1])
    return given


def options_for(shelf: Shelf, path: Path, side: int, asked: Asked) -> dict[str, object]:
    """What was asked that the format of a file can use; ``side`` is 0 for A and 1 for B."""
    wanted = {UNKNOWN_GRAY: asked.unknown_gray, RESOLUTION: asked.resolution_m}
    if side == 1 and asked.other_resolution_m is not None:
        wanted[RESOLUTION] = asked.other_resolution_m
    return {name: value for name, value in wanted.items() if value is not None and shelf.takes(path, name)}


def _require_used(option: str, value: object, maps: Sequence[Path], used: bool) -> None:
    if value is not None and not used:
        names = " and ".join(path.name for path in maps)
        raise UsageError(
            f"{option} is of no use for {names}, whose format tells it by itself or has none: leave it out"
        )


def print_pairing(console: Console, pairing: Pairing, *, all_hypotheses: bool) -> None:
    """The verdict, where B lies in A, what speaks for it, and why it was decided so."""
    for letter, map_ in (("A", pairing.a), ("B", pairing.b)):
        console.print(cell(f"{letter}  {_described(map_)}"), soft_wrap=True)
    accepted, best = pairing.accepted, pairing.best
    style = {"provisional": "green", "ambiguous": "yellow"}.get(pairing.verdict, "red")
    console.print(cell(_headline(pairing)), style=f"bold {style}", soft_wrap=True)
    console.print(cell(f"  reason     {pairing.reason}"), soft_wrap=True)
    if best is not None:
        if accepted is None:
            console.print(cell("  The best hypothesis, which is NOT accepted:"), style="yellow", soft_wrap=True)
        _print_hypothesis(console, pairing, best)
    if all_hypotheses:
        _print_all(console, pairing)
    elif len(pairing.hypotheses) > 1:
        console.print(
            cell(f"  others     {len(pairing.hypotheses) - 1} more (--hypotheses lists them)"), soft_wrap=True
        )
    _print_rule(console, pairing)
    if pairing.verdict != "rejected":
        console.print(
            cell(f"  time       {pairing.match_s:.3f} s matching, {pairing.elapsed_s:.3f} s in all"), soft_wrap=True
        )


def _headline(pairing: Pairing) -> str:
    said = {
        "provisional": "accepted: B's map is merged into A's, provisionally, for nothing new has tested it yet",
        "ambiguous": "ambiguous: probable, but not enough to merge, or more than one place fits; not merged",
        "unmatched": "unmatched: no hypothesis is good enough, so the maps are not merged",
        "rejected": "rejected: the decision table does not let these maps be matched",
    }
    return said[pairing.verdict]


def _described(map_: ReadyMap) -> str:
    metadata, size = map_.metadata, ""
    if map_.image is not None:
        size = f", {map_.image.width} × {map_.image.height} pixels of {map_.image.resolution_m:g} m"
    return f"{map_.path}: {map_.map_type.name}{size}, {metadata.known_area_m2:,.1f} m² known"


def _print_hypothesis(console: Console, pairing: Pairing, hypothesis: Hypothesis) -> None:
    match, pixels = hypothesis.match, pixels_of(pairing, hypothesis)
    console.print(cell(f"  transform  T_a_b: {_pose(hypothesis)}{_sigmas(hypothesis)}"), soft_wrap=True)
    if pixels is not None:
        rows = ("x_a", pixels[0]), ("y_a", pixels[1])
        said = ", ".join(
            f"{name} = {_plain(r[0], 6)} x_b {_signed(r[1], 6)} y_b {_signed(r[2], 3)}" for name, r in rows
        )
        console.print(cell(f"  pixels     {said}  (x right, y down, centres at whole numbers)"), soft_wrap=True)
    console.print(cell(f"  score      {match.score:.4g}, margin {_margin(match.margin)}"), soft_wrap=True)
    if match.evidence:
        said = ", ".join(f"{name} {value:.4g}" for name, value in match.evidence.items())
        console.print(cell(f"  evidence   {said}"), soft_wrap=True)
    if hypothesis.measurements:
        said = ", ".join(map(_measured, hypothesis.measurements))
        console.print(cell(f"  metrics    {said}"), soft_wrap=True)


def _print_all(console: Console, pairing: Pairing) -> None:
    for number, hypothesis in enumerate(pairing.hypotheses, start=1):
        match, mark = hypothesis.match, "accepted" if hypothesis.accepted else "not accepted"
        said = f"{number}. score {match.score:.4g}, margin {_margin(match.margin)}, {_pose(hypothesis)}, {mark}"
        measured = "".join(f", {m.name} {m.value:.4g}" for m in hypothesis.measurements or ())
        console.print(cell(f"  {said}{measured}"), soft_wrap=True)


def _print_rule(console: Console, pairing: Pairing) -> None:
    rule = pairing.ruling.rule
    if pairing.ruling.rejected or rule is None:
        for finding in pairing.ruling.findings:
            console.print(cell(f"  {'✓' if finding.applies else '✗'} {finding.rule}: {finding.reason}"), soft_wrap=True)
        return
    chosen = rule.procedure
    said = f"match {chosen.match.use}, accept {chosen.accept.use}, fuse {chosen.fuse.use}"
    console.print(cell(f"  rule       {rule.name}: {said}"), soft_wrap=True)


def _pose(hypothesis: Hypothesis) -> str:
    T = hypothesis.match.T_receiver_donor
    scale = "" if hypothesis.match.scale == 1.0 else f", scale {hypothesis.match.scale:.4f}"
    return f"x {_plain(T.x_m, 3)} m, y {_plain(T.y_m, 3)} m, yaw {_plain(math.degrees(T.yaw_rad), 2)}°{scale}"


def _sigmas(hypothesis: Hypothesis) -> str:
    covariance = hypothesis.match.covariance
    if covariance is None:
        return ""
    x, y, yaw = (math.sqrt(max(covariance[i, i], 0.0)) for i in (0, 1, 5))
    return f"  (± {x:.3f} m, {y:.3f} m, {math.degrees(yaw):.2f}°)"


def _plain(value: float, digits: int) -> str:
    return f"{round(value, digits) + 0.0:.{digits}f}"  # + 0.0: no -0.000


def _signed(value: float, digits: int) -> str:
    return f"{'-' if value < 0 else '+'} {abs(value):.{digits}f}"


def _margin(margin: float) -> str:
    return f"{margin:.4g} over the next" if math.isfinite(margin) else "none: there is no other"


def _measured(measurement: Measurement) -> str:
    unit = f" {measurement.unit}" if measurement.unit not in ("", "1") else ""
    return f"{measurement.name} {measurement.value:.4g}{unit}" if measurement.sufficient else f"{measurement.name} –"

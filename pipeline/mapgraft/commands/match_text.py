"""A pairing in words and tables for persons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from mapgraft.console import cell
from mapgraft.contracts import Measurement
from mapgraft.decision import Measuring
from mapgraft.matching.document import pixels_of
from mapgraft.matching.pairing import Hypothesis, Pairing
from mapgraft.matching.ready_map import ReadyMap

NOTHING = "–"  # for what could not be measured
TELLING = ("posterior", "similarity", "contradiction")  # metrics that are shown unasked, with the overlap
OVERLAP = "overlap_m2"  # a detail of metrics
_LARGE = 10.0  # from here on whole numbers say enough
_NEARLY_ONE = 0.999
_LEAST_LACK = 1e-9  # what is nearer to 1 is shown as 1

_HEADLINES = {
    "provisional": "accepted: B's map is merged into A's, provisionally, for nothing new has tested it yet",
    "ambiguous": "ambiguous: probable, but not enough to merge, or more than one place fits; not merged",
    "unmatched": "unmatched: no hypothesis is good enough, so the maps are not merged",
    "rejected": "rejected: the decision table does not let these maps be matched",
}


def print_pairing(console: Console, pairing: Pairing, *, all_hypotheses: bool) -> None:
    """The verdict, where B lies in A, what speaks for it, and why it was decided so."""
    for letter, map_ in (("A", pairing.a), ("B", pairing.b)):
        console.print(cell(f"{letter}  {_described(map_)}"), soft_wrap=True)
    style = {"provisional": "green", "ambiguous": "yellow"}.get(pairing.verdict, "red")
    console.print(cell(_HEADLINES[pairing.verdict]), style=f"bold {style}")
    table = Table.grid(padding=(0, 2))
    for name, text in _rows(pairing, all_hypotheses):
        table.add_row("", cell(name), cell(text))
    console.print(table)
    if all_hypotheses and pairing.hypotheses:
        console.print(_table_of(pairing.hypotheses))
        console.print(_measured_table(pairing.hypotheses))


def _rows(pairing: Pairing, all_hypotheses: bool) -> Iterator[tuple[str, str]]:
    """Names and texts; a text may have several lines."""
    yield "reason", pairing.reason
    if pairing.best is not None:
        if pairing.accepted is None:
            yield "", "The best hypothesis, which is NOT accepted:"
        yield from _of_hypothesis(pairing, pairing.best)
    if len(pairing.hypotheses) > 1:
        measured = sum(hypothesis.measurements is not None for hypothesis in pairing.hypotheses)
        asking = "" if all_hypotheses else "; --hypotheses lists them"
        yield "found", f"{len(pairing.hypotheses)} hypotheses, of which the best {measured} were measured{asking}"
    rule = pairing.ruling.rule
    if pairing.ruling.rejected or rule is None:
        for finding in pairing.ruling.findings:
            yield "", f"{'✓' if finding.applies else '✗'} {finding.rule}: {finding.reason}"
        return
    chosen = rule.procedure
    yield "rule", f"{rule.name}: match {chosen.match.use}, accept {chosen.accept.use}, fuse {chosen.fuse.use}"
    if limits := limits_of(chosen.accept):
        yield "limits", limits
    yield "time", f"{pairing.match_s:.3f} s matching, {pairing.elapsed_s:.3f} s in all"


def _of_hypothesis(pairing: Pairing, hypothesis: Hypothesis) -> Iterator[tuple[str, str]]:
    match, pixels = hypothesis.match, pixels_of(pairing, hypothesis)
    yield "transform", f"T_a_b: {_pose(hypothesis)}{_sigmas(hypothesis)}"
    if pixels is not None:
        for name, r, label in (("x_a", pixels[0], "pixels"), ("y_a", pixels[1], "")):
            yield label, f"{name} = {_plain(r[0], 6)} x_b {_signed(r[1], 6)} y_b {_signed(r[2], 3)}"
        yield "", "(x right, y down, centres at whole numbers)"
    yield "score", f"{shown(match.score)}, {_margin(match.margin)}"
    if said := ", ".join(_telling(hypothesis.measurements or ())):
        yield "metrics", said


def _telling(measurements: Sequence[Measurement]) -> Iterator[str]:
    """The few metrics by which a person sees what holds, or all of a rule that measures none of them."""
    by = {measurement.name: measurement for measurement in measurements}
    for name in [name for name in TELLING if name in by] or list(by):
        yield f"{name} {_measured(by[name])}"
    areas = [m.details[OVERLAP] for m in measurements if OVERLAP in m.details]
    if areas:
        yield f"overlap {shown(areas[0])} m²"


def _table_of(hypotheses: Sequence[Hypothesis]) -> Table:
    """All hypotheses, best first."""
    table = _plain_table("", "score", "margin", "x m", "y m", "yaw °", "")
    for number, one in enumerate(hypotheses, start=1):
        T = one.match.T_receiver_donor
        pose = _plain(T.x_m, 3), _plain(T.y_m, 3), _plain(math.degrees(T.yaw_rad), 2)
        said = "accepted" if one.accepted else "" if one.measurements is not None else "not measured"
        table.add_row(str(number), shown(one.match.score), shown(one.match.margin), *pose, said)
    return table


def _measured_table(hypotheses: Sequence[Hypothesis]) -> Table:
    """What was told and measured of the measured ones, or of the first where none was: one column each."""
    some = [(number, h) for number, h in enumerate(hypotheses, start=1) if h.measurements is not None]
    columns = some or [(1, hypotheses[0])]
    table = _plain_table("", *(f"{number}." for number, _ in columns))
    told = [h.match.evidence for _, h in columns]
    measured = [{m.name: m for m in h.measurements or ()} for _, h in columns]
    for name in dict.fromkeys(name for evidence in told for name in evidence):
        table.add_row(cell(f"evidence.{name}"), *(shown(evidence.get(name, math.nan)) for evidence in told))
    for name in dict.fromkeys(name for metrics in measured for name in metrics):
        table.add_row(cell(name), *(cell(_measured(m[name]) if name in m else NOTHING) for m in measured))
    return table


def _plain_table(*columns: str) -> Table:
    table = Table(box=None, header_style="bold", padding=(0, 2, 0, 0))
    for number, column in enumerate(columns):
        table.add_column(cell(column), justify="right" if number else "left", overflow="fold")
    return table


def limits_of(accept: Measuring) -> str:
    """What the acceptor was told: ``provisional 0.8, ambiguous 0.5, paths max 4``."""

    def told(name: str, value: object) -> Iterator[str]:
        if not isinstance(value, Mapping):
            yield f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for key, inner in value.items() if isinstance(value, Mapping) else ():
            yield from told(f"{name} {key}", inner)

    parameters: dict[str, Any] = dict(accept.parameters)
    limits = parameters.pop("metrics", {})
    return ", ".join(text for name, value in {**parameters, **limits}.items() for text in told(name, value))


def shown(value: float) -> str:
    """A number in as few digits as tell: large ones whole, those just below 1 with two of what they lack, a dash for
    none."""
    if not math.isfinite(value):
        return NOTHING
    if abs(value) >= _LARGE:
        return f"{value:.0f}"
    lack = 1.0 - value
    if _LEAST_LACK <= lack <= 1.0 - _NEARLY_ONE:
        return f"{value:.{1 - math.floor(math.log10(lack))}f}"
    return f"{value:.3g}"


def _described(map_: ReadyMap) -> str:
    metadata, size = map_.metadata, ""
    if map_.image is not None:
        size = f", {map_.image.width} × {map_.image.height} pixels of {map_.image.resolution_m:g} m"
    return f"{map_.path}: {map_.map_type.name}{size}, {metadata.known_area_m2:,.1f} m² known"


def _pose(hypothesis: Hypothesis) -> str:
    T = hypothesis.match.T_receiver_donor
    scale = "" if hypothesis.match.scale == 1.0 else f", scale {hypothesis.match.scale:.4f}"
    return f"x {_plain(T.x_m, 3)} m, y {_plain(T.y_m, 3)} m, yaw {_plain(math.degrees(T.yaw_rad), 2)}°{scale}"


def _sigmas(hypothesis: Hypothesis) -> str:
    covariance = hypothesis.match.covariance
    if covariance is None:
        return ""
    x, y, yaw = (math.sqrt(max(covariance[i, i], 0.0)) for i in (0, 1, 5))
    return f" (± {x:.3f} m, {y:.3f} m, {math.degrees(yaw):.2f}°)"


def _margin(margin: float) -> str:
    if not math.isfinite(margin):
        return "no other hypothesis"
    return f"{shown(abs(margin))} {'above' if margin >= 0.0 else 'below'} the best other hypothesis"


def _measured(measurement: Measurement) -> str:
    if not measurement.sufficient:
        return NOTHING
    unit = f" {measurement.unit}" if measurement.unit not in ("", "1", "score") else ""
    return f"{shown(measurement.value)}{unit}"


def _plain(value: float, digits: int) -> str:
    return f"{round(value, digits) + 0.0:.{digits}f}"  # + 0.0: no -0.000


def _signed(value: float, digits: int) -> str:
    return f"{'-' if value < 0 else '+'} {abs(value):.{digits}f}"

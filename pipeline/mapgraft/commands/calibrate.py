"""``mapgraft calibrate``: thresholds from labelled examples, with the guarantee they carry."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.table import Table

from mapgraft.calibrate.collecting import collecting_text
from mapgraft.calibrate.document import document
from mapgraft.calibrate.fitting import Asked, Calibration, Fit, RuleFit, calibrate
from mapgraft.calibrate.labelled import read_labels
from mapgraft.calibrate.page import page_of
from mapgraft.calibrate.table import rules_text, written
from mapgraft.calibrate.transfer import Target
from mapgraft.commands.unread import tell_unread
from mapgraft.commands.written_file import require_no_folder
from mapgraft.config import Config
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.decision import Rule, build_table
from mapgraft.errors import UsageError
from mapgraft.evaluation.tables import wide
from mapgraft.job import as_config
from mapgraft.outputs.staging import writing
from mapgraft.plugins import load_plugins

RULES, DOCUMENT, PAGE = "rules.yaml", "calibration.json", "report.html"
_SAID: Final[Mapping[str, str]] = {
    "guaranteed": "the bound holds for further buildings, too",
    "not refuted": "for other buildings on an assumption",
    "none": "no guarantee for other buildings",
}


@dataclass(frozen=True, slots=True)
class Options:
    """What was given on the command line; None where it was not, and the configuration says it."""

    false_accept: float | None = None
    false_confirm: float | None = None
    false_revert: float | None = None
    score: str | None = None
    cost_false_accept: float | None = None
    cost_miss: float | None = None

    def over(self, config: Config) -> Asked:
        """What is asked for, the command line before the configuration."""
        told = config.calibrate.model_dump()
        given = {name: getattr(self, name) for name in self.__slots__ if getattr(self, name) is not None}
        return Asked(**{**told, **given})


def calibrate_and_show(
    datasets: Sequence[Path],
    out: Path | None,
    options: Options,
    *,
    config: Path | None,
    rules: Path | None,
    meant: Sequence[Path],
    without_building: Sequence[str],
    held_back: bool,
    collecting: Path | None,
    as_json: bool,
    without: Sequence[str],
) -> None:
    """Calibrate, write the decision table, the JSON and the page, and print what came of it."""
    checked = as_config(config)
    table = [record.rule for record in build_table(load_plugins(without), rules or checked.rules).records]
    if collecting is not None:
        _collect(collecting, table, datasets)
        return
    if not datasets or out is None:
        raise UsageError("name labelled examples and a folder to write to: mapgraft calibrate DATASET… -o OUT")
    asked = options.over(checked)
    tell_unread([*datasets, *meant])
    labels = read_labels(datasets, without=without_building, held_back=held_back)
    used_on = read_labels(meant, held_back=True) if meant else None
    calibration = calibrate(labels, table, asked, used_on)
    content = document(calibration)
    _write(out, RULES, rules_text(calibration))
    _write(out, DOCUMENT, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    _write(out, PAGE, page_of(calibration))
    if as_json:
        print_json(content)
        return
    for sentence in calibration.remarks:
        remarks().print(cell(sentence), style="yellow")
    show(calibration, out)


def _collect(path: Path, rules: Sequence[Rule], datasets: Sequence[Path]) -> None:
    if datasets:
        raise UsageError("--collecting writes the rules to collect examples by: it goes without examples")
    require_no_folder("--collecting", path)
    _write(path.parent, path.name, collecting_text(rules))
    results().print(cell(f"{path}: evaluate recordings with --rules {path} --examples FOLDER, then calibrate FOLDER"))


def _write(folder: Path, name: str, text: str) -> None:
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        partial = folder / f"{name}.partial"
        partial.write_text(text, encoding="utf-8")
        partial.replace(folder / name)


def show(calibration: Calibration, out: Path) -> None:
    """Print the limits of every group, what they do to the labels, and what is promised elsewhere."""
    asked, labels = calibration.asked, calibration.labels
    results().print(
        cell(
            f"{len(labels.labelled)} labelled examples of {', '.join(labels.buildings)}; asked for: wrong merged "
            f"{100 * asked.false_accept:g} %, wrong confirmed {100 * asked.false_confirm:g} %, right reverted "
            f"{100 * asked.false_revert:g} %"
        )
    )
    for rule_fit in calibration.rules:
        _show_rule(rule_fit)
    if calibration.others:
        names = ", ".join(rule.name for rule in calibration.others if rule.reject is None)
        results().print()
        results().print(cell(f"as they were, without labels and promises: {names}"), style="dim")
    results().print(cell(f"written: {out / RULES}, {DOCUMENT}, {PAGE}"))


def _show_rule(rule_fit: RuleFit) -> None:
    area, transfer = rule_fit.quality.area, rule_fit.transfer
    results().print()
    results().print(cell(rule_fit.rule.name), style="bold")
    results().print(
        cell(
            f"score: {rule_fit.score.name}; area under the curve {area.value:.3f} ({area.low:.3f} to {area.high:.3f}), "
            f"{area.right} right, {area.wrong} wrong"
        )
    )
    table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    for title in ("maps", "accept above", "wrong accepted", "right accepted", "revert at", "confirm at", "set by"):
        table.add_column(title)
    for fit in written(rule_fit):
        table.add_row(*(cell(text) for text in row(fit)))
    wide(results()).print(table)
    for one in transfer.left_out:
        said = "the others have too few labels" if one.threshold is None else f"above {one.threshold:.3f}"
        shares = "" if one.threshold is None else f", wrong accepted {one.wrong.text}, right accepted {one.right.text}"
        results().print(cell(f"  {one.building} by the labels of the others: {said}{shares}"))
    for target in transfer.target:
        results().print(cell(f"  {target.environment}, meant for: {_unlike(target)}"))
    results().print(cell(f"{_SAID[transfer.verdict]}: {transfer.reason}"), style=_style(transfer.verdict))


def row(fit: Fit) -> list[str]:
    """One group as it is printed."""
    accept = fit.accept
    takes = math.isfinite(accept.value)
    by = "its own labels" if accept.own else f"labels of {accept.set_by.name}" if accept.set_by else "nobody"
    limits = []
    for limit in (fit.revert, fit.confirm):
        if limit is None:
            limits.append("as it was" if takes else "-")
        elif limit.value is None:
            limits.append(f"{limit.missing} labels missing")
        else:
            limits.append(f"{limit.value:.3f}")
    return [
        fit.group.name,
        f"{accept.value:.3f}" if takes else f"nothing: {accept.missing} labels missing",
        fit.wrong.text if takes else "-",
        fit.right.text if takes else "-",
        *limits,
        by,
    ]


def _unlike(target: Target) -> str:
    """How the maps that are meant compare with the labelled ones."""
    apart = "too few to compare" if math.isnan(target.unlike) else f"scores {target.unlike:.2f} from the labelled ones"
    return (
        f"{target.examples} examples, accepted {target.accepted.text}, {apart} ({target.expected:.2f} is no surprise)"
    )


def _style(verdict: str) -> str:
    return {"none": "red", "not refuted": "yellow"}.get(verdict, "green")

"""``mapgraft decide``: why a procedure was chosen, or none."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any, cast, get_args

from mapgraft.config import ReversalName
from mapgraft.console import cell, print_json, results
from mapgraft.contracts import MapMetadata
from mapgraft.decision import METADATA_FIELDS, DecisionTable, Ruling, Value, build_table, facts_of
from mapgraft.errors import UsageError
from mapgraft.job import as_config, map_alone
from mapgraft.persons import RECORDED_SIGMA_M, sigma_m
from mapgraft.plugins import load_plugins
from mapgraft.robot import Robot


@dataclass(frozen=True, slots=True)
class Question:
    """Two maps described by hand: ``NAME=VALUE`` pairs of their metadata."""

    own: tuple[str, ...]
    other: tuple[str, ...]
    prior: bool
    reversal: str


@dataclass(frozen=True, slots=True)
class _Answer:
    receiver: str
    donor: str
    facts: Mapping[str, Value]
    ruling: Ruling


def explain(
    files: Sequence[Path],
    config: Path | None,
    rules: Path | None,
    question: Question,
    *,
    as_json: bool,
    without: Sequence[str],
) -> None:
    """Print the ruling for two described maps, or for every pair of robots of a recording."""
    plugins = load_plugins(without)
    checked = as_config(config)
    table = build_table(plugins, rules or checked.rules)
    if question.own or question.other:
        answers = [_described(table, question)]
    elif files:
        answers = list(_recorded(map_alone(files, checked, plugins, table), table))
    else:
        raise UsageError("name recordings, or describe two maps: --own type=occupancy_grid --other type=occupancy_grid")
    if as_json:
        print_json([_as_json(answer) for answer in answers])
        return
    for answer in answers:
        _print(answer)


def _described(table: DecisionTable, question: Question) -> _Answer:
    own, other = _metadata("--own", question.own), _metadata("--other", question.other)
    if question.reversal not in get_args(ReversalName):
        raise UsageError(f"--reversal must be one of {', '.join(get_args(ReversalName))}, found {question.reversal!r}")
    uncertain_m = RECORDED_SIGMA_M if question.prior else None
    facts = facts_of(own, other, uncertain_m, cast("ReversalName", question.reversal))
    return _Answer("own", "other", facts, table.choose(facts))


def _recorded(robots: Mapping[str, Robot], table: DecisionTable) -> Iterator[_Answer]:
    """Every ordered pair, with the maps as they are at the end of the recording."""
    metadata = {name: robot.map_type.metadata(robot.reversal.offered_layer()) for name, robot in robots.items()}
    for receiver, donor in permutations(sorted(robots), 2):
        own = robots[receiver]
        uncertain_m = sigma_m(own.hand.priors.get((receiver, donor)))
        facts = facts_of(metadata[receiver], metadata[donor], uncertain_m, own.reversal.name)
        yield _Answer(receiver, donor, facts, table.choose(facts))


def _metadata(option: str, pairs: Sequence[str]) -> MapMetadata:
    values: dict[str, Value] = {}
    for pair in pairs:
        name, separator, value = pair.partition("=")
        if not separator:
            raise UsageError(f"{option} wants NAME=VALUE, found {pair!r}")
        values[name] = _value(value)
    if "type" not in values:
        raise UsageError(f"{option} needs the map's type, as in {option} type=occupancy_grid")
    known = {name: value for name, value in values.items() if name in METADATA_FIELDS}
    extra = {name: value for name, value in values.items() if name not in METADATA_FIELDS}
    plain = dataclasses.replace(MapMetadata(str(known.pop("type"))), extra=extra)
    return dataclasses.replace(plain, **cast("dict[str, Any]", known))


def _value(text: str) -> Value:
    if text in ("true", "false"):
        return text == "true"
    for number in (int, float):
        try:
            return number(text)
        except ValueError:
            continue
    return text


def _as_json(answer: _Answer) -> dict[str, Any]:
    return {
        "receiver": answer.receiver,
        "donor": answer.donor,
        "facts": dict(answer.facts),
        "rejected": answer.ruling.rejected,
        "rule": answer.ruling.rule.name if answer.ruling.rule else None,
        "reason": answer.ruling.reason,
        "findings": [dataclasses.asdict(finding) for finding in answer.ruling.findings],
    }


def _print(answer: _Answer) -> None:
    console = results()
    console.print(cell(f"{answer.receiver} ← {answer.donor}"), style="bold")
    for finding in answer.ruling.findings:
        console.print(cell(f"  {'✓' if finding.applies else '✗'} {finding.rule}: {finding.reason}"))
    rule = answer.ruling.rule
    if rule is None or answer.ruling.rejected:
        console.print(cell(f"  rejected: {rule.reject if rule else 'no rule applies'}"))
        return
    procedure = rule.procedure
    via, every = f" via {rule.via}" if rule.via else "", procedure.verify.every
    console.print(
        cell(
            f"  procedure{via}: match {procedure.match.use}, accept {procedure.accept.use}, fuse {procedure.fuse.use}, "
            f"verify {procedure.verify.use} on {', '.join(procedure.verify.metric_names)} "
            f"{'at every observation' if every == 1 else f'every {every} observations'}"
        )
    )

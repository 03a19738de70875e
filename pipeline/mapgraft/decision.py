"""The decision table (section 2.1 of the paper): from the two maps' metadata to a procedure, or a rejection."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from ruamel.yaml import YAML

from mapgraft.config import Choice, ReversalName, Section, path_of, text_of
from mapgraft.contracts import DecisionTableError, MapMetadata
from mapgraft.documents import parse_yaml, read_text
from mapgraft.obstacles import Check, checked, lacking
from mapgraft.plugins import Broken, Plugins

Value = bool | int | float | str
PAIR_FIELDS = ("resolution_ratio", "scale_known", "prior", "prior_sigma_m", "reversal")
METADATA_FIELDS = tuple(f.name for f in dataclasses.fields(MapMetadata) if f.name != "extra")


class Range(Section):
    """A condition on a number; both ends are included."""

    min: float | None = None
    max: float | None = None


Condition = Range | list[Value] | Value


class Reverse(Section):
    allow: tuple[ReversalName, ...] = ("ledger", "multi_map", "single_map")


class Measuring(BaseModel):
    """An acceptor or verifier by name, the metrics it needs, and its own parameters beside them.

    ``metrics`` is a list of names, or a mapping from name to what the acceptor or verifier wants of it.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    use: str
    metrics: list[str] | dict[str, dict[str, Any]] = Field(default_factory=list)

    @property
    def metric_names(self) -> tuple[str, ...]:
        return tuple(self.metrics)

    @property
    def parameters(self) -> dict[str, Any]:
        limits = {"metrics": self.metrics} if isinstance(self.metrics, dict) else {}
        return {**(self.model_extra or {}), **limits}


class Logged(Section):
    """How often a merge that goes on as before is written down, in observations of the receiver.

    ``metrics`` are measured and written at that rhythm, too, but judge nothing. Where ``every`` is None it is every
    tenth of what is judged.
    """

    metrics: list[str] = Field(default_factory=list)
    every: int | None = Field(default=None, ge=1)


class Verification(Measuring):
    """The verifier measures and judges ``every`` so many observations of the receiver."""

    every: int = Field(default=10, ge=1)
    log: Logged = Logged()

    @property
    def told_every(self) -> int:
        """How many observations lie between two lines in the record, while nothing changes."""
        return self.log.every or 10 * self.every


class Retry(Section):
    """When a pair that was not merged is tried again, and a transform that was reverted is taken again.

    ``growth`` is the share by which the known area of one of the two maps must have grown since the last attempt, and
    ``reverted`` the factor by which the score of a reverted transform must have grown since.
    """

    growth: float = Field(default=0.1, ge=0.0, allow_inf_nan=False)
    reverted: float = Field(default=1.5, ge=1.0, allow_inf_nan=False)


class Refine(Section):
    """When the transform of a standing merge is registered anew.

    That is ``every`` so many observations of the receiver and when a newer version of the donor's map has come in, if
    one of the two maps has grown by the share ``growth`` since the last time; never where ``every`` is None.
    """

    every: int | None = Field(default=10, ge=1)
    growth: float = Field(default=0.1, ge=0.0, allow_inf_nan=False)


class Rule(Section):
    """One record of the table. ``priority`` goes before order; the first rule that applies is the procedure.

    A rule with ``reject`` (the reason as text) instead of a procedure turns the pair away.
    """

    name: str
    when: dict[str, Condition] = Field(default_factory=dict)
    via: str | None = None
    match: Choice | None = None
    accept: Measuring | None = None
    fuse: Choice | None = None
    verify: Verification | None = None
    reverse: Reverse = Reverse()
    retry: Retry = Retry()
    refine: Refine = Refine()
    metrics: dict[str, dict[str, Any]] = Field(default_factory=dict)
    candidates: int = Field(default=4, ge=1)
    priority: int = 0
    reject: str | None = None

    @field_validator("when")
    @classmethod
    def _known_fields(cls, when: dict[str, Condition]) -> dict[str, Condition]:
        for name in when:
            side, dot, _ = name.partition(".")
            if not (name in PAIR_FIELDS or (dot and side in ("own", "other"))):
                fields = ", ".join((*PAIR_FIELDS, *(f"own.{f}" for f in METADATA_FIELDS)))
                raise ValueError(f"there is no field {name!r}: use {fields}, other.…, or a type's extra as own.<name>")
        return when

    def model_post_init(self, _context: object) -> None:
        parts = {"match": self.match, "accept": self.accept, "fuse": self.fuse, "verify": self.verify}
        absent = [name for name, part in parts.items() if part is None]
        if self.reject is None and absent:
            raise ValueError(f"a procedure needs match, accept, fuse and verify; {', '.join(absent)} missing")
        if self.reject is not None and len(absent) < len(parts):
            raise ValueError("a rule either rejects or names a procedure, not both")

    @property
    def procedure(self) -> Procedure:
        """The procedure of a rule that does not reject."""
        if self.match is None or self.accept is None or self.fuse is None or self.verify is None:
            raise DecisionTableError(f"rule {self.name!r} rejects: it has no procedure")
        return Procedure(self, self.match, self.accept, self.fuse, self.verify)

    def is_about(self, facts: Mapping[str, Value]) -> bool:
        """Whether what it says of the two map types holds."""
        asked = [name for name in ("own.type", "other.type") if name in self.when and name in facts]
        return all(_failure(facts[name], self.when[name]) is None for name in asked)


@dataclass(frozen=True, slots=True)
class Procedure:
    """Matcher, acceptor, fuser, metrics and verifier that one rule names."""

    rule: Rule
    match: Choice
    accept: Measuring
    fuse: Choice
    verify: Verification

    @property
    def metric_names(self) -> tuple[str, ...]:
        """All metrics of the rule, each once, in the order in which they are named."""
        named = (*self.accept.metric_names, *self.verify.metric_names, *self.verify.log.metrics)
        return tuple(dict.fromkeys(named))

    def measuring(self, further: Sequence[str]) -> Procedure:
        """The same with further metrics, that are measured whenever the verifier looks."""
        if not further:
            return self
        metrics = list(dict.fromkeys((*self.verify.metric_names, *further)))
        return replace(self, verify=self.verify.model_copy(update={"metrics": metrics}))


@dataclass(frozen=True, slots=True)
class Finding:
    """Why one rule did or did not apply; ``about`` tells whether it is for maps of these two types at all."""

    rule: str
    applies: bool
    reason: str
    about: bool = True


@dataclass(frozen=True, slots=True)
class Ruling:
    """What the table says of a pair: a rule or none, and the finding of every rule that was looked at.

    ``types`` are the map types of receiver and donor.
    """

    rule: Rule | None
    findings: tuple[Finding, ...]
    types: tuple[str, str]

    @property
    def rejected(self) -> bool:
        return self.rule is None or self.rule.reject is not None

    @property
    def reason(self) -> str:
        """One line that explains the ruling; rules for maps of other types are not worth a word in it."""
        before = "; ".join(f"{f.rule!r}: {f.reason}" for f in self.findings if f.about and not f.applies)
        if self.rule is not None:
            said = self.rule.reject or f"rule {self.rule.name!r} applies"
            return f"{said} (rule {self.rule.name!r}; before it {before})" if before and self.rule.reject else said
        if not self.findings:
            return "the decision table is empty"
        if before:
            return f"no rule applies: {before}"
        own, other = self.types
        return f"no rule takes a map of type {other} into one of type {own}, all {len(self.findings)} are for others"


@dataclass(frozen=True, slots=True)
class Record:
    """A rule, what it names that is not installed, and what tells whether its procedure can take two map types."""

    rule: Rule
    lacking: str | None
    obstacle: Check


@dataclass(frozen=True, slots=True)
class DecisionTable:
    """Records in the order in which they are looked at, and the text they came from."""

    records: tuple[Record, ...]
    source: str

    def choose(self, facts: Mapping[str, Value], passed: Mapping[int, str] | None = None) -> Ruling:
        """The first rule whose conditions all hold and whose procedure is installed; later ones are not looked at.

        ``passed`` tells of rules, by their ``id``, that they are passed over, and why.
        """
        findings: list[Finding] = []
        own, other = str(facts.get("own.type")), str(facts.get("other.type"))
        for record in self.records:
            failure = _first_failure(record.rule, facts) or record.obstacle(own, other)
            failure = failure or (passed or {}).get(id(record.rule))
            findings.append(
                Finding(record.rule.name, failure is None, failure or "applies", record.rule.is_about(facts))
            )
            if failure is None:
                return Ruling(record.rule, tuple(findings), (own, other))
        return Ruling(None, tuple(findings), (own, other))


def facts_of(
    own: MapMetadata, other: MapMetadata, prior_sigma_m: float | None = None, reversal: ReversalName = "ledger"
) -> dict[str, Value]:
    """The fields that conditions may ask for; what a map does not tell is absent.

    ``prior_sigma_m`` is how uncertain a known relative pose is, None where nobody knows one.
    """
    facts: dict[str, Value] = {
        "prior": prior_sigma_m is not None,
        "reversal": reversal,
        "scale_known": own.scale_known and other.scale_known,
    }
    if prior_sigma_m is not None:
        facts["prior_sigma_m"] = prior_sigma_m
    if own.resolution_m and other.resolution_m:
        facts["resolution_ratio"] = own.resolution_m / other.resolution_m
    for side, metadata in (("own", own), ("other", other)):
        values = {name: getattr(metadata, name) for name in METADATA_FIELDS} | dict(metadata.extra)
        facts |= {f"{side}.{name}": value for name, value in values.items() if isinstance(value, Value)}
    return facts


def _first_failure(rule: Rule, facts: Mapping[str, Value]) -> str | None:
    reversal = facts.get("reversal")
    if rule.reject is None and reversal is not None and reversal not in rule.reverse.allow:
        return f"reversal is {reversal}, the rule allows {', '.join(rule.reverse.allow)}"
    for name, condition in rule.when.items():
        if name not in facts:
            return f"{name} is not told"
        if (text := _failure(facts[name], condition)) is not None:
            return f"{name} is {_spell(facts[name])}, {text}"
    return None


def holds(condition: Condition, value: Value) -> bool:
    """Whether a value meets a condition."""
    return _failure(value, condition) is None


def _failure(value: Value, condition: Condition) -> str | None:
    """None when the condition holds, else what it wants."""
    if isinstance(condition, Range):
        if isinstance(value, str | bool):
            return "the rule wants a number"
        if condition.min is not None and value < condition.min:
            return f"the rule wants at least {condition.min:g}"
        if condition.max is not None and value > condition.max:
            return f"the rule wants at most {condition.max:g}"
        return None
    allowed = condition if isinstance(condition, list) else [condition]
    if any(value == wanted and isinstance(value, bool) == isinstance(wanted, bool) for wanted in allowed):
        return None
    return f"the rule wants {' or '.join(map(_spell, allowed))}"


def _spell(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def parse_rules(text: str, origin: str) -> list[Rule]:
    """Rules from YAML text: a list, or a configuration that holds nothing but ``rules``.

    Raises DecisionTableError with every fault and its place.
    """
    return [rule.model_copy(deep=True) for rule in _parsed_rules(text, origin)]  # parameters may be lists


@lru_cache(maxsize=32)
def _parsed_rules(text: str, origin: str) -> tuple[Rule, ...]:
    """Remembered, because one process may run many missions by the same rules, and parsing takes longer than some."""
    given = parse_yaml(text, f"the decision table {origin}", DecisionTableError)
    if isinstance(given, dict) and set(given) == {"rules"}:
        given = given["rules"]
    return tuple(check_rules(given, origin))


def check_rules(given: object, origin: str) -> list[Rule]:
    """Rules from a list of mappings; raises DecisionTableError with every fault and its place."""
    if not isinstance(given, list):
        raise DecisionTableError(f"the decision table {origin} must be a list of rules, found {type(given).__name__}")
    rules: list[Rule] = []
    faults: list[str] = []
    for number, record in enumerate(given, start=1):
        name = record.get("name", "without name") if isinstance(record, dict) else "?"
        try:
            rules.append(Rule.model_validate(record))
        except ValidationError as error:
            faults += [f"  rule {number} ({name}), {path_of(f['loc'])}: {text_of(f)}" for f in error.errors()]
    if faults:
        raise DecisionTableError(f"the decision table {origin} has {len(faults)} fault(s):\n" + "\n".join(faults))
    return rules


def build_table(plugins: Plugins, own: Sequence[Mapping[str, Any]] | Path | None = None) -> DecisionTable:
    """The decision table: the user's rules if given, else those of all plugins; by priority, then by order.

    A fault in the user's rules raises DecisionTableError. A plugin whose rules do not fit is noted as broken, and a
    plugin's rule that names what is not installed stays in the table, never applies, and says why.
    """
    if own is None:
        rules, source = _rules_of_plugins(plugins)
    elif isinstance(own, Path):
        source = read_text(own, f"the decision table {own}", DecisionTableError)
        rules = parse_rules(source, str(own))
    else:
        rules, source = check_rules(list(own), "in the configuration"), _as_yaml(own)
    if own is not None:
        for rule in rules:
            if (why := lacking(rule, plugins)) is not None:
                raise DecisionTableError(f"rule {rule.name!r}: {why}")
    ordered = sorted(rules, key=lambda rule: -rule.priority)  # sorting is stable: equal priorities keep their order
    return DecisionTable(tuple(Record(rule, *checked(rule, plugins)) for rule in ordered), source)


def _rules_of_plugins(plugins: Plugins) -> tuple[list[Rule], str]:
    rules: list[Rule] = []
    source = ""
    for table in plugins.rules:
        try:
            rules += parse_rules(table.text, f"{table.name!r} of {table.origin.plugin}")
        except DecisionTableError as error:
            plugins.broken.append(Broken(table.origin, str(error)))
        else:
            source += f"# {table.name}, from {table.origin.plugin}\n{table.text.strip()}\n"
    return rules, source


def _as_yaml(rules: Sequence[Mapping[str, Any]]) -> str:
    buffer = io.StringIO()
    YAML(typ="safe", pure=True).dump([dict(rule) for rule in rules], buffer)
    return buffer.getvalue()

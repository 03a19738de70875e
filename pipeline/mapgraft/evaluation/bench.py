"""Where pairs are built and put through the procedures that are compared."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mapgraft.assembly import preferred_type
from mapgraft.config import Config
from mapgraft.contracts import Layer, MapType, Transform
from mapgraft.decision import DecisionTable, build_table
from mapgraft.errors import UsageError
from mapgraft.evaluation.building import build
from mapgraft.evaluation.courses import Course
from mapgraft.evaluation.drawing import Drawing, PairPlan, draw_pairs
from mapgraft.evaluation.growth import grow
from mapgraft.evaluation.paper import paper_rules
from mapgraft.evaluation.scored import Scored, score
from mapgraft.evaluation.trial import attempt, offering
from mapgraft.outputs.tables import Row
from mapgraft.plugins import Plugins
from mapgraft.procedures import Workshop
from mapgraft.substitution import substituted

JUDGED, BASELINE = "judged", "baseline"


@dataclass(frozen=True, slots=True)
class Settings:
    """What is evaluated.

    ``map_type`` None stands for what a run would take, ``other_map_type``, the donor's, for the receiver's; resolutions
    for those of the configuration or the map type, and ``other_resolution_m``, the donor's, for the receiver's.
    ``rules`` is a decision table instead of the installed one; ``matcher`` and ``verifier`` take the places of those in
    it. With ``baseline`` the rules of the paper are put through the same pairs, with ``examples`` every pair is made an
    example. ``given`` are true transforms of pairs, by number, that go before recorded poses.
    """

    drawing: Drawing = field(default_factory=Drawing)
    map_type: str | None = None
    resolution_m: float | None = None
    other_resolution_m: float | None = None
    rules: Path | None = None
    matcher: str | None = None
    verifier: str | None = None
    baseline: bool = True
    other_map_type: str | None = None
    examples: bool = False
    given: Mapping[int, Transform] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for resolution_m in (self.resolution_m, self.other_resolution_m):
            if resolution_m is not None and not 0.0 < resolution_m < math.inf:
                raise UsageError(f"a resolution must be above 0 metres, found {resolution_m:g}")


@dataclass(frozen=True, slots=True)
class Contender:
    """One way to go about a pair: a decision table with everything that it names."""

    name: str
    table: DecisionTable

    def title(self, rules: Iterable[str]) -> str:
        """What it is called for persons: by the matchers of the rules that applied, most frequent first."""
        matchers = {record.rule.name: record.rule.match for record in self.table.records}
        used = Counter(match.use for name in rules if (match := matchers.get(name)) is not None)
        said = ", ".join(name for name, _ in used.most_common()) or "no rule applied"
        return f"{said}, the paper's rules" if self.name == BASELINE else said


@dataclass(frozen=True, slots=True)
class Judged:
    """What every contender made of one pair, and the examples of that, in the order of the contenders."""

    number: int
    by: Mapping[str, Scored]
    examples: Sequence[Row] = ()


@dataclass(slots=True)
class Bench:
    """The drawn pairs and everything that is needed to put them through; ``remarks`` tell what was left out.

    Raises UsageError, ConfigError, DecisionTableError or PluginError when something does not fit.
    """

    courses: Sequence[Course]
    config: Config
    plugins: Plugins
    settings: Settings
    plans: list[PairPlan] = field(init=False)
    contenders: list[Contender] = field(init=False)
    map_type: str = field(init=False)
    remarks: list[str] = field(init=False)
    _workshop: Workshop = field(init=False)

    def __post_init__(self) -> None:
        settings, config = self.settings, self.config
        self.remarks = [f"{course.robot}: {course.doubt}" for course in self.courses if course.doubt]
        self._workshop = Workshop(self.plugins)
        kinds = {observation.kind for course in self.courses for observation in course.observations[:1]}
        self.map_type = settings.map_type or config.map.type or preferred_type(kinds, self.plugins)
        self._require_type()
        table = build_table(self.plugins, settings.rules or config.rules)
        table = substituted(table, self.plugins, matcher=settings.matcher, verifier=settings.verifier)
        self._workshop.prepare(table)
        self.contenders = [Contender(JUDGED, table)]
        if settings.baseline:
            self._add_baseline()
        self.plans = draw_pairs(self.courses, settings.drawing)
        self.remarks += _left_out(self.courses, settings.drawing)

    def new_types(self) -> tuple[MapType, MapType]:
        """Map types for a receiver and a donor."""
        config = self.config.map
        own_m = self.settings.resolution_m
        other_m = self.settings.other_resolution_m or (own_m if self.other_map_type == self.map_type else None)
        sides = ((self.map_type, own_m), (self.other_map_type, other_m))
        made = []
        for name, resolution_m in sides:
            given = config.parameters if config.type in (None, name) else {}
            told = given if resolution_m is None else given | {"resolution_m": resolution_m}
            made.append(self._workshop.new_map_type(name, told))
        return made[0], made[1]

    @property
    def other_map_type(self) -> str:
        """The donor's map type."""
        return self.settings.other_map_type or self.map_type

    def _converted(self, layer: Layer, source: MapType, target: MapType) -> Layer:
        return self._workshop.converter(source, target)(layer)

    def _require_type(self) -> None:
        """Raises UsageError when what was asked for is not installed, and what its parameters raise."""
        known = [offered.descriptor.name for offered in self.plugins.of_kind("map type")]
        for asked in (self.settings.map_type, self.settings.other_map_type):
            if asked is not None and asked not in known:
                raise UsageError(f"there is no map type {asked!r}: installed are {', '.join(known) or 'none'}")
        if self.plugins.way(self.other_map_type, self.map_type) is None:
            raise UsageError(
                f"a donor of type {self.other_map_type} cannot be judged for a receiver of type {self.map_type}: no "
                "conversion leads there; choose two types between which one does"
            )
        self.new_types()

    def judge(self, number: int) -> Judged:
        """Build one pair and put it through every contender."""
        from mapgraft.evaluation.exemplified import Exemplifier  # which needs what is here, and not everybody needs it

        pair = build(self.plans[number], *self.new_types(), self._converted, self.settings.given.get(number))
        growth, by = grow(pair), {}
        examples: list[Row] = []
        for contender in self.contenders:
            donor = offering(pair, contender.table, self._workshop)
            looking = Exemplifier.of(pair, self.config, self._workshop) if self.settings.examples else None
            collector = None if looking is None else looking.collector
            trial = attempt(pair, donor, contender.table, self._workshop, self.config.reversal, collector)
            by[contender.name] = score(pair, trial, growth)
            if looking is not None:
                examples.append(looking.row(pair, contender.name, growth))
        return Judged(number, by, examples)

    def _add_baseline(self) -> None:
        table = paper_rules(self.plugins)
        paper = table.records[0]
        why = paper.lacking
        if why is None and not paper.rule.is_about({"own.type": self.map_type, "other.type": self.other_map_type}):
            why = f"the paper's rules are not for {' and '.join(sorted({self.map_type, self.other_map_type}))}"
        if why is not None:
            self.remarks.append(f"no baseline: {why}")
        else:
            self.contenders.append(Contender(BASELINE, table))


def _left_out(courses: Sequence[Course], drawing: Drawing) -> list[str]:
    return [
        f"{course.robot} is left out: it has {len(course)} scans, a window with its further ones takes {drawing.span}"
        for course in courses
        if len(course) < drawing.span
    ]

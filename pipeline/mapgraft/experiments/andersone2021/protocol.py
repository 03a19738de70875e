"""Drawing pairs of partial maps until there are enough right and wrong merges of every combination of resolutions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from time import perf_counter

from mapgraft.comparison import Compared
from mapgraft.config import Config
from mapgraft.contracts import Candidate, Donation, Match, Metric, Provenance, Step
from mapgraft.decision import DecisionTable, build_table
from mapgraft.errors import MapError, RecordingError, UsageError
from mapgraft.evaluation.building import DONOR, Pair, build
from mapgraft.evaluation.courses import Course
from mapgraft.evaluation.drawing import Drawing, PairPlan, draw_on
from mapgraft.evaluation.paper import paper_rules
from mapgraft.evaluation.truth import Error, Truth
from mapgraft.experiments.andersone2021.keeping import Graft, kept_every_way
from mapgraft.experiments.andersone2021.outcome import Experiment, Merge, Search
from mapgraft.experiments.andersone2021.settings import MAP_TYPE, METRICS, Combination, Settings
from mapgraft.experiments.andersone2021.watching import Watcher
from mapgraft.plugins import Plugins
from mapgraft.procedures import Tools, Workshop
from mapgraft.substitution import substituted

Progress = Callable[[int, int, int], None]  # merges found so far, merges wanted, pairs drawn


def conduct(laboratory: Laboratory, progress: Progress = lambda found, wanted, drawn: None) -> Experiment:
    """The whole experiment on what some robots have observed, with poses that are taken as true.

    Raises RecordingError where no merge was accepted at all, UsageError when the recordings are too short.
    """
    began_s, settings = perf_counter(), laboratory.settings
    wanted = len(settings.combinations) * (settings.right + settings.wrong)
    merges: list[Merge] = []
    searches: list[Search] = []
    progress(0, wanted, 0)
    for combination in settings.combinations:
        seek = _Seek(combination, settings)
        before = sum(search.drawn for search in searches)
        for merge in laboratory.merges(seek):
            merges += [merge] if merge is not None else []
            progress(len(merges), wanted, before + seek.seen["drawn"])
        searches.append(seek.told())
    if not merges:
        drawn = sum(search.drawn for search in searches)
        raise RecordingError(
            f"of {drawn} pairs of partial maps none was merged by {laboratory.matcher}: "
            "name a recording in which the robot comes by the same places again"
        )
    return Experiment(
        settings,
        laboratory.matcher,
        laboratory.similarity_min,
        merges,
        searches,
        laboratory.watcher.better,
        [*_doubts(laboratory.courses), *(remark for search in searches for remark in _short(search, settings))],
        perf_counter() - began_s,
    )


@dataclass(slots=True)
class _Seek:
    """What is still wanted of one combination, and what was seen so far."""

    combination: Combination
    settings: Settings
    seen: Counter[str] = field(default_factory=Counter)

    @property
    def done(self) -> bool:
        return self.seen["right"] >= self.settings.right and self.seen["wrong"] >= self.settings.wrong

    def wants(self, *, right: bool) -> bool:
        """Whether one more of that kind is wanted; counts it."""
        kind = "right" if right else "wrong"
        self.seen[kind] += 1
        return self.seen[kind] <= (self.settings.right if right else self.settings.wrong)

    def told(self) -> Search:
        seen = self.seen
        counts = (seen[kind] for kind in ("drawn", "right", "wrong", "refused", "unmatched"))
        return Search(self.combination, *counts)


@dataclass(slots=True)
class Laboratory:
    """Everything that merges are made with: the courses, the paper's rules, and our own to watch over them."""

    courses: Sequence[Course]
    config: Config
    settings: Settings
    workshop: Workshop
    table: DecisionTable
    tools: Tools
    watcher: Watcher

    @classmethod
    def of(cls, courses: Sequence[Course], config: Config, settings: Settings, plugins: Plugins) -> Laboratory:
        """Everything made ready.

        Raises UsageError when something that the paper's rules need is missing or no matcher has that name,
        DecisionTableError, ConfigError or PluginError when the installed rules or the configuration are at fault.
        """
        workshop = Workshop(plugins)
        paper, ours = paper_rules(plugins), build_table(plugins, config.rules)
        if (lacking := paper.records[0].lacking) is not None:
            raise UsageError(f"the paper's rules cannot be used: {lacking}")
        if config.map.type not in (None, MAP_TYPE):
            raise UsageError(f"the paper's maps are of the type {MAP_TYPE}, the configuration wants {config.map.type}")
        paper = substituted(paper, plugins, matcher=settings.matcher)
        for table in (paper, ours):
            workshop.prepare(table)
        tools = workshop.tools(paper.records[0].rule)
        return cls(courses, config, settings, workshop, paper, tools, Watcher(ours, workshop))

    @property
    def matcher(self) -> str:
        return self.tools.procedure.match.use

    @property
    def metrics(self) -> Mapping[str, Metric]:
        return {name: self.tools.metrics[name] for name in METRICS}

    @property
    def similarity_min(self) -> float:
        """The least similarity at which a merge is accepted."""
        return float(self.tools.procedure.accept.parameters["metrics"]["similarity"]["min"])

    def merges(self, seek: _Seek) -> Iterator[Merge | None]:
        """The merges of one combination that are wanted, in the order in which they are drawn; None for other pairs."""
        for plan in islice(self.plans(), self.settings.most_draws):
            if seek.done:
                return
            seek.seen["drawn"] += 1
            if (graft := self._graft(seek, plan)) is None:
                yield None
                continue
            error = truth_of(graft.pair).error(graft.match.T_receiver_donor)
            wanted = seek.wants(right=error.right)
            yield self._merge(seek.combination, graft, error) if wanted else None

    def plans(self) -> Iterator[PairPlan]:
        """The pairs of windows, the same for every combination."""
        settings = self.settings
        return draw_on(self.courses, Drawing(1, settings.scans, settings.further, 0.0, settings.seed))

    def built(self, plan: PairPlan, combination: Combination) -> Pair:
        """Both partial maps of a plan in the resolutions of a combination."""
        given = self.config.map.parameters if self.config.map.type == MAP_TYPE else {}
        own, other = (self.workshop.new_map_type(MAP_TYPE, {**given, "resolution_m": m}) for m in combination)
        return build(plan, own, other)

    def graft(self, pair: Pair, match: Match) -> Graft:
        """The pair with the contribution that the paper's fuser makes of the donor's map."""
        donor = Donation(pair.donor.layer, Provenance(DONOR, 1, len(pair.donor.observations)))
        return Graft(pair, match, self.tools.fuser.fuse(pair.receiver.map_type, pair.receiver.map, donor, match))

    def _graft(self, seek: _Seek, plan: PairPlan) -> Graft | None:
        """The pair with its donor fused in, where the paper's rules accept a match."""
        pair = self.built(plan, seek.combination)
        try:
            found = self.tools.matcher.match(pair.receiver.map, pair.donor.map, None)
            candidates = [self._candidate(pair, match) for match in found[: self.tools.rule.candidates]]
            decision = self.tools.acceptor.accept(candidates)
        except MapError:  # too little is in one of the maps
            candidates = []
        if not candidates:
            seek.seen["unmatched"] += 1
            return None
        if decision.chosen is None:
            seek.seen["refused"] += 1
            return None
        return self.graft(pair, candidates[decision.chosen].match)

    def _candidate(self, pair: Pair, match: Match) -> Candidate:
        own = pair.receiver
        placed = own.map_type.place(pair.donor.layer, match.T_receiver_donor, match.scale)
        T = match.T_receiver_donor.snapped()
        compared = Compared(own.map_type, "own", T, match, placed, lambda: (own.layer, own.map))
        return Candidate(match, {name: metric.track(compared).update(Step()) for name, metric in self.metrics.items()})

    def _merge(self, combination: Combination, graft: Graft, error: Error) -> Merge:
        return Merge(
            combination=combination,
            number=graft.pair.plan.number,
            plan=graft.pair.plan,
            right=error.right,
            overlap=graft.pair.overlap,
            error_m=error.displacement_m,
            error_deg=error.rotation_deg,
            T_receiver_donor=graft.match.T_receiver_donor,
            score=graft.match.score,
            by=kept_every_way(graft, self.metrics),
            watched=self.watcher.watch(graft),
        )


def truth_of(pair: Pair) -> Truth:
    """The truth about a pair of one recording."""
    if pair.truth is None:
        raise ValueError("a pair across recordings has no truth")
    return pair.truth


def _doubts(courses: Sequence[Course]) -> list[str]:
    return [f"{course.robot}: {course.doubt}" for course in courses if course.doubt]


def _short(search: Search, settings: Settings) -> Iterator[str]:
    """Sentences on what could not be found."""
    for kind, found, wanted in (("right", search.right, settings.right), ("wrong", search.wrong, settings.wrong)):
        if found < wanted:
            yield (
                f"{search.combination.name}: {found} of {wanted} {kind} merges were found in {search.drawn} pairs; "
                "its averages rest on those"
            )

"""The evaluation as one call: recordings and settings in, everything that is known about the pairs out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from mapgraft.config import Config
from mapgraft.errors import UsageError
from mapgraft.evaluation.bench import JUDGED, Bench, Judged, Settings
from mapgraft.evaluation.courses import Course, joined, load_courses
from mapgraft.evaluation.drawing import PairPlan
from mapgraft.evaluation.scored import Scored
from mapgraft.evaluation.statistics import resampled
from mapgraft.evaluation.summary import Summary, Times, summarize, times_of
from mapgraft.evaluation.workers import workers
from mapgraft.plugins import Plugins

Progress = Callable[[int], None]
Take = Callable[[Judged], Judged]


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """What came of it: one Judged per plan; titles, summaries and times of the contenders, by their names.

    ``remarks`` are sentences about what is doubtful or was left out.
    """

    bench: Bench
    judged: Sequence[Judged]
    remarks: Sequence[str]
    titles: Mapping[str, str]
    summaries: Mapping[str, Summary]
    times: Mapping[str, Times]
    elapsed_s: float


def evaluate(
    files: Sequence[Path],
    config: Config,
    settings: Settings,
    plugins: Plugins,
    *,
    jobs: int = 1,
    progress: Progress = lambda done: None,
    truth: Path | None = None,
    examples: Path | None = None,
) -> Evaluation:
    """Draw pairs of windows from some recordings, and find out how the procedures for them do.

    ``progress`` is told how many pairs are done, 0 when the first begins. With ``jobs`` above 1 as many processes share
    the work; what comes out, but for the times, is the same. ``truth`` is a CSV file of labels: where persons hold the
    maps of two robots, or those of a pair, to lie goes before what was recorded. ``examples`` is a folder to which
    every pair is written as an example. Raises MapgraftError with one sentence when something does not fit.
    """
    from mapgraft.evaluation.exemplified import Identified, joined_by, told_of, unused_of

    _check_jobs(jobs)
    courses = load_courses(files, config, plugins)
    if truth is None and examples is None:
        return evaluate_courses(courses, config, settings, plugins, jobs=jobs, progress=progress)
    joints = {} if truth is None else joined_by(truth, courses)
    courses = joined(courses, joints)
    identified = Identified.of(files, Bench(courses, config, plugins, settings), joints)
    said: list[str] = []
    if truth is not None:
        settings = replace(settings, given=told_of(truth, identified.run_id, settings.drawing.pairs))
        said = unused_of(truth, identified.run_id, courses)
    if examples is None:
        evaluation = evaluate_courses(courses, config, settings, plugins, jobs=jobs, progress=progress)
    else:
        settings = replace(settings, examples=True)
        with identified.writing(examples) as take:
            evaluation = evaluate_courses(courses, config, settings, plugins, jobs=jobs, progress=progress, take=take)
    return replace(evaluation, remarks=[*said, *evaluation.remarks])


def evaluate_courses(
    courses: Sequence[Course],
    config: Config,
    settings: Settings,
    plugins: Plugins,
    *,
    jobs: int = 1,
    progress: Progress = lambda done: None,
    take: Take = lambda judged: judged,
) -> Evaluation:
    """As ``evaluate``, of what is in memory already; ``take`` gets each pair, and gives what is kept of it."""
    _check_jobs(jobs)
    began_s = perf_counter()
    bench = Bench(courses, config, plugins, settings)
    judged: list[Judged] = []
    progress(0)
    with _results(bench, min(jobs, len(bench.plans))) as results:
        for one in results:
            judged.append(take(one))
            progress(len(judged))
    weights = resampled(blocks_of(bench.plans), settings.drawing.seed)
    by = {contender.name: [one.by[contender.name] for one in judged] for contender in bench.contenders}
    return Evaluation(
        bench,
        judged,
        [*bench.remarks, *_turned_away(by[JUDGED])],
        {
            contender.name: contender.title(scored.rule for scored in by[contender.name])
            for contender in bench.contenders
        },
        {name: summarize(scored, weights) for name, scored in by.items()},
        {name: times_of(scored) for name, scored in by.items()},
        perf_counter() - began_s,
    )


def _turned_away(scored: Sequence[Scored]) -> list[str]:
    """A sentence on why the decision table turned pairs away, where it did."""
    reasons = Counter(one.reason for one in scored if one.verdict == "rejected")
    return [
        f"{reasons.total()} of {len(scored)} pairs were turned away by the decision table: {reason}"
        for reason, _ in reasons.most_common(1)
    ]


def _check_jobs(jobs: int) -> None:
    if jobs < 1:
        raise UsageError(f"jobs must be at least 1, found {jobs}")


def blocks_of(plans: Sequence[PairPlan]) -> NDArray[np.int64]:
    """The blocks (n, 2) of the windows of each pair, numbered."""
    numbers: dict[tuple[int, int], int] = {}
    for plan in plans:
        for window in (plan.receiver, plan.donor):
            numbers.setdefault(window.block, len(numbers))
    return np.array([(numbers[plan.receiver.block], numbers[plan.donor.block]) for plan in plans], np.int64)


@contextmanager
def _results(bench: Bench, jobs: int) -> Iterator[Iterator[Judged]]:
    """The pairs' results in order, from this process or from several."""
    numbers = range(len(bench.plans))
    if jobs == 1:
        bench.judge(0)  # compiles and loads what there is, so that no time tells of that
        yield map(bench.judge, numbers)
        return
    with workers(bench, jobs) as results:
        yield results

"""Running a corpus: every job that is not done yet, on any executor, until each has come to its end."""

from __future__ import annotations

import queue
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Protocol

from mapgraft.config import parse_config
from mapgraft.corpus.dataset import Dataset
from mapgraft.corpus.executors import ends_calls
from mapgraft.corpus.fetching import Digests, named_inputs, places_of, scratch
from mapgraft.corpus.member import TimeLimitError
from mapgraft.corpus.places import is_url
from mapgraft.corpus.plan import Job
from mapgraft.corpus.recordings import FarRecording, far_recording
from mapgraft.corpus.working import Outcome, Task, failure_row, identity, work
from mapgraft.errors import MapgraftError, OutputError
from mapgraft.plugins import load_plugins

RETRIES = 2
_LOOKING = 16  # threads that ask a store about files; each waits for answers
_WAITING_S = 0.5  # between two chances for Ctrl-C


class Progress(Protocol):
    """Takes how many jobs have come to their end, of how many, and what the last one was."""

    def __call__(self, done: int, wanted: int, said: str = ..., /) -> None: ...


@dataclass(frozen=True, slots=True)
class Failed:
    """A job that has failed for good."""

    job: Job
    outcome: Outcome
    attempts: int


@dataclass(slots=True)
class Report:
    """What became of a corpus: ``done`` now, ``kept`` from before, ``failed``; run ids by job, each once."""

    done: dict[Job, Outcome] = field(default_factory=dict)
    kept: dict[Job, str] = field(default_factory=dict)
    failed: list[Failed] = field(default_factory=list)
    retried: int = 0

    @property
    def ended(self) -> int:
        return len(self.done) + len(self.kept) + len(self.failed)


def run_corpus(
    jobs: Sequence[Job],
    dataset: str,
    executor: Executor,
    *,
    retries: int = RETRIES,
    without: Sequence[str] = (),
    progress: Progress | None = None,
) -> Report:
    """Do all jobs that the data set does not have; returns when each is there or has failed.

    ``executor`` is any of ``concurrent.futures``, whose workers can write the ``dataset`` (a path or URL). A job that
    fails for a reason that may pass is tried again, at most ``retries`` times, behind all others; one that fails for
    good gets a row in ``failures``. The time limit of a job holds where ``ends_calls`` says so. ``without`` names
    plugins to leave out. Raises OutputError when the data set cannot be read or written, or when the executor is broken
    (BrokenExecutor), and lets KeyboardInterrupt pass: what is done is there, and the same call goes on from it.
    """
    course = _Course(Dataset(dataset), executor, retries, tuple(without), progress, len(jobs))
    try:
        course.begin(jobs)
    except BrokenExecutor as error:
        why = str(error).rstrip(".") or "the executor is broken"
        raise OutputError(f"{why}: what is done is in the data set, and the same command goes on from there") from error
    return course.report


class _Course:
    """The state of one call of ``run_corpus``."""

    def __init__(
        self,
        dataset: Dataset,
        executor: Executor,
        retries: int,
        without: tuple[str, ...],
        progress: Progress | None,
        wanted: int,
    ) -> None:
        self.report = Report()
        self._dataset, self._executor, self._retries = dataset, executor, retries
        self._without, self._progress, self._wanted = without, progress, wanted
        self._ended: queue.SimpleQueue[tuple[Task, Future[Outcome]]] = queue.SimpleQueue()
        self._under_way = 0
        self._run_ids: dict[str, Job] = {}  # of jobs that were done now
        self._noted: set[str] = set()  # ids of jobs that had failed before

    def begin(self, jobs: Sequence[Job]) -> None:
        """Submit what is not there, and see it to its end."""
        self._dataset.prepare()
        self._noted = self._dataset.failures()
        digests = _digests(jobs, self._dataset)
        there = those_there(jobs, self._dataset, self._without, digests)
        by_path = dict[str, dict[tuple[str, int, int], str]]()
        for key, digest in digests.items():
            by_path.setdefault(key[0], {})[key] = digest
        for job in jobs:
            if job in there:
                self.report.kept[job] = there[job]
                self._forgive(job)
                self._tell(job)
            else:
                own = {key: digest for place in places_of(job) for key, digest in by_path.get(place, {}).items()}
                self._submit(Task(job, self._dataset.url, own, self._without))
        while self._under_way:
            self._hear(*self._next())

    def _submit(self, task: Task) -> None:
        limit_s, executor = task.job.time_limit_s, self._executor
        if limit_s is not None and ends_calls(executor):
            future = executor.submit_within(limit_s, work, task)
        else:
            future = executor.submit(work, task)
        self._under_way += 1
        future.add_done_callback(lambda ended: self._ended.put((task, ended)))

    def _next(self) -> tuple[Task, Future[Outcome]]:
        while True:
            try:
                return self._ended.get(timeout=_WAITING_S)
            except queue.Empty:
                continue

    def _hear(self, task: Task, future: Future[Outcome]) -> None:
        self._under_way -= 1
        outcome = _outcome(task, future)
        if outcome.state == "failed":
            self._failed(task, outcome)
            return
        twin = self._run_ids.setdefault(outcome.run_id, task.job) if outcome.state == "done" else task.job
        if twin != task.job and not task.anew:
            # Two jobs of equal contents were under way at once, and wrote the same names: one of them writes all again.
            self._submit(replace(task, anew=True))
            return
        if outcome.state == "done":
            self.report.done[task.job] = outcome
        else:
            self.report.kept[task.job] = outcome.run_id
        self._forgive(task.job)
        self._tell(task.job)

    def _forgive(self, job: Job) -> None:
        if job.id in self._noted:
            self._dataset.forgive(job.id)
            self._noted.discard(job.id)

    def _failed(self, task: Task, outcome: Outcome) -> None:
        if outcome.again and task.attempt <= self._retries:
            self.report.retried += 1
            self._submit(replace(task, attempt=task.attempt + 1))
            return
        self.report.failed.append(Failed(task.job, outcome, task.attempt))
        with scratch() as folder:
            self._dataset.fail(task.job.id, failure_row(task.job, outcome, task.attempt), folder)
        self._tell(task.job)

    def _tell(self, job: Job) -> None:
        if self._progress is not None:
            failed = f", {len(self.report.failed)} failed" if self.report.failed else ""
            self._progress(self.report.ended, self._wanted, f"{job.title}{failed}")


def _outcome(task: Task, future: Future[Outcome]) -> Outcome:
    """What a worker said; a failure, where it did not come to say anything.

    What took too long once is not tried again: it would most likely take its time again. Raises BrokenExecutor: no job
    is to blame for that.
    """
    try:
        return future.result()
    except BrokenExecutor:
        raise
    except TimeLimitError as error:
        reason = f"{error}, as job_time_limit_s says: give more where such missions need it"
        return Outcome(task.job.id, "failed", "", error.limit_s, error=type(error).__name__, reason=reason)
    except CancelledError:
        return Outcome(task.job.id, "failed", error="CancelledError", reason="it was cancelled", again=True)
    except Exception as error:
        reason = " ".join(str(error).split()) or "it gave no reason"
        return Outcome(task.job.id, "failed", error=type(error).__name__, reason=reason, again=True)


def those_there(
    jobs: Sequence[Job], dataset: Dataset, without: Sequence[str] = (), digests: Digests | None = None
) -> dict[Job, str]:
    """The jobs whose runs a data set has, with the ids of these, as far as can be told without reading a recording."""
    there = dataset.runs()
    if not there:
        return {}
    ids = _ids_of(jobs, _digests(jobs, dataset) if digests is None else digests, without)
    return {job: run_id for job, run_id in ids.items() if run_id in there}


def _digests(jobs: Sequence[Job], dataset: Dataset) -> Digests:
    """What earlier runs found out about files; not asked for where all are in stores, which know that themselves."""
    return dataset.digests() if any(_is_near(job) for job in jobs) else {}


def _ids_of(jobs: Sequence[Job], digests: Digests, without: Sequence[str]) -> dict[Job, str]:
    """The ids of the runs that jobs make, for those whose files are known without reading them."""
    far, plugins = _looked_up(jobs), load_plugins(without)
    found: dict[Job, str] = {}
    with scratch() as folder:
        for job in jobs:
            own = {url: far[url] for url in places_of(job) if url in far}
            inputs = named_inputs(job, folder, own, digests)
            if inputs is None:
                continue
            try:
                found[job] = identity(inputs, parse_config(inputs.content), plugins)
            except MapgraftError:  # the worker tells
                continue
    return found


def _looked_up(jobs: Sequence[Job]) -> dict[str, FarRecording]:
    """What the stores say of all files elsewhere; those that are not there are left out."""
    urls = sorted({place for job in jobs for place in places_of(job) if is_url(place)})

    def look(url: str) -> FarRecording | None:
        try:
            return far_recording(url)
        except MapgraftError:
            return None

    with ThreadPoolExecutor(_LOOKING) as pool:
        return {url: found for url, found in zip(urls, pool.map(look, urls), strict=True) if found is not None}


def _is_near(job: Job) -> bool:
    return not all(map(is_url, places_of(job)))

"""``mapgraft corpus``: many missions and configurations into one data set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import typer
from rich.table import Table

from mapgraft.commands.progress import counting
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.corpus.dataset import Dataset
from mapgraft.corpus.document import read_plan
from mapgraft.corpus.executors import ends_calls, executor_of
from mapgraft.corpus.places import whole
from mapgraft.corpus.plan import Job
from mapgraft.corpus.running import Report, run_corpus, those_there
from mapgraft.plugins import load_plugins


@dataclass(frozen=True, slots=True)
class Asked:
    """What was said on the command line."""

    source: str
    dataset: str
    configs: tuple[str, ...]
    executor: str
    workers: int | None
    retries: int
    without: tuple[str, ...]


def corpus_and_show(asked: Asked, *, dry_run: bool, quiet: bool, as_json: bool) -> None:
    """Run a corpus and print what came of it; exit code 1 when a job has failed."""
    plugins = load_plugins(asked.without)
    for broken in plugins.broken:
        remarks().print(cell(f"the plugin {broken.origin.plugin} could not be loaded: {broken.reason}"), style="yellow")
    jobs = read_plan(asked.source, asked.configs, plugins)
    dataset = whole(asked.dataset)
    if dry_run:
        _list(jobs, those_there(jobs, Dataset(dataset), asked.without), as_json=as_json)
        return
    with (
        executor_of(asked.executor, asked.workers) as executor,
        counting("looking for what is there", "jobs", quiet=quiet or as_json) as progress,
    ):
        if any(job.time_limit_s is not None for job in jobs) and not ends_calls(executor):
            said = f"job_time_limit_s does not hold: --executor {asked.executor} cannot end a job, processes can"
            remarks().print(cell(said), style="yellow")
        report = run_corpus(jobs, dataset, executor, retries=asked.retries, without=asked.without, progress=progress)
    if as_json:
        print_json(_as_json(report, dataset))
    else:
        _print(report, dataset)
    if report.failed:
        raise typer.Exit(1)


def _list(jobs: Sequence[Job], there: dict[Job, str], *, as_json: bool) -> None:
    if as_json:
        print_json([{**_named(job), "files": list(job.files), "run_id": there.get(job)} for job in jobs])
        return
    table = Table("mission", "config", "recordings", "run")
    for job in jobs:
        table.add_row(cell(job.mission), cell(job.config), cell("\n".join(job.files)), there.get(job, "to be done"))
    results().print(table)


def _print(report: Report, dataset: str) -> None:
    console = results()
    if report.failed:
        table = Table("mission", "config", "tried", "failed because", title="Failed", title_justify="left")
        for failed in report.failed:
            job = failed.job
            table.add_row(cell(job.mission), cell(job.config), str(failed.attempts), cell(failed.outcome.reason))
        console.print(table)
    parts = [f"{len(report.done)} done", f"{len(report.kept)} there before", f"{len(report.failed)} failed"]
    tries = f" ({report.retried} tried again)" if report.retried else ""
    console.print(cell(f"{', '.join(parts)}{tries}."))
    if fetched := sum(outcome.fetched_bytes for outcome in report.done.values()):
        console.print(cell(f"{fetched / 1e6:,.1f} MB of recordings were fetched."))
    console.print(cell(f"Written to {dataset}"))


def _as_json(report: Report, dataset: str) -> dict[str, Any]:
    return {
        "dataset": dataset,
        "done": [
            {
                **_named(job),
                "run_id": outcome.run_id,
                "elapsed_s": outcome.elapsed_s,
                "fetched_bytes": outcome.fetched_bytes,
            }
            for job, outcome in report.done.items()
        ],
        "kept": [{**_named(job), "run_id": run_id} for job, run_id in report.kept.items()],
        "failed": [
            {
                **_named(failed.job),
                "error": failed.outcome.error,
                "reason": failed.outcome.reason,
                "attempts": failed.attempts,
            }
            for failed in report.failed
        ],
        "retried": report.retried,
    }


def _named(job: Job) -> dict[str, str]:
    return {"job": job.id, "mission": job.mission, "config": job.config}

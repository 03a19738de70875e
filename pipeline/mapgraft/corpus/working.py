"""One job, wherever it is run: its tables in the data set, or a sentence on why not."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, time_ns
from typing import Literal

from ruamel.yaml import YAML

from mapgraft import __version__
from mapgraft.config import Config, parse_config
from mapgraft.corpus.dataset import Dataset
from mapgraft.corpus.fetching import Digests, Inputs, fetched_inputs, scratch
from mapgraft.corpus.parts import RunParts
from mapgraft.corpus.plan import Job
from mapgraft.decision import build_table
from mapgraft.errors import MapError, MapgraftError, RecordingError, TransformError, UsageError
from mapgraft.job import Result, identify, run
from mapgraft.outputs.provenance import RunProvenance
from mapgraft.outputs.tables import Row
from mapgraft.plugins import Plugins, load_plugins

_FINAL = (UsageError, RecordingError, MapError, TransformError)
"""What is wrong with a recording or a configuration is as wrong the next time."""


@dataclass(frozen=True, slots=True)
class Task:
    """A job with what a worker needs for it.

    ``digests`` are those of its files, as far as they are known. ``without`` names plugins to leave out. A job that is
    done ``anew`` replaces what is in the data set. ``attempt`` counts from 1.
    """

    job: Job
    dataset: str
    digests: Digests = field(default_factory=dict)
    without: tuple[str, ...] = ()
    anew: bool = False
    attempt: int = 1


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a task: ``done``, ``kept`` (it was there) or ``failed``, for ``error`` and ``reason``.

    ``again`` tells whether a failed one may succeed the next time. ``fetched_bytes`` counts what was read elsewhere.
    """

    job_id: str
    state: Literal["done", "kept", "failed"]
    run_id: str = ""
    elapsed_s: float = 0.0
    fetched_bytes: int = 0
    error: str = ""
    reason: str = ""
    again: bool = False


def work(task: Task) -> Outcome:
    """Do a job, unless the data set has it. Never raises for anything that goes wrong: not every error can travel."""
    began_s, told = monotonic(), _Sentences()
    try:
        with scratch() as folder:
            told.folder = folder
            run_id, state, fetched_bytes = _worked(task, folder, told)
    except Exception as error:
        taken_s = monotonic() - began_s
        reason = told.of(str(error) or "it gave no reason")
        if not isinstance(error, MapgraftError | OSError):
            reason = f"internal error, {type(error).__name__}: {reason}"
        again = not isinstance(error, _FINAL) or isinstance(error.__cause__, OSError)
        return Outcome(task.job.id, "failed", "", taken_s, 0, type(error).__name__, reason, again)
    return Outcome(task.job.id, state, run_id, monotonic() - began_s, fetched_bytes)


@dataclass(slots=True)
class _Sentences:
    """Sentences about files elsewhere name the path that stood for them; nobody can look there."""

    folder: Path | None = None

    def of(self, text: str) -> str:
        return text if self.folder is None else re.sub(rf"{re.escape(str(self.folder))}/(\w+)/", r"\1://", text)


def _worked(task: Task, folder: Path, told: _Sentences) -> tuple[str, Literal["done", "kept"], int]:
    dataset = Dataset(task.dataset)
    plugins = load_plugins(task.without)
    inputs = fetched_inputs(task.job, folder, task.digests)
    config = parse_config(inputs.content, origin=f"the configuration of {task.job.title}")
    run_id = identity(inputs, config, plugins)
    if dataset.has(run_id) and not task.anew:
        return run_id, "kept", inputs.fetched_bytes
    kept: list[RunParts] = []

    def opened(_stem: str, told_id: str, provenance: RunProvenance) -> RunParts:
        kept.append(RunParts(folder / "parts", told_id, provenance, config.output.examples))
        return kept[-1]

    try:
        result = run(inputs.paths, config, opened, plugins=plugins, stand_ins=inputs.stand_ins)
    except Exception:
        inputs.require_read()  # where a file was no longer the same, or not there for a moment, that is to blame
        raise
    inputs.require_read()
    dataset.append(run_id, kept[0].parts, _run_row(task.job, result, told), folder)
    return run_id, "done", inputs.fetched_bytes


def identity(inputs: Inputs, config: Config, plugins: Plugins) -> str:
    """The id of the run that a job makes of its inputs."""
    return identify(inputs.paths, config, plugins, build_table(plugins, config.rules), inputs.known)[1]


def _run_row(job: Job, result: Result, told: _Sentences) -> Row:
    """What the table ``runs`` tells of a run."""
    states = [event.state for event in result.standing.values()]
    kinds = [event.kind for event in result.events]
    return {
        "mission": job.mission,
        "config": job.config,
        "config_text": _as_yaml(job.content),
        "version": __version__,
        "robots": sorted(result.maps),
        "start": result.start_ns,
        "observations": result.observations,
        "merges": kinds.count("merged"),
        "reverted": kinds.count("reverted"),
        "confirmed": states.count("confirmed"),
        "provisional": states.count("provisional"),
        "exchanged_bytes": sum(result.traffic.values()),
        "lost": [told.of(sentence) for sentence in result.lost],
        "remarks": [told.of(sentence) for sentence in result.remarks],
    }


def failure_row(job: Job, outcome: Outcome, attempts: int) -> Row:
    """What the table ``failures`` tells of a job."""
    return {
        "mission": job.mission,
        "config": job.config,
        "files": list(job.files),
        "error": outcome.error,
        "reason": outcome.reason,
        "attempts": attempts,
        "failed_at": time_ns(),
    }


def _as_yaml(content: object) -> str:
    buffer = io.StringIO()
    YAML(typ="safe", pure=True).dump(content, buffer)
    return buffer.getvalue()

"""A Dask cluster of two worker processes, one of which is killed midway: the data set is complete and equal."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mapgraft.corpus import Dataset, executor_of, read_plan, run_corpus
from mapgraft.errors import UsageError

distributed = pytest.importorskip("distributed", reason="needs the extra dask")
PATIENCE_S = 240.0


def waited_for(said: str, enough: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not enough():
        if time.monotonic() > deadline:
            pytest.fail(f"{said} did not happen")
        time.sleep(0.05)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler's address, and two workers without nannies: nobody starts them again."""
    told = tmp_path / "scheduler.json"
    common = ["--scheduler-file", str(told), "--no-dashboard"]
    server = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *common]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", *common]
    worker += ["--local-directory", str(tmp_path), "--death-timeout", "120"]
    environment = os.environ | {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "20s"}
    with (tmp_path / "log").open("wb") as log:
        started = [subprocess.Popen(server, stdout=log, stderr=log, env=environment)]
        try:
            waited_for("the scheduler's start", lambda: told.is_file() and told.read_text().rstrip().endswith("}"))
            started += [subprocess.Popen(worker, stdout=log, stderr=log, env=environment) for _ in range(2)]
            yield json.loads(told.read_text())["address"], started[1:]
        finally:
            for process in reversed(started):
                process.kill()
                process.wait()


def test_a_worker_killed_midway_takes_nothing_with_it(
    cluster: Any, recordings: Path, quick_file: str, tmp_path: Path, content: Callable[[str], dict[str, bytes]]
) -> None:
    address, workers = cluster
    place, here = tmp_path / "far", str(tmp_path / "near")
    text = json.dumps({"reversal": "multi_map", **json.loads(Path(quick_file).read_text())})
    (tmp_path / "two.yaml").write_text(text)
    configs = [quick_file, str(tmp_path / "two.yaml")]
    command = [sys.executable, "-m", "mapgraft", "corpus", str(recordings), "-o", str(place), "--json"]
    command += ["--executor", f"dask:{address}", *(word for config in configs for word in ("--config", config))]
    with distributed.Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=PATIENCE_S)
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        waited_for("the first run", lambda: bool(list(place.glob("runs/*/*.parquet"))) or running.poll() is not None)
        os.kill(workers[0].pid, signal.SIGKILL)
        out, err = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 0, err
    told = json.loads(out)
    assert len(told["done"]) + len(told["kept"]) == 6 and not told["failed"]  # what it did, and had not said, is there
    with executor_of("threads", 1) as executor:
        run_corpus(read_plan(str(recordings), configs), here, executor)
    assert content(str(place)) == content(here)
    assert len(Dataset(str(place)).runs()) == 6


def test_where_there_is_no_scheduler_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapgraft.corpus.executors._CONNECTING_S", 1)
    said = pytest.raises(UsageError, match="there is no Dask scheduler at 'tcp://127")
    with said, executor_of("dask:tcp://127.0.0.1:1"):
        pass

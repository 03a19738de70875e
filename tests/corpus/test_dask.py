"""A Dask cluster of two worker processes, one of which is killed midway: the data set is complete and equal."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

import pytest

from mapgraft.corpus import Dataset, executor_of, read_plan, run_corpus
from mapgraft.corpus.cluster import SchedulerGoneError
from mapgraft.errors import UsageError

distributed = pytest.importorskip("distributed", reason="needs the extra dask")
PATIENCE_S = 240.0
ENVIRONMENT = os.environ | {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "20s"}


def waited_for(said: str, enough: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not enough():
        if time.monotonic() > deadline:
            pytest.fail(f"{said} did not happen")
        time.sleep(0.05)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler's address, and the scheduler and two workers without nannies: nobody starts them again."""
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    worker += ["--local-directory", str(tmp_path), "--death-timeout", "120"]
    with (tmp_path / "log").open("wb") as log:
        address, scheduler = scheduling(tmp_path / "scheduler.json", 0)
        started = [scheduler]
        try:
            started += [subprocess.Popen([*worker, address], stdout=log, stderr=log, env=ENVIRONMENT) for _ in range(2)]
            yield address, started
        finally:
            for process in reversed(started):
                process.kill()
                process.wait()


def scheduling(told: Path, port: int) -> tuple[str, subprocess.Popen[bytes]]:
    """A scheduler's address and process, on a free port where 0 is given."""
    server = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port)]
    server += ["--scheduler-file", str(told), "--no-dashboard"]
    with told.with_suffix(".log").open("wb") as log:
        started = subprocess.Popen(server, stdout=log, stderr=log, env=ENVIRONMENT)
    try:
        waited_for("the scheduler's start", lambda: told.is_file() and told.read_text().rstrip().endswith("}"))
    except BaseException:
        started.kill()
        raise
    return json.loads(told.read_text())["address"], started


def test_a_worker_killed_midway_takes_nothing_with_it(
    cluster: Any, recordings: Path, quick_file: str, tmp_path: Path, content: Callable[[str], dict[str, bytes]]
) -> None:
    address, (_, first, _) = cluster
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
        first.kill()
        out, err = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 0, err
    told = json.loads(out)
    assert len(told["done"]) + len(told["kept"]) == 6 and not told["failed"]  # what it did, and had not said, is there
    with executor_of("threads", 1) as executor:
        run_corpus(read_plan(str(recordings), configs), here, executor)
    assert content(str(place)) == content(here)
    assert len(Dataset(str(place)).runs()) == 6


def test_when_the_scheduler_goes_away_every_call_comes_to_an_end(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapgraft.corpus.executors._CONNECTING_S", 5)  # so long Dask tries to find it again
    address, (scheduler, *_) = cluster
    with executor_of(f"dask:{address}") as executor:
        assert executor.submit(pow, 2, 3).result(PATIENCE_S) == 8
        with pytest.raises(ZeroDivisionError):
            executor.submit(divmod, 1, 0).result(PATIENCE_S)
        under_way = [executor.submit(time.sleep, 600) for _ in range(4)]
        scheduler.kill()
        under_way.append(executor.submit(time.sleep, 600))
        for future in under_way:
            with pytest.raises(SchedulerGoneError, match=f"the Dask scheduler at {address} is gone"):
                future.result(PATIENCE_S)
        with pytest.raises(SchedulerGoneError):
            executor.submit(pow, 2, 3)


def test_when_the_scheduler_is_there_again_what_was_under_way_can_be_tried_again(cluster: Any, tmp_path: Path) -> None:
    address, (scheduler, *_) = cluster
    with executor_of(f"dask:{address}") as executor:
        under_way = [executor.submit(time.sleep, 600) for _ in range(2)]
        scheduler.kill()
        scheduler.wait()
        _, again = scheduling(tmp_path / "again.json", int(address.rpartition(":")[2]))
        try:
            for future in under_way:
                with pytest.raises(CancelledError):
                    future.result(PATIENCE_S)
            assert not executor.submit(time.sleep, 600).done()
            executor.shutdown(wait=False)
        finally:
            again.kill()
            again.wait()


def test_where_there_is_no_scheduler_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapgraft.corpus.executors._CONNECTING_S", 1)
    said = pytest.raises(UsageError, match="there is no Dask scheduler at 'tcp://127")
    with said, executor_of("dask:tcp://127.0.0.1:1"):
        pass

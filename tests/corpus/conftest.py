"""Small missions, and a server that speaks S3."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from mapgraft.corpus.dataset import TABLES
from mapgraft.corpus.stores import open_store
from mapgraft.recording.writing import convert
from mapgraft_recordings.buildings.building import building
from mapgraft_recordings.buildings.carmen import write_carmen
from mapgraft_recordings.buildings.driving import record

QUICK = {"map": {"type": "occupancy_grid", "resolution_m": 0.25}, "exchange": {"use": "every", "seconds": 200.0}}
NAMES = ("attic", "cellar", "hall")


@pytest.fixture(scope="session")
def quick() -> Mapping[str, Any]:
    """A configuration with which a mission takes a second or two."""
    return QUICK


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of three missions, each two drives through one building in one MCAP file."""
    folder, logs = tmp_path_factory.mktemp("recordings"), tmp_path_factory.mktemp("logs")
    house = building(1)
    for number, name in enumerate(NAMES):
        drives = []
        for drive in (2 * number, 2 * number + 1):
            drives.append(logs / f"{'ab'[drive % 2]}{number}.log.gz")
            write_carmen(drives[-1], record(house, drive, 40), drive)
        convert(drives, folder / f"{name}.mcap")
    return folder


@pytest.fixture(scope="session")
def quick_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("configs") / "quick.yaml"
    path.write_text(json.dumps(QUICK))
    return str(path)


@pytest.fixture(scope="session")
def content() -> Callable[[str], dict[str, bytes]]:
    """The bytes of everything that a data set holds, by name, but for what knows a wall clock."""

    def of(place: str) -> dict[str, bytes]:
        store = open_store(place)
        filesystem, root = store.arrow()
        names = [name for table in (*TABLES, "runs") if table != "timings" for name in store.names(table)]
        return {name: filesystem.open_input_file(f"{root}/{name}").read() for name in names}

    return of


@pytest.fixture(scope="session")
def s3() -> Iterator[Any]:
    """The file system of a server of this test, which processes that are started meanwhile find in the environment."""
    moto = pytest.importorskip("moto.server", reason="needs moto, a server that speaks S3")
    s3fs = pytest.importorskip("s3fs")
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    _, port = server.get_host_and_port()
    keys = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_DEFAULT_REGION": "us-east-1"}
    environment = keys | {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}", "AWS_EC2_METADATA_DISABLED": "true"}
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    s3fs.S3FileSystem.clear_instance_cache()
    try:
        yield s3fs.S3FileSystem()
    finally:
        server.stop()
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value

"""Folders with toy examples, and the annotation server: in this process on loopback, or as the command itself."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPMessage
from pathlib import Path
from urllib.parse import urlencode

import pytest
import uvicorn
from toy_examples import write_toys

from mapgraft.annotate.app import application
from mapgraft.annotate.desk import Desk
from mapgraft.annotate.opened import open_folders
from mapgraft.annotate.security import new_token
from mapgraft.annotate.serving import address_of, doors_of, listen, server_of

Fields = Mapping[str, object]


@dataclass(frozen=True, slots=True)
class Answered:
    """What a server answered."""

    status: int
    headers: HTTPMessage
    body: bytes

    @property
    def text(self) -> str:
        return self.body.decode()

    @property
    def n(self) -> int | None:
        """The example that is shown, None where there is none."""
        found = re.search(r'data-n="(\d+)"', self.text)
        return None if found is None else int(found[1])


@dataclass(frozen=True, slots=True)
class Client:
    """A browser of one annotator, as far as a server can tell."""

    port: int
    token: str
    name: str | None = "anna"

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def ask(self, method: str, target: str, headers: Mapping[str, str | None], body: bytes | None = None) -> Answered:
        """A request as it is, with nothing put right; a header that is None is left out."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.putrequest(method, target, skip_host=True, skip_accept_encoding=True)
            for name, value in {"Host": f"127.0.0.1:{self.port}", **headers}.items():
                if value is not None:
                    connection.putheader(name, value)
            connection.endheaders(body)
            answer = connection.getresponse()
            return Answered(answer.status, answer.headers, answer.read())
        finally:
            connection.close()

    def get(self, path: str = "", **headers: str | None) -> Answered:
        return self.ask("GET", f"/{self.token}/{path}", {**self._cookie(), **_named(headers)})

    def post(self, path: str, fields: Fields | None = None, **headers: str | None) -> Answered:
        body = urlencode(fields or {}).encode()
        own: dict[str, str | None] = {
            "Origin": self.origin,
            "HX-Request": "true",
            "Content-Type": "application/x-www-form-urlencoded",
            "Content-Length": str(len(body)),
        }
        return self.ask("POST", f"/{self.token}/{path}", {**self._cookie(), **own, **_named(headers)}, body)

    def label(self, n: int | None, said: str, **fields: object) -> Answered:
        return self.post(f"label/{n}", {"label": said, **fields})

    def _cookie(self) -> dict[str, str | None]:
        return {} if self.name is None else {"Cookie": f"annotator={self.name}"}


@pytest.fixture(scope="session")
def sixty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with sixty examples of which nobody knows the truth; not to be written to."""
    out = tmp_path_factory.mktemp("sixty") / "out"
    write_toys(out, 60, truth=False)
    return out


@pytest.fixture
def out(sixty: Path, tmp_path: Path) -> Path:
    """The same, to be written to."""
    import shutil

    shutil.copytree(sixty, tmp_path / "out")
    return tmp_path / "out"


@contextmanager
def serving() -> Iterator[Callable[..., Client]]:
    running: list[tuple[uvicorn.Server, threading.Thread]] = []

    def start(*folders: Path, name: str | None = None) -> Client:
        listening, token = listen("127.0.0.1", 0), new_token()
        app = application(Desk(open_folders(folders)), token, doors_of("127.0.0.1", listening), name)
        server = server_of(app)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        running.append((server, thread))
        assert address_of(listening, token).endswith(f"/{token}/")
        return Client(listening.getsockname()[1], token)

    try:
        yield start
    finally:
        for server, thread in running:
            server.should_exit = True
            thread.join(30)


@pytest.fixture
def serve() -> Iterator[Callable[..., Client]]:
    """Serves folders on loopback until the test ends."""
    with serving() as start:
        yield start


@pytest.fixture(scope="session")
def client(sixty: Path) -> Iterator[Client]:
    """A server of the sixty examples, for tests that write nothing."""
    with serving() as start:
        yield start(sixty)


@dataclass(frozen=True, slots=True)
class Command:
    """``mapgraft annotate`` in a process of its own."""

    process: subprocess.Popen[str]
    client: Client

    def end(self, number: int = signal.SIGINT) -> tuple[int, str, str]:
        """Exit code, the rest of stdout, and stderr."""
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=120)
        return self.process.returncode, out, err


@pytest.fixture
def command() -> Iterator[Callable[..., Command]]:
    """Starts the command, and waits until it has said where it is."""
    started: list[subprocess.Popen[str]] = []

    def start(*arguments: object, name: str = "anna") -> Command:
        line = [sys.executable, "-m", "mapgraft", "annotate", *map(str, arguments), "--no-browser"]
        pipe = subprocess.PIPE
        process = subprocess.Popen(line, stdout=pipe, stderr=pipe, text=True, env={**os.environ, "COLUMNS": "40"})
        started.append(process)
        assert process.stdout is not None
        address = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/([\w-]{43})/\n", process.stdout.readline())
        assert address is not None, process.communicate(timeout=60)
        return Command(process, Client(int(address[1]), address[2], name))

    yield start
    for process in started:
        process.kill()
        process.communicate()


def _named(headers: Mapping[str, str | None]) -> dict[str, str | None]:
    """Headers from keyword arguments: ``sec_fetch_site`` is Sec-Fetch-Site."""
    return {name.replace("_", "-").title().replace("Hx-", "HX-"): value for name, value in headers.items()}

"""A real browser, and the server: in a thread, or as ``mapgraft annotate`` starts it."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from toy_examples import write_toys

from mapgraft.annotate.app import application
from mapgraft.annotate.desk import Desk
from mapgraft.annotate.opened import open_folders
from mapgraft.annotate.security import new_token
from mapgraft.annotate.serving import address_of, doors_of, listen, server_of

NAMES = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
]
EXAMPLES = 160


class Server:
    """The server in a thread of the tests."""

    def __init__(self, *folders: Path) -> None:
        listening, token = listen("127.0.0.1", 0), new_token()
        self.address = address_of(listening, token)
        self._server = server_of(application(Desk(open_folders(folders)), token, doors_of("127.0.0.1", listening)))
        self._thread = threading.Thread(target=self._server.run, kwargs={"sockets": [listening]}, daemon=True)
        self._thread.start()

    def end(self) -> None:
        self._server.should_exit = True
        self._thread.join(30)


class Command:
    """``mapgraft annotate`` in a process of its own, as a person starts it."""

    def __init__(self, *folders: Path) -> None:
        self._folders = folders
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-m", "mapgraft", "annotate", *map(str, self._folders), "--no-browser"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert self._process.stdout is not None
        found = next(filter(None, map(re.compile(r"http://\S+/").search, self._process.stdout)), None)
        if found is None:
            raise RuntimeError(f"{' '.join(command)} printed no address")
        self.address = found.group()

    def end(self, how: signal.Signals = signal.SIGTERM) -> None:
        if self._process.poll() is None:
            self._process.send_signal(how)
        self._process.wait(30)
        assert self._process.stdout is not None
        self._process.stdout.close()


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """A headless Chromium, driven by Playwright; skips where there is none, but not in CI, where one is installed."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install 'mapgraft[test]'")
    with sync_api.sync_playwright() as playwright:
        path = _installed() or playwright.chromium.executable_path
        if not Path(path).is_file():
            sentence = "needs a browser: apt-get install chromium, or its path in MAPGRAFT_CHROMIUM"
            if os.environ.get("CI", "").lower() in ("1", "true", "yes"):
                pytest.fail(f"{sentence}; in CI these tests are not skipped")
            pytest.skip(sentence)
        browser = playwright.chromium.launch(executable_path=path, args=OPTIONS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def examples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of examples that all tests share; each answers under a name of its own."""
    folder = tmp_path_factory.mktemp("shared")
    write_toys(folder, EXAMPLES)
    return folder


@pytest.fixture(scope="session")
def server(chromium: Any, examples: Path) -> Iterator[Server]:
    """A server on the shared folder."""
    running = Server(examples)
    yield running
    running.end()


@pytest.fixture
def start(chromium: Any) -> Iterator[Callable[..., Server]]:
    """Starts servers of a test's own, which end with the test."""
    running: list[Server] = []

    def begin(*folders: Path) -> Server:
        running.append(Server(*folders))
        return running[-1]

    yield begin
    for one in running:
        one.end()


@pytest.fixture
def command(chromium: Any) -> Iterator[Callable[..., Command]]:
    """Starts the command itself, which may be killed and started again."""
    running: list[Command] = []

    def begin(*folders: Path) -> Command:
        running.append(Command(*folders))
        return running[-1]

    yield begin
    for one in running:
        one.end()


@pytest.fixture
def visit(chromium: Any, request: pytest.FixtureRequest) -> Iterator[Callable[..., Any]]:
    """Opens a server's page under a name, in a browser profile of its own; the maps are on the page when it returns.

    What the browser complains of (scripts that fail, what the content security policy forbids) fails the test, unless
    the test takes it out of ``page.complaints``.
    """
    contexts: list[Any] = []
    complaints: list[str] = []

    def open_page(server: Server | Command, name: str = request.node.name[:60], **options: Any) -> Any:
        context = chromium.new_context(**{"viewport": {"width": 1280, "height": 800}, **options})
        context.set_default_timeout(20_000)
        contexts.append(context)
        page = context.new_page()
        page.complaints = complaints
        page.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(f"{server.address}?name={name}")
        page.wait_for_selector("#stage[data-shown]")
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not complaints


def _installed() -> str | None:
    return os.environ.get("MAPGRAFT_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)

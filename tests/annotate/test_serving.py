"""The command itself: started, ended, killed between answers, and what it says."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from mapgraft.annotate.desk import Desk
from mapgraft.annotate.opened import open_folders
from mapgraft.annotate.serving import browsing, is_local, listen
from mapgraft.cli import invoke
from mapgraft.examples import ExampleFolder


def said(out: Path) -> dict[tuple[str, str], str]:
    """Example and annotator → the last word."""
    return {(key.example_id, by): word.label for (key, by), word in ExampleFolder(out).labels().items()}


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Exit code and stderr of a command line that serves nothing."""

    def ask(*arguments: object) -> tuple[int, str]:
        code = invoke(["annotate", "--no-browser", *map(str, arguments)])
        told = capsys.readouterr()
        assert not told.out
        return code, told.err

    return ask


def test_killed_between_answers_nothing_is_lost_and_it_goes_on(command: Callable, out: Path):
    """A server is killed after every few answers; the next one knows all that was answered, and shows what was next."""
    folder, given, following = ExampleFolder(out), dict[int, str](), None
    for _ in range(3):
        started = command(out)
        n = started.client.get().n
        assert following in (None, n)
        for answer in ("right", "wrong", "unsure"):
            assert n is not None and n not in given
            found = started.client.label(n, answer)
            assert found.status == 200
            given[n], n = answer, found.n
        following = n
        started.process.send_signal(signal.SIGKILL)
        started.process.communicate(timeout=60)
        assert said(out) == {(folder.keys[n].example_id, "anna"): answer for n, answer in given.items()}
    assert len(given) == 9


def test_words_that_cannot_be_read_are_named_at_the_start(command: Callable, out: Path):
    damaged = out / "labels" / f"run_id={ExampleFolder(out).keys[0].run_id}" / "part-00000-cut.parquet"
    damaged.parent.mkdir(parents=True)
    damaged.write_bytes(b"PAR1")
    started = command(out)
    assert started.client.get().status == 200
    code, _, err = started.end()
    assert code == 0 and err.count(f"{damaged} cannot be read") == 1


def test_killed_in_the_middle_of_answers(command: Callable, out: Path):
    """Whatever the moment: what was answered with success is there, and nothing that nobody said."""
    import threading

    started = command(out)
    confirmed: list[tuple[int, str]] = []

    def work() -> None:
        try:
            n = started.client.get().n
            while n is not None:
                answer = ("right", "wrong", "unsure")[n % 3]
                found = started.client.label(n, answer)
                if found.status == 200:
                    confirmed.append((n, answer))
                n = found.n
        except OSError:
            return

    thread = threading.Thread(target=work)
    thread.start()
    while len(confirmed) < 5 and thread.is_alive():
        thread.join(0.001)
    started.process.send_signal(signal.SIGKILL)
    started.process.communicate(timeout=60)
    thread.join(60)
    folder, found = ExampleFolder(out), said(out)
    numbers = {key.example_id: n for n, key in enumerate(folder.keys)}
    assert {(folder.keys[n].example_id, "anna"): answer for n, answer in confirmed}.items() <= found.items()
    assert len(found) <= len(confirmed) + 1
    assert all(answer == ("right", "wrong", "unsure")[numbers[example] % 3] for (example, _), answer in found.items())
    assert Desk(open_folders([out])).next("anna") not in {numbers[example] for example, _ in found}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_ends_it_in_a_sentence(command: Callable, out: Path, number: int):
    """The token is told once, and no line tells what was asked."""
    started = command(out)
    assert started.client.label(started.client.get().n, "right").status == 200
    started.client.get("nothing")
    started.client.ask("GET", "/wrong/", {})
    code, rest, err = started.end(number)
    assert code == 0, err
    assert rest.startswith("1 answer was written down") and "60 to judge" in err
    assert "encrypted" not in err
    for never in ("Traceback", "GET", started.client.token):
        assert never not in rest + err
    assert len(said(out)) == 1


def test_a_port_in_use_has_a_sentence(refused: Callable, out: Path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        sentence = f"mapgraft: port {port} is in use: leave --port out, and a free one is taken\n"
        assert refused(out, "--port", port) == (2, sentence)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--host", "192.0.2.1"], "is no address of this machine"),
        (["--host", "no such host"], "is no address of this machine"),
        (["--name", " "], "--name ' ' will not do: a name has between 1 and 64 characters"),
        (["--port", "70000"], "65535"),
    ],
)
def test_wrong_options_have_a_sentence(refused: Callable, out: Path, arguments: list[str], sentence: str):
    code, err = refused(out, *arguments)
    assert code == 2 and sentence in err and err.count("\n") == 1


def test_folders_without_examples_have_a_sentence(refused: Callable, tmp_path: Path, out: Path):
    for path, sentence in ((tmp_path, "has no examples"), (tmp_path / "nowhere", "is no folder")):
        code, err = refused(out, path)
        assert code == 2 and str(path) in err and sentence in err and err.count("\n") == 1


def test_without_the_extra_there_is_a_sentence(out: Path):
    """As on a machine where FastAPI is not installed."""
    code = "import importlib.util as u; found = u.find_spec\n"
    code += "u.find_spec = lambda name, of=None: None if name in ('fastapi', 'uvicorn') else found(name, of)\n"
    code += "import sys; from mapgraft.cli import invoke; sys.exit(invoke(sys.argv[1:]))"
    line = [sys.executable, "-c", code, "annotate", str(out)]
    ended = subprocess.run(line, capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 2
    assert ended.stderr == "mapgraft: annotate needs fastapi and uvicorn: pip install 'mapgraft[annotate]'\n"


def test_help_needs_no_extra():
    code = (
        "import sys; from mapgraft.cli import invoke; invoke(['annotate', '--help']); print('uvicorn' in sys.modules)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert ended.stdout.endswith("False\n")


def test_listening_for_others_warns(command: Callable, out: Path):
    started = command(out, "--host", "0.0.0.0")
    assert started.client.get().status == 200
    assert started.client.get(host="attacker.example").status == 421
    _, _, err = started.end()
    assert "nothing is encrypted" in err


def test_sockets_say_that_they_are_tcp():
    """Else asyncio leaves Nagle's algorithm on, and every answer comes 40 ms late."""
    with listen("127.0.0.1", 0) as listening:
        assert listening.proto == socket.IPPROTO_TCP
        assert listening.getsockname()[0] == "127.0.0.1" and is_local(listening)


def test_the_browser_is_given_a_file_that_only_this_user_reads(monkeypatch: pytest.MonkeyPatch):
    """A program's arguments are seen by everybody on the machine; the token is not among them."""
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    monkeypatch.setenv("DISPLAY", ":0")
    address = "http://127.0.0.1:1/secret/"
    with browsing(address, wanted=True) as tried:
        assert tried
        (page,) = opened
        assert "secret" not in page
        path = Path(page.removeprefix("file://"))
        assert address in path.read_text()
        assert path.stat().st_mode & 0o77 == 0 and path.parent.stat().st_mode & 0o77 == 0
    assert not path.exists()
    with browsing(address, wanted=False) as tried:
        assert not tried


def test_where_there_is_no_screen_no_browser_is_looked_for(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("webbrowser.open", lambda address: pytest.fail("a browser was opened"))
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with browsing("http://127.0.0.1:1/secret/", wanted=True) as tried:
        assert not tried
    assert os.environ.get("DISPLAY") is None

"""``mapgraft annotate``: a page in the browser on which people say whether merges are right."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mapgraft.commands.unread import tell_unread
from mapgraft.console import cell, remarks, results
from mapgraft.errors import UsageError

if TYPE_CHECKING:
    from mapgraft.annotate.desk import Desk

NEEDED: Final = ("fastapi", "uvicorn")


@dataclass(frozen=True, slots=True)
class Asked:
    """Who annotates, if that is said beforehand, and where the page is to be reached; port 0 is any free one.

    ``tracebacks`` shows where internal errors come from.
    """

    name: str | None
    host: str
    port: int
    browser: bool
    tracebacks: bool = False


def annotate_and_wait(folders: Sequence[Path], asked: Asked) -> None:
    """Open folders, say where the page is, and serve it until Ctrl-C.

    Raises UsageError when the extra is not installed, when a folder holds no examples, when the name will not do, and
    when the port cannot be had.
    """
    missing = [module for module in NEEDED if find_spec(module) is None]
    if missing:
        raise UsageError(f"annotate needs {' and '.join(missing)}: pip install 'mapgraft[annotate]'")
    from mapgraft.annotate.app import application
    from mapgraft.annotate.desk import Desk, checked_name
    from mapgraft.annotate.opened import open_folders
    from mapgraft.annotate.security import new_token
    from mapgraft.annotate.serving import address_of, browsing, doors_of, is_local, listen, serve

    name = None if asked.name is None else _named(asked.name, checked_name)
    opened = open_folders(folders)
    tell_unread(folders)
    opened.tidy()
    desk = Desk(opened)
    listening = listen(asked.host, asked.port)
    token = new_token()
    app = application(desk, token, doors_of(asked.host, listening), name, partial(_tell_error, asked.tracebacks))
    address = address_of(listening, token)
    if not is_local(listening):
        _warn(asked.host)
    _tell(desk, address)
    with browsing(address, asked.browser):
        serve(app, listening)
    opened.tidy()
    results().print(
        cell(f"{_answers(desk.given)} written down; the same command goes on where this one stopped"), soft_wrap=True
    )


def _named(name: str, check: Callable[[str], str]) -> str:
    try:
        return check(name)
    except ValueError as error:
        raise UsageError(f"--name {name!r} will not do: {error}") from None


def _tell(desk: Desk, address: str) -> None:
    """What was opened goes beside the address, which is the one line on stdout until the end."""
    for count, why in desk.left_out:
        _remark(f"{count} left out: {why}")
    _remark(f"{len(desk)} to judge; every answer is saved at once. Ctrl-C ends. Open in a browser:")
    results().print(cell(address), soft_wrap=True)


def _tell_error(tracebacks: bool, error: Exception) -> None:
    _remark(f"internal error, {type(error).__name__}: {error}")
    if tracebacks:
        _remark("".join(traceback.format_exception(error)))


def _warn(host: str) -> None:
    _remark(
        f"--host {host}: other machines reach this page. Whoever has the address sees all maps and can answer, and "
        "whoever is on the way can read along, for nothing is encrypted. Better: leave --host out, and use 'ssh -L'."
    )


def _remark(sentence: str) -> None:
    remarks().print(cell(sentence), soft_wrap=True)


def _answers(count: int) -> str:
    return "no answer was" if count == 0 else "1 answer was" if count == 1 else f"{count} answers were"

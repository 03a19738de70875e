"""Listening: on which address, under which names, and until somebody presses Ctrl-C."""

from __future__ import annotations

import errno
import ipaddress
import os
import signal
import socket
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import uvicorn

from mapgraft.annotate.security import HEADER_BYTES, App, Doors
from mapgraft.errors import UsageError

LOOPBACK: Final = "127.0.0.1"
ENDING_S: Final = 5  # for answers that are being written down when the server ends
CONNECTIONS: Final = 128  # at once; a browser opens six


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens; port 0 is any free one. Raises UsageError when that cannot be had."""
    try:
        family, _, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except (OSError, UnicodeError):
        raise UsageError(f"--host {host!r} is no address of this machine: leave it out, or give one") from None
    listening = socket.socket(family, socket.SOCK_STREAM, protocol)  # named, or every answer waits 40 ms for Nagle
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # of connections that have ended
        listening.bind(address)
        listening.listen(CONNECTIONS)
    except OSError as error:
        listening.close()
        raise UsageError(_refused(host, port, error)) from None
    return listening


def doors_of(host: str, listening: socket.socket) -> Doors:
    """The names under which a browser may ask a server that listens there."""
    address, port = listening.getsockname()[:2]
    known = ipaddress.ip_address(address)
    named = f"[{known}]" if known.version == 6 else str(known)
    if known.is_loopback:
        return Doors(frozenset({named, "localhost"}), port)
    names = {host.lower(), named, "localhost"}
    if known.is_unspecified:
        names |= {LOOPBACK, socket.gethostname().lower()}
    return Doors(frozenset(names), port, addresses=known.is_unspecified)


def is_local(listening: socket.socket) -> bool:
    """Whether only this machine reaches it."""
    return ipaddress.ip_address(listening.getsockname()[0]).is_loopback


def address_of(listening: socket.socket, token: str) -> str:
    """What a person opens, on this machine; whoever has it may answer."""
    address, port = listening.getsockname()[:2]
    known = ipaddress.ip_address(address)
    if known.is_unspecified:
        known = ipaddress.ip_address(LOOPBACK if known.version == 4 else "::1")
    named = f"[{known}]" if known.version == 6 else str(known)
    return f"http://{named}:{port}/{token}/"


def server_of(app: App) -> uvicorn.Server:
    """The server, which logs nothing: addresses hold the token."""
    config = uvicorn.Config(
        app,
        http="h11",
        ws="none",
        lifespan="off",
        log_config=None,
        log_level="critical",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=HEADER_BYTES,
        limit_concurrency=CONNECTIONS,
        timeout_graceful_shutdown=ENDING_S,
    )
    return uvicorn.Server(config)


def serve(app: App, listening: socket.socket) -> None:
    """Answer requests until Ctrl-C, SIGTERM or SIGHUP; what is being written down then is written first."""
    server = server_of(app)
    with suppress(KeyboardInterrupt), _ended_by_hangup(server):
        server.run(sockets=[listening])


@contextmanager
def _ended_by_hangup(server: uvicorn.Server) -> Iterator[None]:
    """Closing the terminal ends the server as Ctrl-C does, which it knows to handle; under nohup it does not."""
    before = signal.getsignal(signal.SIGHUP)
    if before is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, server.handle_exit)
    try:
        yield
    finally:
        signal.signal(signal.SIGHUP, before)


@contextmanager
def browsing(address: str, wanted: bool) -> Iterator[bool]:
    """Show the page in the person's browser, where there is one; whether that was tried.

    The browser is given a file that only this user can read and that leads to the address: everybody on the machine can
    see what a program was started with.
    """
    shown = "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ or sys.platform == "darwin"
    if not (wanted and shown):
        yield False
        return
    with TemporaryDirectory(prefix="mapgraft-") as folder:  # readable for this user only
        page = Path(folder) / "annotate.html"
        target = escape(address, quote=True)
        page.write_text(
            f'<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer">'
            f'<meta http-equiv="refresh" content="0; url={target}"><title>mapgraft annotate</title>'
            f'<a href="{target}">mapgraft annotate</a>',
            encoding="utf-8",
        )
        page.chmod(0o600)
        yield webbrowser.open(page.as_uri())


def _refused(host: str, port: int, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"port {port} is in use: leave --port out, and a free one is taken"
    if error.errno == errno.EACCES:
        return f"port {port} may not be used by this user: leave --port out, or give one above 1023"
    return f"--host {host!r} is no address of this machine ({error.strerror}): leave it out, or give one"

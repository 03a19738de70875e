"""Who may ask the server anything: a browser of this machine that was given the address with its token.

Everything is decided here, before any route: routes see paths without the token, of requests that passed.
"""

from __future__ import annotations

import ipaddress
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from typing import Any, Final

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

TOKEN_BYTES: Final = 32
BODY_BYTES: Final = 32_768  # a form with the longest reason, escaped, has less
LONG: Final = f"an answer has at most {BODY_BYTES} bytes, and tells beforehand how many"
TARGET_BYTES: Final = 1_024  # path and query; a name of 64 characters, escaped, is the longest that is asked for
HEADER_BYTES: Final = 16_384
READING, WRITING = "GET", "POST"
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; font-src 'self'; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
HEADERS: Final = {
    "content-security-policy": POLICY,
    "cache-control": "no-store",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-embedder-policy": "require-corp",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
    "x-robots-tag": "noindex",
}
_RAW: Final = {name.encode(): value.encode() for name, value in HEADERS.items()}


def new_token() -> str:
    """A token that nobody guesses, of letters, digits, '-' and '_'."""
    return secrets.token_urlsafe(TOKEN_BYTES)


@dataclass(frozen=True, slots=True)
class Doors:
    """The names under which the server may be asked: ``hosts``, in lower case, without port.

    ``addresses`` says that any address in numbers will do, too: where the server listens on all of the machine's. A
    page of a stranger cannot pass for one of those, as it can for a name, by letting its own name lead here.
    """

    hosts: frozenset[str]
    port: int
    addresses: bool = False

    def admits(self, host: str) -> bool:
        """Whether a Host header names this server."""
        name, colon, port = host.lower().rpartition(":")
        if not colon or host.endswith("]"):
            name, port = host.lower(), "80"
        if port != str(self.port):
            return False
        return name in self.hosts or (self.addresses and _is_address(name))


class Guard:
    """An ASGI application that lets through to ``app`` what may be asked, and puts headers on every answer."""

    def __init__(self, app: App, token: str, doors: Doors) -> None:
        self._app, self._token, self._doors = app, token.encode(), doors

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # a WebSocket is not accepted by saying nothing
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                kept = [(name, value) for name, value in message.get("headers", ()) if name.lower() not in _RAW]
                message = {**message, "headers": [*kept, *_RAW.items()]}
            await send(message)

        refusal = self._refusal(scope)
        if refusal is not None:
            await _say(with_headers, *refusal)
            return
        path = _after_token(scope["path"]) if self._holds_token(scope["path"]) else scope["path"]
        await self._app({**scope, "path": path, "raw_path": path.encode()}, receive, with_headers)

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Why a request is not let through, as status and sentence."""
        if len(scope["path"]) + len(scope["query_string"]) > TARGET_BYTES:
            return 414, "the address is too long"
        if sum(len(name) + len(value) for name, value in scope["headers"]) > HEADER_BYTES:
            return 431, "the request is too long"
        headers = _Headers(scope["headers"])
        host, origin = headers.one("host"), headers.one("origin")
        if host is None or not self._doors.admits(host):
            return 421, "this server is not called that"
        own = f"http://{host}"
        if origin is not None and origin != own:
            return 403, "another page may not ask this server"
        if headers.one("sec-fetch-site") not in (None, "same-origin", "none") and not _is_visit(headers):
            return 403, "another page may not ask this server"
        if not (scope["path"].startswith("/static/") or self._holds_token(scope["path"])):
            return 404, "there is nothing here: open the whole address that mapgraft annotate printed"
        if headers.one("transfer-encoding") is not None:  # it would go before the length
            return 413, LONG
        if scope["method"] == READING:
            return None
        if scope["method"] != WRITING:
            return 405, "only GET and POST are answered"
        if origin != own or headers.one("hx-request") != "true":
            return 403, "an answer must come from the page itself"
        length = headers.one("content-length")
        if length is None or not length.isdecimal() or int(length) > BODY_BYTES:
            return 413, LONG
        return None

    def _holds_token(self, path: str) -> bool:
        given = path.removeprefix("/").partition("/")[0]
        return secrets.compare_digest(given.encode("utf-8", "surrogatepass"), self._token)


class _Headers:
    """The headers of a request; one that is there twice is as good as none that fits."""

    def __init__(self, raw: list[tuple[bytes, bytes]]) -> None:
        self._raw = raw

    def one(self, name: str) -> str | None:
        found = [value for key, value in self._raw if key == name.encode()]
        return None if not found else b"\n".join(found).decode("latin-1")


def _is_visit(headers: _Headers) -> bool:
    """Whether a tab of its own is to show what is asked for: somebody has followed a link that holds the token."""
    return headers.one("sec-fetch-mode") == "navigate" and headers.one("sec-fetch-dest") == "document"


def _after_token(path: str) -> str:
    return "/" + path.removeprefix("/").partition("/")[2]


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


async def _say(send: Send, status: int, sentence: str) -> None:
    body = (sentence + "\n").encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})

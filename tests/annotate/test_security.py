"""Who is let in: a browser of this machine that has the address, and nobody else."""

from __future__ import annotations

import asyncio
import json
import socket
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.annotate.app import application
from mapgraft.annotate.desk import Desk
from mapgraft.annotate.opened import open_folders
from mapgraft.annotate.security import BODY_BYTES, HEADERS, Doors, new_token
from mapgraft.annotate.serving import doors_of, is_local, listen
from mapgraft.outputs.label_parts import LabelParts

READ = ("", "next", "example/0", "picture/0/own.png", "progress")
ANSWER = {"label": "right", "reason": "", "moved": "0", "elapsed_s": "1.5"}


def words(out: Path) -> int:
    return sum(len(rows) for _, rows in LabelParts(out).new())


def test_the_page_with_its_token_is_answered(client: Any):
    for path in READ:
        assert client.get(path).status == 200


@pytest.mark.parametrize("path", [*READ, "static/annotate.css", "..", "label/0"])
def test_without_the_right_token_there_is_nothing(client: Any, path: str):
    wrong = [new_token(), client.token[:-1], client.token + "x", client.token.swapcase(), "%00", "", "é" * 43]
    for token in wrong:
        found = client.ask("GET", f"/{token}/{path}".encode("ascii", "ignore").decode(), {})
        assert found.status == 404, token
        assert "alpha" not in found.text
    assert client.ask("GET", f"//{client.token}/{path}", {}).status == 404


def test_an_answer_with_a_wrong_token_is_not_written(client: Any, sixty: Path):
    other = type(client)(client.port, new_token(), "anna")
    assert other.label(0, "right").status == 404
    assert words(sixty) == 0


@pytest.mark.parametrize(
    "host",
    [
        *(
            "attacker.example",
            "attacker.example:{port}",
            "127.0.0.1",
            "127.0.0.1:1",
            "localhost",
            "127.0.0.1:{port}.",
            "",
        ),
        *(
            "127.0.0.1.attacker.example:{port}",
            "[::1]:{port}",
            "0.0.0.0:{port}",
            "127.1:{port}",
            "user@127.0.0.1:{port}",
        ),
    ],
)
def test_a_name_that_leads_here_by_rebinding_is_refused(client: Any, sixty: Path, host: str):
    named = host.format(port=client.port)
    assert client.get("", host=named).status == 421
    assert client.post("label/0", ANSWER, host=named, origin=f"http://{named}").status == 421
    assert words(sixty) == 0


def test_this_machine_has_two_names(client: Any):
    for host in ("127.0.0.1", "localhost", "LocalHost"):
        assert client.get("", host=f"{host}:{client.port}").status == 200


def test_a_request_names_its_host_once(client: Any):
    for hosts in ("", f"Host: 127.0.0.1:{client.port}\r\nHost: attacker.example\r\n"):
        with socket.create_connection(("127.0.0.1", client.port), 30) as raw:
            raw.sendall(f"GET /{client.token}/ HTTP/1.1\r\n{hosts}Connection: close\r\n\r\n".encode())
            status = int(raw.makefile("rb").readline().split()[1])
        assert status in (400, 421)


@pytest.mark.parametrize(
    "origin",
    [
        "https://attacker.example",
        "null",
        "http://127.0.0.1",
        "http://localhost:{port}",
        "https://127.0.0.1:{port}",
        "",
        None,
    ],
)
def test_another_origin_cannot_answer(client: Any, sixty: Path, origin: str | None):
    asked = None if origin is None else origin.format(port=client.port)
    for path in ("label/0", "undo", "skip/0"):
        assert client.post(path, ANSWER, origin=asked).status == 403
    assert words(sixty) == 0


def test_another_origin_cannot_look(client: Any):
    for path in READ:
        assert client.get(path, origin="https://attacker.example").status == 403
        assert (
            client.get(path, sec_fetch_site="cross-site", sec_fetch_mode="no-cors", sec_fetch_dest="image").status
            == 403
        )
        assert client.get(path, sec_fetch_site="same-site").status == 403
        assert client.get(path, sec_fetch_site="same-origin").status == 200
    visit = {"sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate"}
    assert client.get("", **visit, sec_fetch_dest="document").status == 200  # somebody has followed the link
    assert client.get("", **visit, sec_fetch_dest="iframe").status == 403


def test_a_form_on_another_page_cannot_answer(serve: Callable, out: Path):
    """A form cannot set the header, whatever else it manages; nor can it be sent as another type."""
    client = serve(out)
    assert client.post("label/0", ANSWER, hx_request=None).status == 403
    assert client.post("label/0", ANSWER, hx_request="1").status == 403
    for kind in ("text/plain", "multipart/form-data; boundary=x", "application/json", ""):
        assert client.post("label/0", ANSWER, content_type=kind).status == 415
    assert words(out) == 0
    assert client.post("label/0", ANSWER).status == 200
    assert words(out) == 1


def test_nothing_is_shared_with_other_origins(client: Any):
    asked = {"origin": "https://attacker.example", "access_control_request_method": "POST"}
    found = client.ask("OPTIONS", f"/{client.token}/label/0", {"Origin": asked["origin"]})
    assert found.status == 403
    for path in READ:
        assert not [name for name in client.get(path).headers if name.lower().startswith("access-control")]


@pytest.mark.parametrize("method", ["HEAD", "OPTIONS", "PUT", "DELETE", "PATCH", "TRACE", "CONNECT", "BREW"])
def test_only_get_and_post(client: Any, method: str):
    assert client.ask(method, f"/{client.token}/label/0", {}).status in (400, 405)


def test_looking_writes_nothing_and_answers_are_no_links(client: Any, sixty: Path):
    for path in ("label/0?label=right", "undo", "skip/0"):
        assert client.get(path).status == 405
    assert words(sixty) == 0


def test_every_answer_has_the_headers(client: Any):
    found = [client.get(path) for path in (*READ, "nothing", "picture/999/own.png")]
    found += [client.ask("GET", "/", {}), client.get("", host="attacker.example"), client.label(0, "nonsense")]
    found += [client.ask("GET", "/static/nothing.js", {}), client.ask("GET", "/static/htmx.min.js", {})]
    for answered in found:
        for name, value in HEADERS.items():
            assert answered.headers.get_all(name) == [value]
        assert answered.headers["server"] is None


def test_the_policy_lets_nothing_in_from_elsewhere():
    policy = dict(part.strip().partition(" ")[::2] for part in HEADERS["content-security-policy"].split(";"))
    assert policy["default-src"] == policy["frame-ancestors"] == policy["base-uri"] == "'none'"
    assert {source for sources in policy.values() for source in sources.split()} <= {"'none'", "'self'", "blob:"}
    assert policy["script-src"] == policy["style-src"] == "'self'"


@pytest.mark.parametrize(
    "target",
    [
        *(
            "/static/../app.py",
            "/static/..%2fapp.py",
            "/static/%2e%2e/app.py",
            "/static/..%5capp.py",
            "/static//etc/passwd",
        ),
        *("/static/%2fetc%2fpasswd", "/static/.", "/static/..", "/static/", "/static", "/static/annotate.css%00.txt"),
        *(
            "/{token}/picture/../../../../etc/passwd",
            "/{token}/picture/0/../0/own.png",
            "/{token}/picture/0/overlay.png",
        ),
        *(
            "/{token}/picture/0/..%2f..%2fetc%2fpasswd.png",
            "/{token}/picture/-1/own.png",
            "/{token}/picture/60/own.png",
        ),
        *("/{token}/picture/0.0/own.png", "/{token}/picture/%30%2e/own.png", "/{token}/example/999999999999999999999"),
        *(
            "/{token}/example/..",
            "/{token}/example/alpha.beta.1",
            "/{token}/revealed/../example/0",
            "/{token}/static/../x",
        ),
        *(
            "/../{token}/",
            "/./{token}/",
            "/{token}/../{token}/",
            "/{token}/%2e%2e/",
            "/{token}/examples/run_id=x/part.parquet",
        ),
        *("/docs", "/{token}/docs", "/openapi.json", "/{token}/openapi.json", "/{token}/redoc", "/favicon.ico"),
    ],
)
def test_no_path_of_a_request_leads_anywhere(client: Any, target: str):
    found = client.ask("GET", target.format(token=client.token), {"Cookie": "annotator=anna"})
    assert found.status in (404, 422)
    assert b"root:" not in found.body and b"import" not in found.body
    assert target not in found.text or target == "/docs"


def test_requests_have_a_size(serve: Callable, out: Path):
    client = serve(out)
    assert client.get("?name=" + "a" * 2_000).status == 414
    long = {**ANSWER, "reason": "x" * BODY_BYTES}
    assert client.post("label/0", long).status == 413
    assert client.post("label/0", ANSWER, content_length=None, transfer_encoding="chunked").status == 413
    assert client.post("label/0", {**ANSWER, "reason": "x" * 2_001}).status == 422
    assert client.post("label/0", {f"field {n}": n for n in range(40)}).status == 422
    assert client.get("", cookie="annotator=" + "a" * 20_000).status in (400, 431)
    assert words(out) == 0
    assert client.post("label/0", {**ANSWER, "reason": "\N{PILE OF POO}" * 2_000}).status == 200


@pytest.mark.parametrize("coding", ["chunked", "Chunked", "identity", "gzip, chunked"])
@pytest.mark.parametrize("asked", ["POST /{}/label/0", "POST /{}/undo", "POST /{}/skip/0", "GET /{}/"])
def test_a_length_that_another_header_overrules_is_refused(client: Any, sixty: Path, asked: str, coding: str):
    """Of the two, ``Transfer-Encoding`` counts: what comes may have any length."""
    target = asked.format(client.token)
    lines = [f"{target} HTTP/1.1", f"Host: 127.0.0.1:{client.port}", f"Origin: {client.origin}", "HX-Request: true"]
    lines += ["Content-Type: application/x-www-form-urlencoded", "Cookie: annotator=anna", "Content-Length: 20"]
    lines += [f"Transfer-Encoding: {coding}", "", ""]
    with socket.create_connection(("127.0.0.1", client.port), 30) as raw:
        raw.sendall("\r\n".join(lines).encode() + b"b\r\nlabel=right\r\n")
        status = int(raw.makefile("rb").readline().split()[1])
    assert status == (413 if coding.lower() == "chunked" else 400)
    assert words(sixty) == 0


def test_no_more_of_an_answer_is_taken_than_it_may_have(sixty: Path):
    """Whatever length was said, and whoever passes it on."""
    token = new_token()
    app = application(Desk(open_folders([sixty])), token, Doors(frozenset({"localhost"}), 80), "anna")
    headers = {"host": "localhost", "origin": "http://localhost", "hx-request": "true", "content-length": "20"}
    headers["content-type"] = "application/x-www-form-urlencoded"
    path = f"/{token}/label/0"
    scope = {"type": "http", "method": "POST", "path": path, "raw_path": path.encode(), "query_string": b""}
    scope |= {"headers": [(name.encode(), value.encode()) for name, value in headers.items()]}
    taken, sent = list[int](), list[Any]()

    async def receive() -> dict[str, Any]:
        taken.append(1_000)
        return {"type": "http.request", "body": b"a" * 1_000, "more_body": True}

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(app(scope, receive, send))
    assert sent[0]["status"] == 413
    assert BODY_BYTES < sum(taken) <= BODY_BYTES + 1_000
    assert words(sixty) == 0


@pytest.mark.parametrize(
    "fields",
    [
        *({}, {"label": ""}, {"label": "withdrawn"}, {"label": "Right"}, {"label": "right", "moved": "2"}),
        *({"label": "right", "moved": "1"}, {"label": "right", "moved": "1", "x_m": "nan", "y_m": "0", "yaw_rad": "0"}),
        {"label": "right", "moved": "1", "x_m": "1e300", "y_m": "0", "yaw_rad": "0"},
        {"label": "right", "moved": "1", "x_m": "1", "y_m": "inf", "yaw_rad": "0"},
    ],
)
def test_what_is_no_answer_is_not_written(client: Any, sixty: Path, fields: dict[str, str]):
    found = client.post("label/0", fields)
    assert found.status == 422
    assert found.headers["content-type"].startswith("text/plain")
    assert words(sixty) == 0


@pytest.mark.parametrize(
    "name", ["", " ", "a" * 65, "\x07bell", "turned \N{RIGHT-TO-LEFT OVERRIDE}round", "line\nbreak"]
)
def test_names_that_will_not_do(client: Any, sixty: Path, name: str):
    from urllib.parse import quote

    if name != "line\nbreak":  # which becomes a space
        assert client.get(f"?name={quote(name)}").status == 422
    strange = type(client)(client.port, client.token, quote(name))
    if name != "line\nbreak":
        assert strange.label(0, "right").status == 403
        assert words(sixty) == 0


def test_the_name_is_kept_for_this_address_only(client: Any):
    found = type(client)(client.port, client.token, None).get("?name=%20Zo%C3%AB%20%20Q%20")
    assert found.status == 303
    assert found.headers["location"] == f"/{client.token}/"
    cookie = found.headers["set-cookie"]
    assert cookie.startswith("annotator=Zo%C3%AB%20Q;")
    for part in (f"Path=/{client.token}/", "SameSite=strict", "HttpOnly"):
        assert part in cookie
    assert "Zoë Q" in type(client)(client.port, client.token, "Zo%C3%AB%20Q").get().text


def test_without_a_name_nobody_answers(serve: Callable, out: Path):
    client = serve(out)
    nobody = type(client)(client.port, client.token, None)
    assert "<form" in nobody.get().text and nobody.get().n is None
    assert nobody.label(0, "right").status == nobody.get("next").status == 403
    assert words(out) == 0
    named = serve(out, name="carl")
    assert type(client)(named.port, named.token, None).get().n is not None


def test_tokens_differ_and_are_long():
    tokens = {new_token() for _ in range(100)}
    assert len(tokens) == 100 and {len(token) for token in tokens} == {43}


@given(st.text())
def test_no_other_host_is_admitted(host: str):
    doors = Doors(frozenset({"127.0.0.1", "localhost"}), 8791)
    assert doors.admits(host) == (host.lower() in ("127.0.0.1:8791", "localhost:8791"))


def test_where_all_addresses_are_listened_to_names_are_still_refused():
    listening = listen("0.0.0.0", 0)
    with listening:
        doors, port = doors_of("0.0.0.0", listening), listening.getsockname()[1]
        assert not is_local(listening)
        assert doors.admits(f"192.168.1.17:{port}") and doors.admits(f"{socket.gethostname()}:{port}")
        assert doors.admits(f"[fe80::1]:{port}")
        assert not doors.admits(f"attacker.example:{port}") and not doors.admits("192.168.1.17")


def test_a_server_of_this_machine_cannot_be_reached_from_others(client: Any):
    try:
        found = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    except OSError:
        found = set()
    addresses = [address for address in found if not str(address).startswith("127.")]
    if not addresses:
        pytest.skip("this machine has no other address by its name")
    for address in addresses:
        with pytest.raises(OSError), socket.create_connection((address, client.port), 5):
            pass


def test_no_page_asks_anything_elsewhere(client: Any):
    """Neither the page nor what goes with it names another server, but for a licence and the names of XML."""
    import re

    page = client.get().text
    assert not re.findall(r"""(?:src|href|action)=["']?(?:https?:)?//""", page)
    assert "<script>" not in page and " style=" not in page and not re.search(r"\son\w+=", page)
    names = re.findall(r'(?:src|href)="(/static/[^"#]+)', page)
    assert names
    for name in names:
        assert client.ask("GET", name, {}).status == 200


def test_the_token_is_not_in_what_goes_with_the_page(client: Any):
    from mapgraft.annotate.pages import static_files

    for name in static_files():
        found = client.ask("GET", f"/static/{name}", {})
        assert found.status == 200 and client.token.encode() not in found.body


def test_what_a_page_is_told_can_be_read_by_a_plain_client(serve: Callable, sixty: Path):
    """The address as it is printed works in a client that knows nothing of all this."""
    client = serve(sixty, name="anna")
    with urllib.request.urlopen(f"{client.origin}/{client.token}/") as answer:
        assert answer.status == 200


def test_the_trigger_names_the_example(serve: Callable, out: Path):
    client = serve(out)
    n = client.get().n
    assert json.loads(client.label(n, "right").headers["hx-trigger"]) == {"answered": {"n": n}}
    assert json.loads(client.post("undo").headers["hx-trigger"]) == {"undone": {"n": n}}

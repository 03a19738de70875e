"""The routes of the annotation page. Who may ask is decided before, in ``security``."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Annotated, Any, Final
from urllib.parse import parse_qsl, quote, unquote

from fastapi import Cookie, Depends, FastAPI, HTTPException, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.background import BackgroundTask
from starlette.exceptions import HTTPException as HTTPError

from mapgraft.annotate.desk import Answer, Desk, checked_name
from mapgraft.annotate.pages import fragment, prepare_pages, static_files
from mapgraft.annotate.security import BODY_BYTES, LONG, App, Doors, Guard
from mapgraft.annotate.shown import Which
from mapgraft.errors import MapgraftError

COOKIE: Final = "annotator"
FIELDS: Final = 16  # of a form, at most


def _ignore(error: Exception) -> None:
    pass


def application(
    desk: Desk, token: str, doors: Doors, name: str | None = None, told: Callable[[Exception], None] = _ignore
) -> App:
    """The server as an ASGI application; ``name`` is the annotator where a browser has not said another.

    ``told`` is given errors that nobody has foreseen.
    """
    prepare_pages()
    routes = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, redirect_slashes=False)
    _add_errors(routes, told)
    _add_static(routes)
    _add_pages(routes, desk, f"/{token}", name)
    _add_answers(routes, desk, f"/{token}", name)
    return Guard(routes, token, doors)


def _add_pages(routes: FastAPI, desk: Desk, base: str, default: str | None) -> None:
    """What is only looked at."""
    by = Depends(_annotator(default))

    @routes.get("/")
    def page(name: str | None = None, annotator: Annotated[str | None, Cookie()] = None) -> Response:
        if name is not None:
            return _named(name, base)
        known = _known(annotator) or default
        if known is None:
            return HTMLResponse(fragment("ask.html", base=base, names=desk.annotators()))
        return HTMLResponse(_page(desk, base, known))

    @routes.get("/next")
    def following(annotator: str = by) -> Response:
        return _shown(desk, base, annotator, desk.next(annotator))

    @routes.get("/example/{n:int}")
    def example(n: int, annotator: str = by) -> Response:
        return _shown(desk, base, annotator, _existing(desk, n))

    @routes.get("/picture/{n:int}/{which}.png")
    def picture(n: int, which: Which) -> Response:
        return Response(desk.picture(_existing(desk, n), which), media_type="image/png")

    @routes.get("/progress")
    def progress(annotator: str = by) -> Response:
        return HTMLResponse(fragment("progress.html", base=base, progress=desk.progress(annotator)))

    @routes.get("/revealed/{n:int}")
    def revealed(n: int, annotator: str = by) -> Response:
        word = desk.word(_existing(desk, n), annotator)
        if word is None:
            raise HTTPException(403, "what the robot made of it is told when you have answered")
        values = {"n": n, "word": word, "shown": desk.shown(n), "outcome": desk.outcome(n)}
        return HTMLResponse(fragment("revealed.html", base=base, **values))


def _add_answers(routes: FastAPI, desk: Desk, base: str, default: str | None) -> None:
    """What is written down; when a route answers, it is on disk."""
    by, sent = Depends(_annotator(default)), Depends(_form)

    @routes.post("/label/{n:int}")
    def label(n: int, annotator: str = by, form: dict[str, str] = sent) -> Response:
        try:
            answer = Answer.read(form)
        except ValueError as error:
            raise HTTPException(422, str(error)) from None
        desk.say(_existing(desk, n), annotator, answer)
        shown = _shown(desk, base, annotator, desk.next(annotator))
        shown.headers["hx-trigger"] = json.dumps({"answered": {"n": n}})
        shown.background = BackgroundTask(desk.rest, annotator, n)
        return shown

    @routes.post("/skip/{n:int}")
    def skip(n: int, annotator: str = by) -> Response:
        desk.skip(annotator, _existing(desk, n))
        return _shown(desk, base, annotator, desk.next(annotator))

    @routes.post("/undo")
    def undo(annotator: str = by) -> Response:
        undone = desk.undo(annotator)
        if undone is None:
            raise HTTPException(409, "there is nothing to undo")
        shown = _shown(desk, base, annotator, undone)
        shown.headers["hx-trigger"] = json.dumps({"undone": {"n": undone}})
        return shown


def _add_static(routes: FastAPI) -> None:
    @routes.get("/static/{name}")
    def static(name: str) -> Response:
        found = static_files().get(name)
        if found is None:
            raise HTTPException(404, "there is no such file")
        content, media_type = found
        return Response(content, media_type=media_type)


def _add_errors(routes: FastAPI, told: Callable[[Exception], None]) -> None:
    """Every refusal is one plain sentence, in which nothing of the request comes back."""

    @routes.exception_handler(HTTPError)
    def refused(_request: Request, error: HTTPError) -> Response:
        sentence = "there is nothing here" if error.status_code == 404 and error.detail == "Not Found" else error.detail
        return PlainTextResponse(f"{sentence}\n", error.status_code)

    @routes.exception_handler(MapgraftError)
    def failed(_request: Request, error: MapgraftError) -> Response:
        return PlainTextResponse(f"{error}\n", 503)

    @routes.exception_handler(Exception)
    def unforeseen(_request: Request, error: Exception) -> Response:
        told(error)
        return PlainTextResponse("something has gone wrong here; the terminal tells what\n", 500)

    @routes.exception_handler(RequestValidationError)
    def misread(_request: Request, _error: RequestValidationError) -> Response:
        return PlainTextResponse("the request is not one that the page makes\n", 422)


def _annotator(default: str | None) -> Any:
    """The dependency that tells who asks."""

    async def who(annotator: Annotated[str | None, Cookie()] = None) -> str:
        known = _known(annotator) or default
        if known is None:
            raise HTTPException(403, "say your name first: open the page")
        return known

    return who


async def _form(request: Request) -> dict[str, str]:
    """The fields of a form, as browsers send it where it holds no file."""
    body = bytearray()
    async for piece in request.stream():
        body += piece
        if len(body) > BODY_BYTES:  # whatever its length was said to be
            raise HTTPException(413, LONG)
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/x-www-form-urlencoded":
        raise HTTPException(415, "an answer is a plain form")
    try:
        pairs = parse_qsl(body.decode(), True, True, errors="strict", max_num_fields=FIELDS)
    except ValueError:
        raise HTTPException(422, "the form cannot be read") from None
    return dict(pairs)


def _known(cookie: str | None) -> str | None:
    """The name that the cookie holds, None where it holds none that would do."""
    try:
        return None if cookie is None else checked_name(unquote(cookie, errors="strict"))
    except ValueError:
        return None


def _named(name: str, base: str) -> Response:
    """The page again, for a browser that now knows whose answers it sends."""
    try:
        known = checked_name(name)
    except ValueError as error:
        raise HTTPException(422, str(error)) from None
    answer = RedirectResponse(f"{base}/", 303)
    answer.set_cookie(COOKIE, quote(known, safe=""), path=f"{base}/", httponly=True, samesite="strict")
    return answer


def _existing(desk: Desk, n: int) -> int:
    if not 0 <= n < len(desk):
        raise HTTPException(404, "there is no such example")
    return n


def _page(desk: Desk, base: str, annotator: str) -> str:
    return fragment("page.html", **_values(desk, base, annotator, desk.next(annotator)))


def _shown(desk: Desk, base: str, annotator: str, n: int | None) -> Response:
    template = "done.html" if n is None else "example.html"
    return HTMLResponse(fragment(template, **_values(desk, base, annotator, n)))


def _values(desk: Desk, base: str, annotator: str, n: int | None) -> dict[str, object]:
    """What the templates of an example are given; nothing in it tells what the robot made of it."""
    return {
        "base": base,
        "annotator": annotator,
        "shown": None if n is None else desk.shown(n),
        "word": None if n is None else desk.word(n, annotator),
        "following": None if n is None else desk.after(annotator, n),
        "progress": desk.progress(annotator),
    }

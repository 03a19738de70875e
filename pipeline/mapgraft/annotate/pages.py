"""The server's pages and fragments, from the templates beside this file; everything from outside is escaped."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Final

from mapgraft.pages import prepare, render

PACKAGE: Final = "mapgraft.annotate"
MEDIA_TYPES: Final = {
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
    "txt": "text/plain; charset=utf-8",
}


def fragment(template: str, **values: object) -> str:
    """A template of this package with its values; raises jinja2.UndefinedError for one that it does not get."""
    return render(template, PACKAGE, **values)


def prepare_pages() -> None:
    """Read all that is on disk: what a server gives does not change while it runs, and the first page is fast."""
    prepare(PACKAGE)
    static_files()


@cache
def static_files() -> dict[str, tuple[bytes, str]]:
    """The files that go with the page: name → content and media type. No other is ever served."""
    folder = files(PACKAGE) / "static"
    found = sorted((entry.name, entry) for entry in folder.iterdir() if entry.is_file())
    return {
        name: (entry.read_bytes(), MEDIA_TYPES[ending])
        for name, entry in found
        if (ending := name.rpartition(".")[2]) in MEDIA_TYPES
    }

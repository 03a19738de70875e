"""``mapgraft report``: the page that shows what is in a folder."""

from __future__ import annotations

from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from typing import Final

from mapgraft.console import cell, results
from mapgraft.errors import UsageError

# What a folder holds → the function that makes its page, ``page_of(folder: Path) -> str``. The first that fits does.
PAGES: Final = {
    "summary.json": "mapgraft.outputs.report:page_of",
    "experiment.json": "mapgraft.experiments.andersone2021.telling.page:page_of",
}


def report_and_show(folder: Path, target: Path | None) -> None:
    """Make the page of a folder, write it into the folder or to ``target``, and say where it is.

    Raises UsageError when the folder holds nothing that has a page, OutputError when that is
    damaged or the page cannot be written.
    """
    from mapgraft.outputs.lock import locked
    from mapgraft.outputs.report import publish

    if target is not None and target.is_dir():
        raise UsageError(f"{target} is a folder: name the file to write")
    page = page_of(folder)
    with locked(folder) if target is None else nullcontext():
        place = publish(folder, page, target)
    results().print(cell(f"{place}  {place.stat().st_size / 1e6:.2f} MB"))


def page_of(folder: Path) -> str:
    """The page of whatever a folder holds; raises UsageError when there is nothing that has one."""
    held = next((name for name in PAGES if (folder / name).is_file()), "summary.json")
    module, _, function = PAGES[held].partition(":")
    page: str = getattr(import_module(module), function)(folder)
    return page

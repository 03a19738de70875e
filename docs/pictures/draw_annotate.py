"""Draws annotate*.png: the annotation page on the examples of both demos, as Chromium shows it.

python docs/pictures/draw_annotate.py [FOLDER]

Runs both demos into FOLDER, or takes the runs that are there already.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

from mapgraft.annotate.opened import open_folders
from mapgraft.cli import invoke

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = ("--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-sync")
GAP, COLOURS = 12, 192
PHONE = {"width": 390, "height": 844}
DESK = {"width": 1280, "height": 800}


@dataclass(frozen=True)
class Shot:
    """One example on the page, after some keys."""

    demo: str
    example: str
    keys: str = ""
    scheme: str = "light"
    viewport: dict[str, int] = field(default_factory=lambda: DESK)
    answer: str = ""  # before, so that something is revealed
    part: str = ""  # of the page, a selector; else what the window holds


PICTURES = {
    "annotate": [Shot("grids", "alpha.charlie.2", answer="alpha.bravo.1")],
    "annotate_views": [
        Shot("grids", "alpha.bravo.1", part="#stage"),
        Shot("grids", "alpha.bravo.1", "d", part="#stage"),
        Shot("heterogeneous", "alpha.bravo.2", part="#stage"),
        Shot("heterogeneous", "alpha.charlie.3", part="#stage"),
        Shot("heterogeneous", "alpha.plan.2", part="#stage"),
        Shot("heterogeneous", "bravo.charlie.3", "d", "dark", part="#stage"),
    ],
    "annotate_phone": [
        Shot("heterogeneous", "alpha.plan.2", "", "light", PHONE),
        Shot("grids", "bravo.charlie.2", "d", "dark", PHONE),
        Shot("grids", "alpha.charlie.2", "", "light", PHONE, "alpha.bravo.1", "#last"),
    ],
}


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        runs = demos(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder))
        with sync_playwright() as playwright:
            path = os.environ.get("MAPGRAFT_CHROMIUM") or next(filter(None, map(shutil.which, BROWSERS)), None)
            browser = playwright.chromium.launch(executable_path=path, args=list(OPTIONS))
            for name, shots in PICTURES.items():
                taken = [photograph(browser, runs[shot.demo], shot, Path(folder)) for shot in shots]
                columns = 2 if name == "annotate_views" else len(taken)
                width = {"annotate": 1280, "annotate_views": 620, "annotate_phone": 390}[name]
                sheet(taken, columns, width).save(Path(__file__).with_name(f"{name}.png"), optimize=True)
            browser.close()


def demos(folder: Path) -> dict[str, Path]:
    runs = {"grids": folder / "grids", "heterogeneous": folder / "heterogeneous"}
    for demo, out in runs.items():
        if not out.is_dir() and invoke(["run", "--demo", demo, "--examples", "--no-report", "--quiet", "-o", str(out)]):
            raise SystemExit(f"mapgraft run --demo {demo} failed")
    return runs


def photograph(browser: Any, run: Path, shot: Shot, scratch: Path) -> Image.Image:
    """The page with an example; what is answered on the way goes to a copy of the run."""
    copy = scratch / "copy"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(run / "examples", copy / "examples")
    opened = open_folders([copy])
    numbers = {key.example_id: number for number, key in enumerate(opened.keys)}
    with served(copy) as address:
        page = browser.new_context(viewport=shot.viewport, color_scheme=shot.scheme, device_scale_factor=1).new_page()
        page.goto(f"{address}?name=Ida")
        page.wait_for_selector("#stage[data-shown]")
        if shot.answer:
            show(page, numbers[shot.answer])
            page.keyboard.press("w")
            page.wait_for_selector("#last:not(:empty)")
        show(page, numbers[shot.example])
        for key in shot.keys:
            page.keyboard.press(key)
        page.evaluate("document.activeElement.blur()")
        page.wait_for_timeout(300)
        target = scratch / "shot.png"
        (page.locator(shot.part) if shot.part else page).screenshot(path=target)
        page.context.close()
        return Image.open(target).convert("RGB")


def show(page: Any, number: int) -> None:
    """Put one example on the page, whatever the queue holds."""
    address = f"{page.evaluate('document.body.dataset.base')}/example/{number}"
    page.evaluate("a => void htmx.ajax('GET', a, { target: '#example', swap: 'outerHTML' })", address)
    page.wait_for_selector(f"#stage[data-shown='{number}']:not([aria-busy])")


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of ``mapgraft annotate`` on a folder."""
    command = [sys.executable, "-m", "mapgraft", "annotate", str(folder), "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    try:
        yield next(found.group() for line in process.stdout if (found := re.search(r"http://\S+/", line)))
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(30)


def sheet(pictures: list[Image.Image], columns: int, width: int) -> Image.Image:
    """The pictures in rows, all as wide, in few colours."""
    scaled = [p.resize((width, round(p.height * width / p.width)), Image.Resampling.LANCZOS) for p in pictures]
    rows = [scaled[i : i + columns] for i in range(0, len(scaled), columns)]
    heights = [max(p.height for p in row) for row in rows]
    size = (columns * (width + GAP) - GAP, sum(heights) + GAP * (len(rows) - 1))
    page = Image.new("RGB", size, "white")
    top = 0
    for row, height in zip(rows, heights, strict=True):
        for column, picture in enumerate(row):
            page.paste(picture, (column * (width + GAP), top))
        top += height + GAP
    return page.quantize(COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


if __name__ == "__main__":
    main()

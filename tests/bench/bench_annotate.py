"""How fast the annotation page is: until it can be worked with, and until the next example is shown.

    python tests/bench/bench_annotate.py [--examples 10000] [--visits 9] [--answers 60] [--json FILE]

Writes toy examples, starts ``mapgraft annotate`` on them in a process of its own, and works through the page in a
headless Chromium. Measured in the browser, by its own clock:

- page ready: from the beginning of the navigation until both maps are painted and an answer would be taken, in a
  new profile each time (nothing is cached);
- next example: from the key that answers until the maps of the next example are painted. The answer is on disk by then;
- moving: from an arrow key until the frame with the moved map is painted.

Told beside it: how long the server took to open the folder, and the load of the machine, which shares in every number.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1] / "toys"))
from toy_examples import write_toys

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = ("--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-sync")
READY_S, NEXT_S = 1.0, 0.150
PAINTED = "() => new Promise(done => requestAnimationFrame(() => setTimeout(done)))"
MOVED = """async () => {
  const start = performance.now();
  document.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true }));
  await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
  return performance.now() - start;
}"""


def main() -> None:
    asked = arguments()
    with tempfile.TemporaryDirectory() as folder:
        write_toys(Path(folder), asked.examples)
        start = time.perf_counter()
        server, address = started(Path(folder))
        opened_s = time.perf_counter() - start
        try:
            with sync_playwright() as playwright:
                path = os.environ.get("MAPGRAFT_CHROMIUM") or next(filter(None, map(shutil.which, BROWSERS)), None)
                browser = playwright.chromium.launch(executable_path=path, args=list(OPTIONS))
                ready = [visited(browser, address, number) for number in range(asked.visits)]
                following, moving = answered(browser, address, asked.answers)
                browser.close()
        finally:
            server.send_signal(signal.SIGTERM)
            server.wait(30)
    load = os.getloadavg()[0]
    told = {
        "examples": asked.examples,
        "cpus": os.cpu_count(),
        "load": load,
        "server_opened_s": opened_s,
        "page_ready_s": summary(ready),
        "next_example_s": summary(following),
        "moving_s": summary(moving),
    }
    print(f"{asked.examples} examples queued; {os.cpu_count()} CPUs, load {load:.1f}; server up in {opened_s:.2f} s")
    for name, seconds, limit in (
        ("page ready", ready, READY_S),
        ("next example", following, NEXT_S),
        ("moving", moving, None),
    ):
        low, middle, high = np.percentile(seconds, (5, 50, 95)) * 1000.0
        bound = "" if limit is None else f", {np.mean(np.asarray(seconds) <= limit):.0%} within {limit * 1000:.0f} ms"
        print(f"{name:13} median {middle:4.0f} ms, 5 % {low:4.0f}, 95 % {high:4.0f} ({len(seconds)} times{bound})")
    if asked.json:
        asked.json.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--examples", type=int, default=10_000)
    parser.add_argument("--visits", type=int, default=9)
    parser.add_argument("--answers", type=int, default=60)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def started(folder: Path) -> tuple[subprocess.Popen[str], str]:
    """The server, and the address that it prints when it listens."""
    command = [sys.executable, "-m", "mapgraft", "annotate", str(folder), "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    return process, next(found.group() for line in process.stdout if (found := re.search(r"http://\S+/", line)))


def visited(browser: Any, address: str, number: int) -> float:
    """Seconds until the page is ready, for somebody who comes for the first time."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page = context.new_page()
    page.goto(f"{address}?name=visitor-{number}")
    page.wait_for_selector("#stage[data-shown]")
    ready_ms = page.evaluate("() => performance.getEntriesByName('ready')[0].startTime")
    context.close()
    return float(ready_ms) / 1000.0


def answered(browser: Any, address: str, answers: int) -> tuple[list[float], list[float]]:
    """Seconds until the next example, once per answer, and until a moved map is painted."""
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.goto(f"{address}?name=worker")
    page.wait_for_selector("#stage[data-shown]")
    moving = []
    for number in range(answers):
        before = page.locator("#stage").get_attribute("data-shown")
        page.wait_for_timeout(400)  # a person looks at least so long
        moving.append(float(page.evaluate(MOVED)) / 1000.0)
        page.keyboard.press("rwu"[number % 3])
        page.wait_for_selector(f"#stage[data-shown]:not([data-shown='{before}'])")
    page.evaluate(PAINTED)
    return [
        ms / 1000.0 for ms in page.evaluate("() => performance.getEntriesByName('next').map(e => e.duration)")
    ], moving


def summary(seconds: Sequence[float]) -> dict[str, float]:
    low, middle, high = np.percentile(seconds, (5, 50, 95)).tolist()
    return {"p5": low, "median": middle, "p95": high, "largest": max(seconds), "times": len(seconds)}


if __name__ == "__main__":
    main()

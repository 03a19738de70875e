"""Draws report.png: the timeline and the first merge on the page of the demo, as Chromium shows them.

python docs/pictures/draw_report.py
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np

from mapgraft.cli import invoke

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTH, HEIGHT = 1280, 3000  # more than there is to see
ONLY = """<style>
header.top, nav, footer, section, #merges ~ *, article.card { display: none !important; }
section:has(#timeline), section:has(#merges), #merges ~ article.card:first-of-type { display: block !important; }
</style></head>"""


def shown(page: Path, picture: Path) -> None:
    """A screenshot of a page; raises SystemExit where there is no browser."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise SystemExit(f"no browser is installed: one of {', '.join(BROWSERS)} is needed")
    size = f"--window-size={WIDTH},{HEIGHT}"
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", size, f"--screenshot={picture}"]
    subprocess.run([browser, *options, page.as_uri()], check=True, capture_output=True, timeout=120)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        if invoke(["run", "--quiet", "-o", str(out)]):
            raise SystemExit("mapgraft run failed")
        part, picture = Path(folder) / "part.html", Path(folder) / "part.png"
        part.write_text((out / "report.html").read_text(encoding="utf-8").replace("</head>", ONLY), encoding="utf-8")
        shown(part, picture)
        pixels = cv2.imread(str(picture))
        used = np.flatnonzero((pixels != pixels[-1, 0]).any(axis=(1, 2)))
        cut = pixels[max(0, used[0] - 12) : used[-1] + 24]
        cv2.imwrite(str(Path(__file__).with_name("report.png")), cut, [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()

"""Draws calibration_promises.png and calibration_curves.png: parts of a calibration's page, as Chromium shows them.

python tests/bench/bench_calibrate.py --work FOLDER          # once; takes an hour
python docs/pictures/draw_calibration.py FOLDER/thresholds
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTH, HEIGHT = 1280, 3000  # more than there is to see
HIDDEN = "nav, footer, #labels, #labels ~ *, {} {{ display: none !important; }}"
PARTS = {
    "calibration_promises": "header.top .lead, .plots",
    "calibration_curves": "header.top, h2, h2 ~ p, main > .card",
}


def shown(page: Path, picture: Path) -> None:
    """A screenshot of a page; raises SystemExit where there is no browser."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise SystemExit(f"no browser is installed: one of {', '.join(BROWSERS)} is needed")
    size = f"--window-size={WIDTH},{HEIGHT}"
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", size, f"--screenshot={picture}"]
    subprocess.run([browser, *options, page.as_uri()], check=True, capture_output=True, timeout=120)


def main() -> None:
    if len(sys.argv) != 2:
        raise SystemExit("name the folder that mapgraft calibrate has written")
    page = (Path(sys.argv[1]) / "report.html").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        part, picture = Path(folder) / "part.html", Path(folder) / "part.png"
        for name, hidden in PARTS.items():
            part.write_text(page.replace("</head>", f"<style>{HIDDEN.format(hidden)}</style></head>"), encoding="utf-8")
            shown(part, picture)
            pixels = cv2.imread(str(picture))
            used = np.flatnonzero((pixels != pixels[-1, 0]).any(axis=(1, 2)))
            cut = pixels[max(0, used[0] - 12) : used[-1] + 24]
            cv2.imwrite(str(Path(__file__).with_name(f"{name}.png")), cut, [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()

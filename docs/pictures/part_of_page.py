"""Parts of a page that mapgraft has written, as Chromium shows them."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTH, HEIGHT = 1280, 3000  # more than there is to see


def draw_part(page: Path, style: str, picture: Path) -> None:
    """A picture of a page under one more style sheet, cut to what is there; raises SystemExit without a browser."""
    with tempfile.TemporaryDirectory() as folder:
        part, whole = Path(folder) / "part.html", Path(folder) / "part.png"
        text = page.read_text(encoding="utf-8").replace("</head>", f"<style>{style}</style></head>")
        part.write_text(text, encoding="utf-8")
        _shown(part, whole)
        pixels = cv2.imread(str(whole))
    used = np.flatnonzero((pixels != pixels[-1, 0]).any(axis=(1, 2)))
    cut = pixels[max(0, used[0] - 12) : used[-1] + 24]
    cv2.imwrite(str(picture), cut, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def _shown(page: Path, picture: Path) -> None:
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise SystemExit(f"no browser is installed: one of {', '.join(BROWSERS)} is needed")
    size = f"--window-size={WIDTH},{HEIGHT}"
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", size, f"--screenshot={picture}"]
    subprocess.run([browser, *options, page.as_uri()], check=True, capture_output=True, timeout=120)

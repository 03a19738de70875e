"""Draws calibration_promises.png and calibration_curves.png: parts of a calibration's page, as Chromium shows them.

python tests/bench/bench_calibrate.py --work FOLDER          # once; takes an hour
python docs/pictures/draw_calibration.py FOLDER/thresholds
"""

from __future__ import annotations

import sys
from pathlib import Path

from part_of_page import draw_part

HIDDEN = "nav, footer, #labels, #labels ~ *, {} {{ display: none !important; }}"
PARTS = {
    "calibration_promises": "header.top .lead, .plots",
    "calibration_curves": "header.top, h2, h2 ~ p, main > .card",
}


def main() -> None:
    if len(sys.argv) != 2:
        raise SystemExit("name the folder that mapgraft calibrate has written")
    for name, hidden in PARTS.items():
        draw_part(Path(sys.argv[1]) / "report.html", HIDDEN.format(hidden), Path(__file__).with_name(f"{name}.png"))


if __name__ == "__main__":
    main()

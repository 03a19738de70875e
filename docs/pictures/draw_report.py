"""Draws report.png: the timeline and the first merge on the page of the demo, as Chromium shows them.

python docs/pictures/draw_report.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from part_of_page import draw_part

from mapgraft.cli import invoke

ONLY = """
header.top, nav, footer, section, #merges ~ *, article.card { display: none !important; }
section:has(#timeline), section:has(#merges), #merges ~ article.card:first-of-type { display: block !important; }
"""


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        if invoke(["run", "--quiet", "-o", str(out)]):
            raise SystemExit("mapgraft run failed")
        draw_part(out / "report.html", ONLY, Path(__file__).with_name("report.png"))


if __name__ == "__main__":
    main()

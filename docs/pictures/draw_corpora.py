"""Draws docs/pictures/corpora.png: ``python docs/pictures/draw_corpora.py``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import FancyBboxPatch

OUT = Path(__file__).with_name("corpora.png")
INK, SOFT = "#1f2933", "#7b8794"
GIVEN, JOBS, WORK, KEPT, FAILED = "#dbeafe", "#e5e7eb", "#fef3c7", "#dcfce7", "#fee2e2"


def box(axes: Any, x: float, y: float, width: float, height: float, text: str, color: str, size: float = 9.0) -> None:
    shape = FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0,rounding_size=0.09", fc=color, ec=INK, lw=0.8)
    axes.add_patch(shape)
    axes.text(x + width / 2, y + height / 2, text, ha="center", va="center", fontsize=size, color=INK)


def arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], text: str = "", above: float = 0.12) -> None:
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.0, "shrinkA": 2, "shrinkB": 2})
    if text:
        x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2 + above
        axes.text(x, y, text, ha="center", va="bottom", fontsize=7.5, color=SOFT)


def draw() -> None:
    figure, axes = plt.subplots(figsize=(11.5, 4.6))
    axes.set_xlim(0, 16.2)
    axes.set_ylim(0, 6.4)
    axes.set_axis_off()
    for x, title in ((1.2, "what there is"), (4.75, "jobs"), (8.65, "any executor"), (13.65, "one data set")):
        axes.text(x, 6.05, title, ha="center", fontsize=10, color=INK, weight="bold")
    for k, text in enumerate(("office.mcap", "a.bag + b.bag", "s3://…/hall.mcap")):
        box(axes, 0.1, 4.9 - 0.75 * k, 2.3, 0.58, text, GIVEN)
    for k, text in enumerate(("ledger.yaml", "two_maps.yaml")):
        box(axes, 0.1, 1.6 - 0.75 * k, 2.3, 0.58, text, GIVEN)
    axes.text(1.25, 2.6, "×", ha="center", va="center", fontsize=15, color=INK)
    for row in range(3):
        for column in range(2):
            done = (row, column) in ((0, 0), (0, 1))
            box(
                axes,
                3.6 + 1.2 * column,
                4.6 - 1.0 * row,
                1.05,
                0.75,
                "there" if done else "job",
                KEPT if done else JOBS,
            )
    axes.text(
        4.75,
        1.85,
        "id = contents of the files,\nconfiguration, rules,\nversions",
        ha="center",
        va="center",
        fontsize=7.5,
        color=SOFT,
    )
    arrow(axes, (2.5, 3.4), (3.5, 3.9))
    for k, text in enumerate(("process", "process", "Dask worker", "Dask worker")):
        box(axes, 7.6, 4.9 - 0.95 * k, 2.1, 0.7, text, WORK)
    arrow(axes, (6.0, 3.9), (7.5, 3.9), "not done yet")
    axes.annotate("", (6.0, 2.6), (7.5, 2.2), arrowprops={"arrowstyle": "-|>", "color": SOFT, "lw": 1.0, "ls": "--"})
    axes.text(6.9, 0.95, "died, line broke:\nagain, behind the others", ha="center", fontsize=7.5, color=SOFT)
    tables = ("events/", "metrics/", "maps/", "recordings/", "labels/", "timings/")
    for k, text in enumerate(tables):
        box(axes, 12.2 + 1.5 * (k % 2), 4.9 - 0.7 * (k // 2), 1.4, 0.55, text, KEPT, 8.5)
    box(axes, 12.2, 2.45, 2.9, 0.62, "runs/   written last", KEPT)
    box(axes, 12.2, 0.85, 2.9, 0.62, "failures/   why not", FAILED)
    arrow(axes, (9.85, 4.4), (12.1, 4.6), "1. tables")
    arrow(axes, (9.85, 3.3), (12.1, 2.85), "2. the row that counts", 0.2)
    arrow(axes, (9.85, 2.2), (12.1, 1.2), "failed for good", 0.25)
    axes.text(13.65, 0.35, "folder, s3://, gs://, …", ha="center", fontsize=8, color=SOFT)
    axes.text(9.5, 0.35, "MCAP: only the chunks that are needed", ha="center", fontsize=7.5, color=SOFT)
    figure.savefig(OUT, dpi=110, bbox_inches="tight", facecolor="white", metadata={"Software": None})


if __name__ == "__main__":
    draw()

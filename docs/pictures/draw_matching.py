"""Draws the pictures of docs/matching.md, from simulated buildings and the demo recording.

    python docs/pictures/draw_matching.py

The buildings are others than those on which the posterior was fitted.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import scipy.fft
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from ruamel.yaml import YAML
from scipy.ndimage import maximum_filter

import mapgraft
from mapgraft.comparison import Compared
from mapgraft.contracts import EmptyMapError, Match, Points, Step, Transform
from mapgraft.evaluation.building import Pair, build
from mapgraft.evaluation.courses import Course
from mapgraft.evaluation.drawing import Drawing, draw_pairs
from mapgraft.events import Event
from mapgraft_grid import correlation_search as searching
from mapgraft_grid.bayes import occupancy_prior
from mapgraft_grid.correlation import Correlation
from mapgraft_grid.evidence.joint import TOLERANCE_M, Joint, joint_of
from mapgraft_grid.evidence.posterior import Posterior
from mapgraft_grid.evidence.traces import Paths, Rays
from mapgraft_grid.grid_map import FREE, OCCUPIED, UNKNOWN, Classes, GridMap
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.prepared import canonical_m, prepare
from mapgraft_grid.similarity import Similarity
from mapgraft_recordings.buildings import building, drive
from mapgraft_standard.sequential import Sequential

BUILDINGS = range(1, 13)
SCANS, PAIRS, SEED = 300, 240, 3
CELL_M = 0.07
BLUE, ORANGE, RED, GREY = "#0072B2", "#E69F00", "#D55E00", "#8c8c8c"  # Okabe and Ito's, safe for the colour-blind
MARKS = {"merged": "o", "confirmed": "s", "reverted": "X"}
FIRST_MEETING_S = 30.0
LEAST_SIMILARITY = 0.85  # lower ones are counted in the title
FOLDER = Path(__file__).parent
Colour = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Found:
    """The first hypothesis of one pair, and what is measured of it."""

    pair: Pair
    match: Match
    compared: Compared
    right: bool
    similarity: float
    log_odds: float
    rays: float
    paths: float


def courses() -> list[Course]:
    out = []
    for number, seed in enumerate(BUILDINGS):
        driven = tuple(drive(building(seed), seed, SCANS))
        stamps_ns = np.array([observation.stamp_ns for observation in driven], np.int64)
        name = f"building {seed}"
        out.append(Course(number, name, (name,), name, Transform.identity(), driven, stamps_ns, "simulated", ""))
    return out


def found_pairs() -> Iterator[Found]:
    grids, matcher = OccupancyGrid(resolution_m=CELL_M), Correlation()
    for plan in draw_pairs(courses(), Drawing(PAIRS, 30, 10, 0.5, SEED)):
        pair = build(plan, grids, grids)
        own, donor = pair.receiver, pair.donor
        assert isinstance(own.map, GridMap) and isinstance(own.layer, GridLayer) and isinstance(donor.layer, GridLayer)
        try:
            match = matcher.match(own.map, donor.map)[0]
        except (EmptyMapError, IndexError):
            continue
        T = match.T_receiver_donor.snapped()
        placed = grids.place(donor.layer, T)
        compared = Compared(grids, "own", T, match, placed, lambda seen=(own.layer, own.map): seen)
        posterior = Posterior().track(compared).update(Step())
        if not posterior.sufficient:
            continue
        yield Found(
            pair,
            match,
            compared,
            pair.truth is not None and pair.truth.error(match.T_receiver_donor).right,
            Similarity().track(compared).update(Step()).value,
            posterior.details["log_odds"],
            Rays().track(compared).update(Step()).value,
            Paths().track(compared).update(Step()).value,
        )


def shades(own: Classes, donor: Classes) -> NDArray[np.float64]:
    """Walls of the receiver blue, of the donor orange, of both black, drawn a cell thicker than they are; free space
    is brighter where both know it."""
    image = np.full((*own.shape, 3), 0.82)
    image[(own == FREE) | (donor == FREE)] = 0.93
    image[(own == FREE) & (donor == FREE)] = 1.0
    ours, theirs = (maximum_filter(side == OCCUPIED, 3) for side in (own, donor))
    thick = [maximum_filter(side == OCCUPIED, 2) for side in (own, donor)]
    image[thick[0]] = matplotlib.colors.to_rgb(BLUE)
    image[thick[1]] = matplotlib.colors.to_rgb(ORANGE)
    image[(thick[0] & theirs) | (thick[1] & ours)] = 0.0
    return image


def show(axes: Axes, image: NDArray[np.float64], title: str) -> None:
    axes.imshow(image, origin="lower", interpolation="nearest")
    axes.set_title(title, fontsize=10, loc="left")
    axes.axis("off")


def both_over(found: Found) -> tuple[Classes, Classes, tuple[int, int]]:
    """The classes of both maps in the receiver's frame, over all that one of them knows, and its first cell."""
    boxes = np.array([found.compared.target.bounds_cells(), found.compared.donor.bounds_cells()])
    (x0, y0), (x1, y1) = boxes[:, :2].min(axis=0).tolist(), boxes[:, 2:].max(axis=0).tolist()
    window = (x0 - 3, y0 - 3), (y1 - y0 + 6, x1 - x0 + 6)
    own, donor = (side.dense_over(*window).classes for side in (found.compared.target, found.compared.donor))
    return own, donor, window[0]


def squareness(found: Found) -> float:
    """The shorter over the longer side of what both maps cover: tall pictures are small."""
    sides = both_over(found)[0].shape
    return float(min(sides)) / float(max(sides))


def draw_maps(found: Found) -> Figure:
    """Two maps of one building, and both on each other."""
    figure, axes = plt.subplots(1, 3, figsize=(12, 4.2), layout="constrained")
    own, donor = found.pair.receiver.map, found.pair.donor.map
    assert isinstance(own, GridMap) and isinstance(donor, GridMap)
    for ax, map_, name in ((axes[0], own, "receiver"), (axes[1], donor, "donor")):
        classes = map_.dense().classes
        nothing = np.full_like(classes, UNKNOWN)
        pair = (classes, nothing) if name == "receiver" else (nothing, classes)
        show(ax, shades(*pair), f"the {name}'s map, in a frame of its own")
    show(axes[2], shades(*both_over(found)[:2]), f"both where they belong: L = {found.match.score:.0f} nats")
    return figure


def against(joint: Joint) -> NDArray[np.bool_]:
    """Walls of either in free space of the other, near no wall of it."""
    ours = (joint.own == OCCUPIED) & (joint.donor == FREE) & (joint.to_donor_m > TOLERANCE_M)
    theirs = (joint.donor == OCCUPIED) & (joint.own == FREE) & (joint.to_own_m > TOLERANCE_M)
    both: NDArray[np.bool_] = ours | theirs
    return both


def beams_against(joint: Joint, layer: GridLayer, classes: Classes, to_wall_m: NDArray[np.float32]) -> Points:
    """Beams (n, 2, 2) in cells of the joint window that go through a wall of the other map."""
    rays = layer.rays()
    origins, ends = joint.cells(rays.origins_m), joint.cells(rays.ends_m)
    out = []
    for origin, end in zip(origins, ends, strict=True):
        length = float(np.hypot(*(end - origin)))
        along = np.arange(0.0, max(0.0, length - TOLERANCE_M / joint.unit_m), 0.5)[:, None] / max(length, 1e-9)
        cells = np.floor(origin + along * (end - origin)).astype(int)
        inside = ((cells >= 0) & (cells < np.array(classes.shape)[::-1])).all(axis=1)
        x, y = cells[inside].T
        wall, clear = classes[y, x] == OCCUPIED, (to_wall_m[y, x] > TOLERANCE_M) & (classes[y, x] == FREE)
        if wall.any() and clear[: int(wall.argmax())].any() and clear[int(wall.argmax()) :].any():
            out.append((origin, end))
    return np.array(out).reshape(-1, 2, 2)


def draw_accident(found: Found) -> Figure:
    """Two maps that have nothing to do with each other: how good it looks, and what gives it away."""
    figure, axes = plt.subplots(1, 2, figsize=(12, 5.6), layout="constrained")
    own, donor, first = both_over(found)
    probability = 1.0 / (1.0 + np.exp(-found.log_odds))
    said = f"two different buildings: SM {found.similarity:.2f}, L = {found.match.score:.0f} nats"
    show(axes[0], shades(own, donor), said)
    image = shades(own, donor) * 0.35 + 0.65
    joint = joint_of(found.compared, "picture")
    scale = joint.unit_m / found.compared.target.resolution_m
    shift = np.array(joint.origin_m) / found.compared.target.resolution_m - np.array(first)
    against_it = f"{100 * found.rays:.0f} % of the beams, {found.paths:.0f} wall cells on the paths"
    show(axes[1], image, f"what gives it away: {against_it}; p = {probability:.2g}")
    y, x = np.nonzero(against(joint))
    axes[1].scatter(*(scale * (np.stack((x, y)) + 0.5) + shift[:, None] - 0.5), s=9, c=RED, marker="s", linewidths=0)
    sides = (
        (found.compared.target_layer, joint.donor, joint.to_donor_m, BLUE),
        (found.compared.donor_layer, joint.own, joint.to_own_m, ORANGE),
    )
    for layer, classes, to_wall_m, colour in sides:
        beams = beams_against(joint, layer, classes, to_wall_m)[::2]
        axes[1].add_collection(LineCollection(list(scale * beams + shift - 0.5), colors=RED, linewidths=0.6, alpha=0.6))
        path = joint.cells(layer.path()[:, :2])
        axes[1].plot(*(scale * path + shift - 0.5).T, color=colour, linewidth=1.6)
        axes[1].plot(
            *(scale * walls_on(path, classes) + shift - 0.5).T, "x", color=RED, markersize=9, markeredgewidth=2
        )
    return figure


def walls_on(path: Points, classes: Classes) -> Points:
    """Where (n, 2) a path goes through occupied cells."""
    dense = np.concatenate([a + np.linspace(0.0, 1.0, 50)[:, None] * (b - a) for a, b in itertools.pairwise(path)])
    cells = np.floor(dense).astype(int)
    inside = ((cells >= 0) & (cells < np.array(classes.shape)[::-1])).all(axis=1)
    dense, (x, y) = dense[inside], cells[inside].T
    through: Points = dense[classes[y, x] == OCCUPIED]
    return through


def scored(found: Found) -> tuple[NDArray[np.float32], int, float]:
    """The matcher's scores (180, h, w) of all shifts on its coarse cells, for every second degree.

    With how many cells a donor's middle may lie outside of the target, and the size of the cells (m).
    """
    own, donor = found.pair.receiver.map, found.pair.donor.map
    assert isinstance(own, GridMap) and isinstance(donor, GridMap)
    unit_m = canonical_m(own.resolution_m, donor.resolution_m)
    target, source = prepare(own, unit_m), prepare(donor, unit_m)
    coarse = searching.level(target, occupancy_prior(target, source), searching.coarse_factor(target, source))
    sample = searching.sampled(source, searching.CLEAR_CELLS * coarse.unit_m, searching.COARSE_POINTS)
    reach = int(np.ceil(source.radius_m / coarse.unit_m)) + 1
    height, width = (scipy.fft.next_fast_len(n + 2 * reach, real=True) for n in coarse.on_wall.shape)
    still = searching.spectra(coarse, (height, width))
    half = np.array(
        [searching.scored(still, sample, yaw, coarse.unit_m) for yaw in np.deg2rad(np.arange(0.0, 180.0, 2.0))]
    )
    return np.concatenate((half[..., 0], half[..., 1])), reach, coarse.unit_m


def draw_search(found: Found) -> Figure:
    """What a coarse search looks at: all rotations, and all shifts of the best one."""
    scores, reach, unit_m = scored(found)
    highest = scores.max(axis=(1, 2))
    best = int(highest.argmax())
    figure, axes = plt.subplots(1, 2, figsize=(12, 4), layout="constrained", width_ratios=(1.3, 1))
    axes[0].plot(np.arange(0.0, 360.0, 2.0), highest, color=BLUE)
    axes[0].set_xlabel("rotation of the donor's map, degrees")
    axes[0].set_ylabel("highest score of all shifts, nats")
    axes[0].set_title("every rotation", fontsize=10, loc="left")
    axes[0].annotate("highest", (2.0 * best, highest[best]), xytext=(8, -4), textcoords="offset points", color=RED)
    centred = np.roll(scores[best], (reach, reach), axis=(0, 1))
    told = np.argwhere(abs(centred) > 50.0)
    (y0, x0), (y1, x1) = told.min(axis=0), told.max(axis=0) + 1
    centred = centred[y0:y1, x0:x1]
    shown = axes[1].imshow(centred, origin="lower", cmap="cividis", vmin=-float(centred.max()))
    y, x = np.unravel_index(int(centred.argmax()), centred.shape)
    axes[1].plot(x, y, "o", markersize=14, markerfacecolor="none", markeredgecolor=RED, markeredgewidth=2)
    axes[1].set_title(f"every shift at {2 * best}°, cells of {unit_m:.1f} m", fontsize=10, loc="left")
    axes[1].axis("off")
    figure.colorbar(shown, ax=axes[1], label="nats")
    return figure


def default_rules() -> list[dict[str, Any]]:
    text = (files("mapgraft_grid") / "rules.yaml").read_text(encoding="utf-8")
    rules: list[dict[str, Any]] = YAML(typ="safe", pure=True).load(text)
    return rules


def draw_separation(found: Sequence[Found]) -> Figure:
    """How right and wrong first hypotheses separate, by SM and by the posterior."""
    right = np.array([one.right for one in found])
    figure, axes = plt.subplots(1, 2, figsize=(12, 3.8), layout="constrained")
    limit = next(rule["accept"]["provisional"] for rule in default_rules() if rule["accept"]["use"] == "posterior")
    columns = (
        (np.array([one.similarity for one in found]), "SM, the paper's share of equal cells", 0.9, "the paper's limit"),
        (
            np.array([one.log_odds for one in found]),
            "log-odds of the posterior",
            np.log(limit / (1.0 - limit)),
            f"p = {limit:g}",
        ),
    )
    for ax, (values, name, limit, said) in zip(axes, columns, strict=True):
        least = max(float(np.nanmin(values)), LEAST_SIMILARITY if ax is axes[0] else -np.inf)
        bins = np.linspace(least, float(np.nanmax(values)), 45)
        for which, colour, label in ((~right, ORANGE, "wrong"), (right, BLUE, "right")):
            ax.hist(values[which], bins=bins, color=colour, alpha=0.75, label=f"{label} ({which.sum()})")
        ax.axvline(limit, color=RED, linewidth=1.2)
        ax.set_ylim(top=1.15 * ax.get_ylim()[1])
        ax.text(limit, 0.98, f" {said}", color=RED, transform=ax.get_xaxis_transform(), va="top", fontsize=9)
        ax.set_xlabel(name)
        ax.set_ylabel("first hypotheses")
        ax.legend(fontsize=9, loc="upper left")
    below = int((columns[0][0] < LEAST_SIMILARITY).sum())
    axes[0].set_title(f"{below} more are below {LEAST_SIMILARITY}", fontsize=10, loc="left")
    return figure


def draw_test() -> Figure:
    """The log-odds that a merge is wrong, as new evidence comes in: the demo, with every look written down."""
    rules = default_rules()
    for rule in rules:
        rule["verify"]["log"]["every"] = rule["verify"]["every"]
    events = mapgraft.run(config={"rules": rules}).events
    test, wanted = Sequential(), {"alpha.bravo.1": ORANGE, "alpha.bravo.2": BLUE, "charlie.bravo.2": "#009E73"}
    figure, ax = plt.subplots(figsize=(12, 4.2), layout="constrained")
    for merge_id, colour in wanted.items():
        mine = [event for event in events if event.merge_id == merge_id and event.measurements]
        first_s = events[0].stamp_ns / 1e9 - FIRST_MEETING_S
        times_s = np.array([event.stamp_ns / 1e9 for event in mine]) - first_s
        values = [log_odds(test, mine[0], event) for event in mine]
        said = "wrong" if mine[-1].state == "reverted" else "right"
        ax.step(times_s, values, where="post", color=colour, linewidth=1.8, label=f"{merge_id}, {said}")
        for event in events:
            if event.merge_id == merge_id and event.kind in ("merged", "confirmed", "reverted"):
                at = event.stamp_ns / 1e9 - first_s
                value = values[0] if event.kind == "merged" else log_odds(test, mine[0], event)
                ax.plot(at, value, MARKS[event.kind], color=colour, markersize=9)
                ax.annotate(
                    event.kind, (at, value), xytext=(6, 5), textcoords="offset points", fontsize=9, color=colour
                )
    for limit, name in ((test.upper, "reverted above"), (test.lower, "confirmed below")):
        ax.axhline(limit, color=GREY, linewidth=1.0, linestyle="--")
        ax.text(
            1.0, limit, f"{name} {limit:.1f} ", transform=ax.get_yaxis_transform(), ha="right", va="bottom", fontsize=9
        )
    ax.set_yscale("symlog", linthresh=20.0)
    ax.set_ylim(-400.0, 200.0)
    ax.set_xlabel("seconds of the demo")
    ax.set_ylabel("log-odds that the merge is wrong")
    ax.legend(fontsize=9, loc="lower left")
    return figure


def log_odds(test: Sequential, first: Event, now: Event) -> float:
    """As ``sequential`` counts them: from the posterior at the merge, and the blocks that spoke since."""
    at_merge = next(m for m in first.measurements if m.name == "posterior").value
    news = next((m for m in now.measurements if m.name == "news"), None)
    start = float(np.clip(-np.log(at_merge / (1.0 - at_merge)), -test.prior_max, test.prior_max))
    if news is None:
        return start
    return start + news.details["against"] * test.if_against + news.details["agreed"] * test.if_agreed


def main() -> None:
    found = list(found_pairs())
    usable = [one for one in found if one.right and 0.3 <= one.pair.overlap <= 0.6 and squareness(one) > 0.6]
    distinct = max(usable, key=lambda one: one.match.margin)
    corridor = max(usable, key=lambda one: one.match.score - one.match.margin)
    accident = max((one for one in found if one.pair.plan.across and one.paths > 4), key=lambda one: one.match.score)
    figures = {
        "maps": draw_maps(distinct),
        "search": draw_search(corridor),
        "accident": draw_accident(accident),
        "separation": draw_separation(found),
        "test": draw_test(),
    }
    for name, figure in figures.items():
        figure.savefig(FOLDER / f"matching_{name}.png", dpi=80, metadata={"Software": None})


if __name__ == "__main__":
    main()

"""What a calibration looks like: curves with the chosen points, reliability, and how thresholds move."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mapgraft.calibrate.acceptance import acceptance, accepted
from mapgraft.calibrate.fitting import Fit, RuleFit
from mapgraft.calibrate.labelled import Labelled
from mapgraft.calibrate.plots import Box, Dot, Frame, Line, Mark, Plot, plot, said
from mapgraft.calibrate.rates import Rate
from mapgraft.calibrate.rules import written

RIGHT, WRONG, PLAIN = "right", "wrong", "plain"
_BINS = 36
_SWEEP = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
_WHOLE = (0.0, 1.0)
_SMALL = 0.1  # of wrong ones: above that nobody would set a threshold


def charts(rule_fit: RuleFit, setting: Sequence[Labelled]) -> list[Plot]:
    """All drawings of one rule; those without anything to show are left out."""
    drawn = (
        _scores(rule_fit, setting),
        _operating(rule_fit, _WHOLE, "ROC: all thresholds"),
        _operating(rule_fit, (0.0, _SMALL), "ROC: where thresholds are set"),
        _precision(rule_fit),
        _reliability(rule_fit),
        _price(rule_fit, setting),
        _by_resolution(rule_fit),
        _by_quality(rule_fit),
        _by_overlap(rule_fit),
    )
    return [one for one in drawn if one is not None]


def _chosen(rule_fit: RuleFit) -> list[Fit]:
    return [fit for fit in written(rule_fit) if math.isfinite(fit.accept.value)]


def _scores(rule_fit: RuleFit, setting: Sequence[Labelled]) -> Plot | None:
    known = [example for example in setting if example.right is not None]
    scores = rule_fit.score.all(known)
    finite = scores[np.isfinite(scores)]
    if not finite.size:
        return None
    low, high = (float(v) for v in np.quantile(finite, (0.005, 0.995)))
    edges = np.linspace(low, max(high, low + 1e-9), _BINS + 1)
    boxes = []
    for kind, tone in ((False, WRONG), (True, RIGHT)):
        here = np.array([e.right is kind for e in known]) & np.isfinite(scores)
        counts, _ = np.histogram(np.clip(scores[here], low, high), edges)
        share = counts / max(1, int(here.sum()))
        boxes += [Box(float(edges[n]), float(edges[n + 1]), float(share[n]), tone) for n in range(_BINS)]
    marks = [
        Mark(fit.accept.value, PLAIN, f"threshold {said(fit.accept.value)}, {fit.group.name}")
        for fit in _chosen(rule_fit)
    ]
    caption = (
        "Shares of the right (blue) and of the wrong (orange) hypotheses; dashed: the thresholds. Ends hold the rest."
    )
    return plot(Frame("Scores", caption, rule_fit.score.name[:60], "share", percent=True), boxes=boxes, marks=marks)


def _operating(rule_fit: RuleFit, across: tuple[float, float], title: str) -> Plot | None:
    points = [(point.wrong, point.right) for point in rule_fit.quality.points if point.wrong <= across[1]]
    dots = [_rate_dot(fit.wrong.value, fit.right, PLAIN, fit) for fit in _chosen(rule_fit) if fit.wrong.of]
    dots = [dot for dot in dots if dot.x <= across[1]]
    area = rule_fit.quality.area
    caption = (
        f"Right over wrong hypotheses accepted, all groups together; area {area.value:.3f} ({area.low:.3f} to "
        f"{area.high:.3f}). Points: chosen, each on the labels of its own group, with 95 % intervals."
    )
    frame = Frame(title, caption, "share of wrong ones accepted", "of right ones", x=across, y=_WHOLE, percent=True)
    return plot(frame, lines=[Line(points, RIGHT)], dots=dots)


def _precision(rule_fit: RuleFit) -> Plot | None:
    points = [(point.right, point.precision) for point in rule_fit.quality.points[1:]]
    dots = []
    for fit in _chosen(rule_fit):
        took = fit.right.count + fit.wrong.count
        if took:
            dots.append(Dot(fit.right.value, fit.right.count / took, PLAIN, _title(fit)))
    caption = (
        "How many of what is accepted are right, by how many of the right ones are accepted, in the labels' mixture."
    )
    frame = Frame(
        "Precision and recall", caption, "share of right ones accepted", "right", x=_WHOLE, y=_WHOLE, percent=True
    )
    return plot(frame, lines=[Line(points, RIGHT)], dots=dots)


def _reliability(rule_fit: RuleFit) -> Plot | None:
    honesty = rule_fit.quality.honesty
    if honesty is None:
        return None
    dots = []
    for one in honesty.bins:
        rate = Rate.counted(one.right, one.of)
        dots.append(Dot(one.said, rate.value, RIGHT, f"said {said(one.said)}: right {rate.text}", rate.low, rate.high))
    caption = (
        f"Of each building by a curve of the others: {honesty.examples} examples, Brier score {honesty.brier:.3f} (the "
        f"share alone {honesty.brier_of_share:.3f}), log loss {honesty.log_loss:.3f} ({honesty.log_loss_of_share:.3f})."
    )
    frame = Frame(
        "Reliability", caption, "probability of being right, as said", "right", x=_WHOLE, y=_WHOLE, percent=True
    )
    return plot(frame, lines=[Line([(0.0, 0.0), (1.0, 1.0)], PLAIN, dashed=True)], dots=dots)


def _price(rule_fit: RuleFit, setting: Sequence[Labelled]) -> Plot | None:
    """What a promised rate costs in right ones: the coarsest group, rate by rate."""
    group = rule_fit.fits[-1].group
    right: list[tuple[float, Rate]] = []
    wrong: list[tuple[float, Rate]] = []
    for rate in _SWEEP:
        limit = acceptance(setting, rule_fit.score, group, rate)
        same = {example.group: limit for example in setting}
        for kind, out in ((True, right), (False, wrong)):
            out.append((math.log10(rate), accepted(setting, rule_fit.score, same, right=kind)))
    dots = [
        Dot(x, r.value, RIGHT, f"{100 * 10**x:.2g} % promised: right {r.text}", r.low, r.high) for x, r in right if r.of
    ]
    lines = [
        Line([(x, r.value) for x, r in right if r.of], RIGHT, "right ones accepted"),
        Line([(x, r.value) for x, r in wrong if r.of], WRONG, "wrong ones accepted", dashed=True),
    ]
    caption = "Shares accepted by what is promised, all groups together, on the labels that set the thresholds."
    names = ", ".join(f"{100 * rate:g}" for rate in _SWEEP)
    frame = Frame(
        "What a promise costs",
        f"{caption} Rates: {names} %.",
        "log10 of the promised rate",
        "accepted",
        y=_WHOLE,
        percent=True,
    )
    return plot(frame, lines=lines, dots=dots)


def _by_resolution(rule_fit: RuleFit) -> Plot | None:
    fits = rule_fit.finest
    dots, names = [], []
    for place, fit in enumerate(fits):
        own, other = (said(m) if m else "–" for m in (fit.group.own_m, fit.group.other_m))
        names.append(f"{own} ← {other}")
        if math.isfinite(fit.accept.value):
            whose = "own labels" if fit.accept.own else "labels of a coarser group"
            dots.append(
                Dot(float(place), fit.accept.value, RIGHT if fit.accept.own else PLAIN, f"{_title(fit)}, {whose}")
            )
        cells = [cell for cell in fit.accept.cells if fit.accept.own and cell.value is not None]
        dots += [
            Dot(place + 0.18, c.value or 0.0, WRONG, f"{c.environment} alone: {said(c.value or 0.0)}") for c in cells
        ]
    caption = "Blue: the threshold of each group (grey: of a coarser one). Orange: what single buildings would set."
    return plot(Frame("Thresholds by resolution", caption, "receiver ← donor, m", "score", x_names=names), dots=dots)


def _by_quality(rule_fit: RuleFit) -> Plot | None:
    names = [name for name, _ in rule_fit.by_quality]
    dots = [
        Dot(float(n), limit.value, RIGHT, f"{name}: {said(limit.value)}, {limit.wrong} wrong")
        for n, (name, limit) in enumerate(rule_fit.by_quality)
        if math.isfinite(limit.value)
    ]
    if not dots:
        return None
    caption = (
        "The threshold that each third of the wrong hypotheses would set, by the quality of the worse of both maps."
    )
    return plot(Frame("Thresholds by quality", caption, "quality", "score", x_names=names), dots=dots)


def _by_overlap(rule_fit: RuleFit) -> Plot | None:
    chosen = _chosen(rule_fit)
    if not chosen:
        return None
    fit = next((f for f in chosen if not f.group.resolutions), chosen[-1])
    names = [name for name, _ in fit.overlaps]
    dots = [
        Dot(float(n), rate.value, RIGHT, f"overlap {name}: {rate.text}", rate.low, rate.high)
        for n, (name, rate) in enumerate(fit.overlaps)
        if rate.of
    ]
    caption = f"Right hypotheses accepted, by the true overlap of the two maps: {fit.group.name}."
    return plot(
        Frame("Right ones by overlap", caption, "overlap", "accepted", y=_WHOLE, x_names=names, percent=True), dots=dots
    )


def _rate_dot(x: float, rate: Rate, tone: str, fit: Fit) -> Dot:
    return Dot(x, rate.value, tone, _title(fit), rate.low, rate.high)


def _title(fit: Fit) -> str:
    return f"{fit.group.name}: above {said(fit.accept.value)}, wrong {fit.wrong.text}, right {fit.right.text}"

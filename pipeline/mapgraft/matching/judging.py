"""Whether the answers to pairs with a known truth are right."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mapgraft.contracts import MapError, Points, Transform
from mapgraft.errors import UsageError
from mapgraft.evaluation.certainty import certainty, walls_middle
from mapgraft.evaluation.scored import Placed, Scored, better_of, numbers_of
from mapgraft.evaluation.statistics import resampled
from mapgraft.evaluation.summary import Summary, Times, summarize, times_of
from mapgraft.evaluation.truth import Truth
from mapgraft.matching.pair_list import MapFile, PairList, TruePair
from mapgraft.matching.pairing import Hypothesis, Pairer, Pairing
from mapgraft.matching.pixels import Frame, Similarity, in_metres, in_pixels, moved, planar, scale_of, yaw_of
from mapgraft.matching.placing import in_type_of
from mapgraft.matching.ready_map import ReadyMap

SEED = 0  # of the resampling
RIGHT_PX = 40.0  # root mean square of the keypoints' errors
_SAME_SCALE = 0.1  # relative: a truth whose scale differs more is of a map whose resolution is not known

Read = Callable[[MapFile, int], ReadyMap]  # a file of the list and which side it is on, 0 or 1


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One pair of a list with what came of it, and how that holds against the truth.

    What ``scored`` calls across are unrelated pairs, where every hypothesis is wrong.
    """

    pair: TruePair
    pairing: Pairing
    scored: Scored


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A pair that was not judged, and why."""

    id: str
    reason: str


def judge(
    pairs: Sequence[TruePair], listed: PairList, read: Read, pairer: Pairer, right_px: float, done: Callable[[], None]
) -> tuple[list[Judged], list[LeftOut]]:
    """Match all pairs, one after another, and compare each answer with its truth; ``done`` is called after each.

    All files are read before anything is matched. The first match is made twice, because kernels are compiled on first
    use. Raises MapError when a file cannot be used, UsageError when pixels are told of maps that have none.
    """
    maps = [(read(listed.known(pair.a), 0), read(listed.known(pair.b), 1)) for pair in pairs]
    out: list[Judged] = []
    left: list[LeftOut] = []
    for pair, (a, b) in zip(pairs, maps, strict=True):
        reason = _not_judged(pair, a, b)
        if reason is not None:
            left.append(LeftOut(pair.id, reason))
        else:
            if not out:
                pairer.pair(a, b, fuse=False)
            out.append(_judged(pair, pairer.pair(a, b, fuse=False), pairer, right_px))
        done()
    return out, left


def summed_up(judged: Sequence[Judged]) -> tuple[Summary, Times]:
    """What ``mapgraft evaluate`` counts; intervals are by bootstrap over the map files: one file is in many pairs."""
    files: dict[Path, int] = {}
    blocks = [[files.setdefault(path, len(files)) for path in (j.pair.a.path, j.pair.b.path)] for j in judged]
    scored = [one.scored for one in judged]
    return summarize(scored, resampled(np.array(blocks, np.int64).reshape(-1, 2), SEED)), times_of(scored)


def _judged(pair: TruePair, pairing: Pairing, pairer: Pairer, right_px: float) -> Judged:
    truth = None if pair.kind == "unrelated" else _truth(pair, pairing, pairer)
    place = _placing(pair, pairing, truth, right_px)
    first = pairing.hypotheses[0] if pairing.hypotheses else None
    measured = {} if first is None else {m.name: m for m in first.measurements or ()}
    b = pairing.b
    sure = None if first is None else certainty(first.match, walls_middle(truth, b.map_type, b.view))
    scored = Scored(
        overlap=None if truth is None else truth.overlap,
        verdict=pairing.verdict,
        reason=pairing.reason,
        rule="" if pairing.ruling.rule is None else pairing.ruling.rule.name,
        best=None if first is None else place(first),
        numbers={} if first is None else numbers_of(first.match, measured),
        better=better_of(measured),
        accepted=None if pairing.accepted is None else place(pairing.accepted),
        sigma_max_m=None if sure is None else sure.sigma_max_m,
        match_s=None if pairing.verdict == "rejected" else pairing.match_s,
    )
    return Judged(pair, dataclasses.replace(pairing, merged=None), scored)


def _placing(pair: TruePair, pairing: Pairing, truth: Truth | None, right_px: float) -> Callable[[Hypothesis], Placed]:
    """What holds a hypothesis against the truth: keypoints where there are any, else the walls."""

    def by_walls(hypothesis: Hypothesis) -> Placed:
        return Placed.of(hypothesis.match.T_receiver_donor, hypothesis.match.scale, truth)

    if pair.keypoints is None or truth is None:
        return by_walls
    frames, (ours, theirs) = _frames(pair, pairing.a, pairing.b), pair.keypoints

    def by_keypoints(hypothesis: Hypothesis) -> Placed:
        T = in_pixels(*frames, _similarity(hypothesis))
        off_px = float(np.sqrt((np.linalg.norm(moved(T, theirs) - ours, axis=1) ** 2).mean()))
        return dataclasses.replace(
            by_walls(hypothesis),
            right=off_px <= right_px,
            error_m=None,
            error_deg=_turn_deg(pair, T),
            error_px=off_px,
        )

    return by_keypoints


def _truth(pair: TruePair, pairing: Pairing, pairer: Pairer) -> Truth:
    a, b = pairing.a, pairing.b
    layer = in_type_of(pairer.workshop, a, b)
    if layer is None:
        raise MapError(f"{pair.id} cannot be judged: no conversion leads from {b.map_type.name} to {a.map_type.name}")
    S = in_metres(*_frames(pair, a, b), _of(pair))
    walls = np.asarray(b.map_type.structure(b.view)[:, :2], np.float64)
    scale = 1.0 if a.metadata.scale_known and b.metadata.scale_known else scale_of(S)
    return Truth.of(a.map_type, a.view, layer, rigid_about(S, walls.mean(axis=0), scale), scale)


def rigid_about(S: Similarity, centre_m: Points, scale: float = 1.0) -> Transform:
    """The rotation and shift nearest to a similarity of about that scale where the points around a centre are."""
    turn = Transform.planar(0.0, 0.0, yaw_of(S))
    shift = moved(S, centre_m[None])[0] - turn.apply(scale * centre_m[None])[0]
    return Transform.planar(float(shift[0]), float(shift[1]), yaw_of(S))


def _not_judged(pair: TruePair, a: ReadyMap, b: ReadyMap) -> str | None:
    if pair.suspect:
        return "the list calls its truth suspect"
    if pair.kind == "unrelated" or not (a.metadata.scale_known and b.metadata.scale_known):
        return None
    scale = scale_of(in_metres(*_frames(pair, a, b), _of(pair)))
    if abs(math.log(scale)) > math.log1p(_SAME_SCALE):
        return f"the truth makes B {scale:.2f} times as large as its resolution does: its scale is not known"
    return None


def _frames(pair: TruePair, a: ReadyMap, b: ReadyMap) -> tuple[Frame, Frame]:
    if a.image is None or b.image is None:
        raise UsageError(f"the truth of {pair.id} is told in pixels, and one of its maps has none")
    return a.image, b.image


def _of(pair: TruePair) -> Similarity:
    if pair.T_px_a_b is None:
        raise UsageError(f"{pair.id} tells no transform")
    return pair.T_px_a_b


def _similarity(hypothesis: Hypothesis) -> Similarity:
    return planar(hypothesis.match.T_receiver_donor, hypothesis.match.scale)


def _turn_deg(pair: TruePair, T: Similarity) -> float:
    difference = yaw_of(T) - yaw_of(_of(pair))
    return abs(math.degrees(math.atan2(math.sin(difference), math.cos(difference))))

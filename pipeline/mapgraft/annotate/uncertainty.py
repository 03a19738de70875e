"""How uncertain the outcome of an attempt was: how much a person's word on it can tell."""

from __future__ import annotations

from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

PROBABILITY: Final = "posterior"  # the evidence that is a probability of being right
COLUMNS: Final = ("rule", "matcher", "verdict", "state", "score", "evidence")
MERGED: Final = "provisional"
OPEN: Final = 0.9  # at least, where the robot could not decide, or decided twice


def uncertainty(rows: pa.Table) -> NDArray[np.float64]:
    """A number between 0 (certain) and 1 (as good as a coin) for every example, (n,); rows have ``COLUMNS``.

    Where a probability of being right was measured, p, it is 1 − |2p − 1|. Elsewhere scores of the same rule and
    matcher are ranked: it is 1 where those that were merged begin, and falls to 0 at the surest on either side. An
    attempt that came out ambiguous, and a merge that was reverted, count as uncertain whatever their numbers.
    """
    probabilities = probability(rows["evidence"])
    found = 1.0 - np.abs(2.0 * np.clip(probabilities, 0.0, 1.0) - 1.0)
    scores = rows["score"].to_numpy().astype(np.float64)
    merged = np.asarray(rows["verdict"].to_pylist(), object) == MERGED
    groups = list(zip(rows["rule"].to_pylist(), rows["matcher"].to_pylist(), strict=True))
    for group in sorted(set(groups), key=str):
        members = np.array([n for n, of in enumerate(groups) if of == group and np.isnan(found[n])], np.int64)
        if members.size:
            found[members] = _about_boundary(scores[members], merged[members])
    open_ = [
        verdict == "ambiguous" or state == "reverted"
        for verdict, state in zip(rows["verdict"].to_pylist(), rows["state"].to_pylist(), strict=True)
    ]
    found[open_] = np.maximum(found[open_], OPEN)
    return found


def probability(evidence: pa.ChunkedArray) -> NDArray[np.float64]:
    """The measured probability of being right of every example, NaN where there is none, (n,)."""
    whole = evidence.combine_chunks()
    pairs = whole.flatten()
    wanted = pc.equal(pairs.field("name"), PROBABILITY)
    parents = pc.filter(pc.list_parent_indices(whole), wanted).to_numpy(zero_copy_only=False)
    out = np.full(len(whole), np.nan)
    out[parents] = pc.filter(pairs.field("value"), wanted).to_numpy(zero_copy_only=False)
    return out


def _about_boundary(scores: NDArray[np.float64], merged: NDArray[np.bool_]) -> NDArray[np.float64]:
    """1 where, in the order of scores, those that were merged begin; 0 at the farthest; examples without a score 0."""
    known = np.isfinite(scores)
    out, count = np.zeros(len(scores)), int(known.sum())
    if count:
        ranks = np.empty(count)
        ranks[np.argsort(scores[known], kind="stable")] = np.arange(count)
        boundary = count - int(merged[known].sum()) - 0.5
        farthest = max(boundary, count - 1 - boundary, 0.5)
        out[known] = np.clip(1.0 - (np.abs(ranks - boundary) - 0.5) / farthest, 0.0, 1.0)
    return out

"""Single deviations: pieces of wall that are missing, added or displaced."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Finding
from mapgraft_floorplan.standing import ADDED, DISPLACED, LEAST_M, MISSING, Differences

MOST: Final = 2_000
_NAMES: Final = {MISSING: "wall missing", DISPLACED: "wall displaced", ADDED: "wall added"}
_BRIDGED_M: Final = 0.12


def findings_of(found: Differences) -> tuple[Finding, ...]:
    """One for each connected piece of at least half a metre, longest first: its two ends, and how long or how far off.

    ``value`` is metres: the length of a missing or added wall, how far off a displaced one stands.
    """
    out = []
    for kind in (MISSING, DISPLACED, ADDED):
        cells = found.robot == kind if kind == ADDED else found.plan == kind
        out += _pieces(cells, found, kind)
    out.sort(key=lambda pair: (-pair[0], pair[1].kind, pair[1].start_m))
    return tuple(finding for _, finding in out[:MOST])


def _pieces(cells: NDArray[np.bool_], found: Differences, kind: int) -> list[tuple[float, Finding]]:
    import cv2

    reach = 2 * max(1, round(_BRIDGED_M / found.unit_m)) + 1
    joined = cv2.dilate(cells.astype(np.uint8), np.ones((reach, reach), np.uint8))
    count, labels = cv2.connectedComponents(joined, connectivity=8)
    rows, columns = np.nonzero(cells)
    label = labels[rows, columns]
    order = np.argsort(label, kind="stable")
    bounds = np.searchsorted(label[order], np.arange(1, count + 1))
    out = []
    for low, high in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        part = order[low:high]
        points = np.stack((columns[part], rows[part]), axis=1) + 0.5
        centred = points - points.mean(axis=0)
        _, _, axes = np.linalg.svd(centred.T @ centred) if len(points) > 1 else (0, 0, np.eye(2))
        along = centred @ axes[0]
        length_m = float(np.ptp(along) + 1.0) * found.unit_m
        if length_m < LEAST_M:
            continue
        ends = points.mean(axis=0) + np.outer((along.min(), along.max()), axes[0])
        ends_m = ends * found.unit_m + np.array(found.origin_m)
        off_m = found.off_m[rows[part], columns[part]]
        value = float(np.median(off_m)) if kind == DISPLACED else length_m
        (x0, y0), (x1, y1) = np.round(ends_m, 3).tolist()
        finding = Finding(_NAMES[kind], (x0, y0, 0.0), (x1, y1, 0.0), round(value, 3), "m")
        out.append((length_m, finding))
    return out

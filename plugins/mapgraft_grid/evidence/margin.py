"""The margin of a match as a metric: how far its score lies above that of the best other hypothesis."""

from __future__ import annotations

import math

from mapgraft.contracts import Anew, Comparison, Measurement


class Margin:
    """The match's margin, in the unit of its score; of a merge that was registered anew, that of its acceptance.

    The value is NaN where there was no other hypothesis. The support is 1 when there was one.
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _margin)


def _margin(comparison: Comparison) -> Measurement:
    margin = comparison.match.margin
    alone = math.isinf(margin)
    return Measurement("margin", math.nan if alone else margin, "score", int(not alone), "higher")

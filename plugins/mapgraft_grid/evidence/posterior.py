"""The probability that a match is right, from all the evidence there is."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mapgraft.contracts import Anew, Comparison, Measurement
from mapgraft_grid.evidence.features import features_of
from mapgraft_grid.evidence.joint import standing_of
from mapgraft_standard.regression import models_of, posterior

MODEL_FILE: Final = Path(__file__).with_name("posterior_model.json")


class Posterior:
    """P(right | evidence) of a placement by logistic regression on all that is known of it (see ``features``).

    There is one regression for each kind of evidence that may be missing: the margin over the best other hypothesis,
    which not every matcher tells, and the traces of beams and paths, which ready-made maps do not have; the one that
    uses most of what there is is taken. ``model`` is a file with other coefficients, as ``fit_posterior`` writes it.

    The value is NaN when the maps have no wall where both know something. The support is the number of jointly known
    cells. Details: ``log_odds``, and the features.
    """

    def __init__(self, *, model: str | None = None) -> None:
        self.models = models_of(Path(model) if model else MODEL_FILE, "posterior")

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, self._measured)

    def _measured(self, comparison: Comparison) -> Measurement:
        features = features_of(comparison)
        support = int(standing_of(comparison, "posterior").table.sum())
        return posterior("posterior", self.models, features, support)

"""The probability that a match of two maps of line segments is right."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mapgraft.contracts import Anew, Comparison, Measurement
from mapgraft_lines.evidence.features import features_of
from mapgraft_lines.evidence.standing import standing_of
from mapgraft_lines.kernels.explaining import STEP_M
from mapgraft_standard.regression import models_of, posterior

MODEL_FILE: Final = Path(__file__).with_name("posterior_model.json")


class LinePosterior:
    """P(right | evidence) of a placement by logistic regression on what is known of it (see ``features``).

    There is one regression with and one without the margin over the best other hypothesis; the one that uses most of
    what there is is taken. They were fitted on simulated buildings. ``model`` is a file with other coefficients, as
    ``fit_line_posterior`` writes it. The value is NaN when no wall lies where the other map knows something; the
    support is the length of those that do, in pieces of 0.1 m. Details: ``log_odds``, and the features.
    """

    def __init__(self, *, model: str | None = None) -> None:
        self.models = models_of(Path(model) if model else MODEL_FILE, "line_posterior")

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, self._measured)

    def _measured(self, comparison: Comparison) -> Measurement:
        features = features_of(comparison)
        support = round(standing_of(comparison).joint_m / STEP_M)
        return posterior("line_posterior", self.models, features, support)

"""The probability that a match is right, from all the evidence there is."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from mapgraft.contracts import Anew, Comparison, ConfigError, Measurement
from mapgraft_grid.evidence.features import features_of
from mapgraft_grid.evidence.joint import standing_of

MODEL_FILE: Final = Path(__file__).with_name("posterior_model.json")


@dataclass(frozen=True, slots=True)
class Model:
    """A logistic regression on some of the features."""

    coefficients: Mapping[str, float]
    intercept: float

    def log_odds(self, features: Mapping[str, float]) -> float:
        return self.intercept + math.fsum(c * features[name] for name, c in self.coefficients.items())


class Posterior:
    """P(right | evidence) of a placement by logistic regression on all that is known of it (see ``features``).

    There is one regression for each kind of evidence that may be missing: the margin over the best other hypothesis,
    which not every matcher tells, and the traces of beams and paths, which ready-made maps do not have; the one that
    uses most of what there is is taken. ``model`` is a file with other coefficients, as ``fit_posterior`` writes it.

    The value is NaN when the maps have no wall where both know something. The support is the number of jointly known
    cells. Details: ``log_odds``, and the features.
    """

    def __init__(self, *, model: str | None = None) -> None:
        self.models = models(Path(model) if model else MODEL_FILE)

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, self._measured)

    def _measured(self, comparison: Comparison) -> Measurement:
        features = features_of(comparison)
        support = int(standing_of(comparison, "posterior").table.sum())
        usable = [model for model in self.models if model.coefficients.keys() <= features.keys()]
        if not usable:
            return Measurement("posterior", math.nan, "1", support, "higher")
        log_odds = max(usable, key=lambda model: len(model.coefficients)).log_odds(features)
        details = {"log_odds": log_odds, **features}
        return Measurement("posterior", probability(log_odds), "1", support, "higher", details)


def probability(log_odds: float) -> float:
    """The probability of natural log-odds."""
    return 1.0 / (1.0 + math.exp(-log_odds)) if log_odds > -700.0 else 0.0


@cache
def models(path: Path) -> tuple[Model, ...]:
    """The regressions of a file; raises ConfigError when it cannot be read."""
    try:
        found: Any = json.loads(path.read_text(encoding="utf-8"))
        return tuple(
            Model({str(n): float(c) for n, c in one["coefficients"].items()}, float(one["intercept"]))
            for one in found["models"]
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"the model {path} of the metric posterior cannot be read ({error}): fit one") from error

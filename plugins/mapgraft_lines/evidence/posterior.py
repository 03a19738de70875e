"""The probability that a match of two maps of line segments is right."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from mapgraft.contracts import Anew, Comparison, ConfigError, Measurement
from mapgraft_lines.evidence.features import features_of
from mapgraft_lines.evidence.standing import standing_of
from mapgraft_lines.kernels.explaining import STEP_M

MODEL_FILE: Final = Path(__file__).with_name("posterior_model.json")


@dataclass(frozen=True, slots=True)
class Model:
    """A logistic regression on some of the features."""

    coefficients: Mapping[str, float]
    intercept: float

    def log_odds(self, features: Mapping[str, float]) -> float:
        return self.intercept + math.fsum(c * features[name] for name, c in self.coefficients.items())


class LinePosterior:
    """P(right | evidence) of a placement by logistic regression on what is known of it (see ``features``).

    There is one regression with and one without the margin over the best other hypothesis; the one that uses most of
    what there is is taken. They were fitted on simulated buildings. ``model`` is a file with other coefficients, as
    ``fit_line_posterior`` writes it. The value is NaN when no wall lies where the other map knows something; the
    support is the length of those that do, in pieces of 0.1 m. Details: ``log_odds``, and the features.
    """

    def __init__(self, *, model: str | None = None) -> None:
        self.models = models(Path(model) if model else MODEL_FILE)

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, self._measured)

    def _measured(self, comparison: Comparison) -> Measurement:
        features = features_of(comparison)
        support = round(standing_of(comparison).joint_m / STEP_M)
        usable = [model for model in self.models if model.coefficients.keys() <= features.keys()]
        if not usable:
            return Measurement("line_posterior", math.nan, "1", support, "higher")
        log_odds = max(usable, key=lambda model: len(model.coefficients)).log_odds(features)
        details = {"log_odds": log_odds, **features}
        return Measurement("line_posterior", probability(log_odds), "1", support, "higher", details)


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
        raise ConfigError(f"the model {path} of line_posterior cannot be read ({error}): fit one") from error

"""Logistic regression on evidence: models that were fitted elsewhere, and the probability that they give."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from mapgraft.contracts import ConfigError, Measurement


@dataclass(frozen=True, slots=True)
class Model:
    """A logistic regression on some of the features."""

    coefficients: Mapping[str, float]
    intercept: float

    def log_odds(self, features: Mapping[str, float]) -> float:
        return self.intercept + math.fsum(c * features[name] for name, c in self.coefficients.items())


def posterior(name: str, models: Sequence[Model], features: Mapping[str, float], support: int) -> Measurement:
    """The probability by the model that uses most of the features there are; NaN where no model has all of its own.

    Details: ``log_odds`` (natural), and the features.
    """
    usable = [model for model in models if model.coefficients.keys() <= features.keys()]
    if not usable:
        return Measurement(name, math.nan, "1", support, "higher")
    log_odds = max(usable, key=lambda model: len(model.coefficients)).log_odds(features)
    return Measurement(name, probability(log_odds), "1", support, "higher", {"log_odds": log_odds, **features})


def probability(log_odds: float) -> float:
    """The probability of natural log-odds."""
    return 1.0 / (1.0 + math.exp(-log_odds)) if log_odds > -700.0 else 0.0


@cache
def models_of(path: Path, metric: str) -> tuple[Model, ...]:
    """The regressions of a file, as the fitting scripts write them; raises ConfigError when it cannot be read."""
    try:
        found: Any = json.loads(path.read_text(encoding="utf-8"))
        return tuple(
            Model({str(n): float(c) for n, c in one["coefficients"].items()}, float(one["intercept"]))
            for one in found["models"]
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"the model {path} of the metric {metric} cannot be read ({error}): fit one") from error

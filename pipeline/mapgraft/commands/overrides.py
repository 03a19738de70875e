"""Options of the command line that go before the configuration file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from mapgraft.config import Config, parse_config
from mapgraft.errors import UsageError


@dataclass(frozen=True, slots=True)
class Overrides:
    """What was said on the command line; None or empty where nothing was."""

    start_s: float | None = None
    end_s: float | None = None
    every: int | None = None
    reversal: str | None = None
    priors: tuple[str, ...] = ()
    forbidden: tuple[str, ...] = ()
    report: bool | None = None
    examples: bool | None = None

    def apply(self, config: Config) -> Config:
        """The configuration with the options in place; raises UsageError or ConfigError when one does not fit."""
        content = config.model_dump()
        mission: dict[str, Any] = {"start_s": self.start_s, "end_s": self.end_s, "every": self.every}
        content["mission"] |= {name: value for name, value in mission.items() if value is not None}
        if self.reversal is not None:
            content["reversal"] = self.reversal
            for robot in content["robots"].values():
                robot["reversal"] = self.reversal
        if self.report is not None:
            content["output"]["report"] = self.report
        if self.examples is not None:
            content["output"]["examples"] = self.examples
        content["priors"] += [parse_prior(text) for text in self.priors]
        content["forbid"] += [parse_pair("--forbid", text) for text in self.forbidden]
        return parse_config(content, origin="the command line")


def parse_prior(text: str) -> dict[str, Any]:
    """``RECEIVER,DONOR=X,Y,YAW`` in metres and radians."""
    pair, separator, pose = text.partition("=")
    try:
        x_m, y_m, yaw_rad = map(float, pose.split(","))
    except ValueError:
        separator = ""
        x_m = y_m = yaw_rad = math.nan
    if not separator or not all(map(math.isfinite, (x_m, y_m, yaw_rad))):
        raise UsageError(f"--prior wants RECEIVER,DONOR=X,Y,YAW in metres and radians, found {text!r}")
    receiver, donor = parse_pair("--prior", pair)
    return {"receiver": receiver, "donor": donor, "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad}


def parse_pair(option: str, text: str) -> tuple[str, str]:
    """``A,B``: two different robots."""
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names) or names[0] == names[1]:
        raise UsageError(f"{option} wants two robots, A,B, found {text!r}")
    return names[0], names[1]

"""Verifying a merge by a sequential test on what is new since it was made."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from mapgraft.contracts import ConfigError, Measurement, PluginError, Sample, Verdict
from mapgraft_standard.limits import mapping_of
from mapgraft_standard.rendezvous import NAME, REFUTED, TELLING, told_by

REVERSALS = ("ledger", "multi_map", "single_map")


class Sequential:
    """Wald's sequential probability ratio test of a merge, on evidence that its transform was not chosen on.

    The metric ``news`` tells how many independent pieces of new evidence speak for the merge (its detail ``agreed``)
    and ``against`` it. A piece is against a right merge with probability ``against_right`` and against a wrong one with
    ``against_wrong``, so that each moves the log-odds Λ that the merge is wrong. Λ starts from what the metric
    ``prior`` (a probability that the merge is right) said when it was accepted, but no surer than ``prior_max`` nats;
    where robots saw each other, that is evidence of its own, and the nats of ``rendezvous`` are taken off Λ.
    The merge is reverted when Λ ≥ log((1 - false_confirm) / false_revert), and confirmed when Λ ≤ log(false_confirm /
    (1 - false_revert)) and at least ``new_m`` metres of new walls agree or the robots saw each other where they should,
    because confirming needs new evidence.

    The rates are risks: of merges accepted alike, at most ``false_revert`` are right and reverted, and at most
    ``false_confirm`` wrong and confirmed, as far as ``prior`` and the two shares are true. With ``prior_max`` 0 they
    are Wald's error probabilities, whatever the prior. The default shares come from simulated buildings, where .05 of
    the blocks speak against right merges, .3 against wrong ones that look good, and .5 against any wrong one.

    A confirmed merge is watched on; it is reverted only when what speaks against it lies in at least ``places`` patches
    (the detail ``places``): a shut door or a person is no wrong merge. A merge is also reverted when ``prior``,
    measured again on the maps as they have become, is below ``revert_below``; not under ``single_map``, whose merged
    map holds the donor itself.

    ``revert_at`` and ``confirm_at`` take the places of the two limits on Λ where labels have set others; the rates then
    are those that the labels promise.

    ``confirm`` false never confirms; ``reversals`` replaces it under a reversal, because a merged map agrees with a
    donor that it contains: ``{single_map: {confirm: false}}``.

    Source: A. Wald, Sequential tests of statistical hypotheses, Annals of Mathematical Statistics 16 (1945).
    """

    def __init__(
        self,
        *,
        news: str = "news",
        prior: str = "posterior",
        false_revert: float = 0.001,
        false_confirm: float = 0.005,
        against_right: float = 0.08,
        against_wrong: float = 0.4,
        prior_max: float = 6.0,
        new_m: float = 2.0,
        places: int = 3,
        revert_below: float = 0.1,
        revert_at: float | None = None,
        confirm_at: float | None = None,
        confirm: bool = True,
        reversals: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        shares = (false_revert, false_confirm, against_right, against_wrong)
        if not all(0.0 < share < 1.0 for share in shares) or against_right >= against_wrong:
            raise ConfigError(
                "verifier sequential needs false_revert, false_confirm and against_right < against_wrong in (0, 1), "
                f"found {false_revert=}, {false_confirm=}, {against_right=}, {against_wrong=}"
            )
        if prior_max < 0.0 or new_m < 0.0 or places < 1 or not 0.0 <= revert_below < 1.0:
            raise ConfigError(
                "verifier sequential needs prior_max >= 0, new_m >= 0, places >= 1 and revert_below in [0, 1), found "
                f"{prior_max=}, {new_m=}, {places=}, {revert_below=}"
            )
        self.news, self.prior = news, prior
        self.upper = math.log((1.0 - false_confirm) / false_revert) if revert_at is None else revert_at
        self.lower = math.log(false_confirm / (1.0 - false_revert)) if confirm_at is None else confirm_at
        if not self.lower < self.upper:
            raise ConfigError(
                f"verifier sequential needs confirm_at < revert_at, found {self.lower:g} and {self.upper:g}"
            )
        self.if_against = math.log(against_wrong / against_right)
        self.if_agreed = math.log((1.0 - against_wrong) / (1.0 - against_right))
        self.prior_max, self.new_m, self.places, self.revert_below = prior_max, new_m, places, revert_below
        self.confirms = dict.fromkeys(REVERSALS, confirm) | _confirms(reversals or {})

    def verify(self, history: Sequence[Sample], reversal: str) -> Verdict:
        """Keep, confirm or revert, with the numbers that made it so."""
        if not history:
            return Verdict("keep", "nothing has been measured yet")
        latest, news = history[-1], history[-1].measurements.get(self.news)
        if news is None:
            raise PluginError(f"the metric {self.news} was not measured: a rule must name it among its metrics")
        agreed, against, places = (_detail(news, name) for name in ("agreed", "against", "places"))
        met = told_by(latest.measurements)
        start = self._start(history[0]) - met
        wrong = start + against * self.if_against + agreed * self.if_agreed
        evidence = self._evidence(wrong, reversal) | ({NAME: met} if met else {})
        if reversal != "single_map" and (fallen := self._fallen(history)) is not None:
            return Verdict("revert", fallen, evidence)
        if not (news.support or met):
            return Verdict("keep", "no new evidence yet", evidence)
        is_local = latest.state == "confirmed" and places < self.places and met > REFUTED
        action, said = self._judge(wrong, start, news, is_local, met, reversal)
        return Verdict(action, said, evidence)

    def _judge(
        self, wrong: float, start: float, news: Measurement, is_local: bool, met: float, reversal: str
    ) -> tuple[Literal["keep", "confirm", "revert"], str]:
        """What follows from the log-odds; ``is_local`` says that the merge is confirmed and too few places are against
        it."""
        against, places = _detail(news, "against"), _detail(news, "places")
        new_m = news.details.get("agreed_m", math.inf)
        said = f"{_told(against, news.support, places)}: log-odds of being wrong {wrong:.1f}, {start:.1f} at the start"
        said += f"; where the robots saw each other says {met:+.1f} nats for it" if met else ""
        if wrong >= self.upper:
            if is_local:
                few = f"less than {self.places} place{'s' * (self.places != 1)}"
                return "keep", f"{said}: what is against a confirmed merge is in {few}"
            return "revert", f"{said}; reverted from {self.upper:.1f} on"
        if wrong > self.lower:
            return "keep", f"{said}; undecided between {self.lower:.1f} and {self.upper:.1f}"
        if new_m < self.new_m and met < TELLING:
            return "keep", f"{said}; {new_m:.1f} of {self.new_m:g} m of new walls agree"
        if not self.confirms.get(reversal, False):
            return "keep", f"{said}; the rule never confirms what it sees here"
        return "confirm", f"{said}; confirmed from {self.lower:.1f} down; {new_m:.1f} m of new walls agree"

    def _evidence(self, wrong: float, reversal: str) -> dict[str, float]:
        """Where the test stands, and its limits."""
        evidence = {"log_odds_wrong": wrong, "log_odds_wrong.revert_at": self.upper}
        if self.confirms.get(reversal, False):
            evidence["log_odds_wrong.confirm_at"] = self.lower
        if reversal != "single_map" and self.revert_below > 0.0:
            evidence[f"{self.prior}.revert_at"] = self.revert_below
        return evidence

    def _start(self, first: Sample) -> float:
        """The log-odds of being wrong with which the test starts."""
        prior = first.measurements.get(self.prior)
        if prior is None and self.prior_max > 0.0:
            raise PluginError(
                f"the metric {self.prior} was not measured at the merge: a rule must name it under verify, as a metric "
                "or in the log, or set prior_max: 0"
            )
        if prior is None or not prior.sufficient:
            return 0.0
        right = min(max(prior.value, 1e-12), 1.0 - 1e-12)
        return max(-self.prior_max, min(self.prior_max, -math.log(right / (1.0 - right))))

    def _fallen(self, history: Sequence[Sample]) -> str | None:
        """Why the merge is no longer probable, if it is so."""
        latest = history[-1].measurements.get(self.prior) if len(history) > 1 else None
        if latest is None or not latest.value < self.revert_below:
            return None
        return f"{self.prior} {latest.value:.3g} < {self.revert_below:g} on the maps as they are now"


def _told(against: float, support: int, places: float) -> str:
    """How many pieces are against a merge, in a clause."""
    pieces = f"new piece{'s' * (support != 1)} of evidence"
    if not against:
        return f"none of {support} {pieces} is against it"
    are, where = "is" if against == 1 else "are", f"{places:g} place{'s' * (places != 1)}"
    return f"{against:g} of {support} {pieces} {are} against it, in {where}"


def _detail(news: Measurement, name: str) -> float:
    return news.details.get(name, 0.0)


def _confirms(reversals: Mapping[str, Mapping[str, Any]]) -> dict[str, bool]:
    out = {}
    for name, options in mapping_of(reversals, "verifier sequential, reversals").items():
        given = mapping_of(options, f"verifier sequential, {name}")
        if name not in REVERSALS or set(given) != {"confirm"} or not isinstance(given["confirm"], bool):
            raise ConfigError(
                f"verifier sequential takes confirm true or false for {', '.join(REVERSALS)}, found {name}: {given}"
            )
        out[name] = given["confirm"]
    return out

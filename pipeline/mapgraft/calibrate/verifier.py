"""What a rule tells its verifier ``sequential``: what it is asked, and where it confirms so far, if at all."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from mapgraft.calibrate.given import SEQUENTIAL
from mapgraft.calibrate.sequential import Test
from mapgraft.decision import Rule, Verification
from mapgraft.errors import DecisionTableError

HARDLY: Final = 1e-4  # nats: a limit of confirmation stays so far below one of reversal at least


def is_sequential(rule: Rule) -> bool:
    """Whether labels can set the limits of a rule's verifier."""
    return rule.verify is not None and rule.verify.use == SEQUENTIAL


def test_of(rule: Rule) -> Test:
    """The test as the rule has it. Labels never confirm what is more probably wrong than right, whatever the rule does.

    Raises DecisionTableError where its parameters cannot be those of the verifier.
    """
    told = {} if rule.verify is None else rule.verify.parameters
    try:
        return Test(
            str(told.get("news", "news")),
            str(told.get("prior", "posterior")),
            float(told.get("new_m", 2.0)),
            float(told.get("revert_below", 0.1)),
            min(confirm_at(told), -HARDLY),
        )
    except (TypeError, ValueError, ArithmeticError) as fault:
        raise DecisionTableError(
            f"rule {rule.name!r}: its verifier cannot have the parameters {told}: {fault}"
        ) from None


def confirm_at(told: Mapping[str, Any]) -> float:
    """The log-odds of being wrong down to which merges are confirmed, by the verifier's parameters."""
    given = told.get("confirm_at")
    if given is not None:
        return float(given)
    return math.log(float(told.get("false_confirm", 0.005)) / (1.0 - float(told.get("false_revert", 0.001))))


def confirms(verify: Verification | None, reversal: str) -> bool:
    """Whether merges are confirmed at all under a reversal; of any reversal where it is empty."""
    told = {} if verify is None else verify.parameters
    return bool(_reversals(told).get(reversal, told.get("confirm", True)))


def never_confirming(told: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters of a verifier that confirms under no reversal."""
    out = {**told, "confirm": False}
    if any(_reversals(told).values()):
        out["reversals"] = {name: {"confirm": False} for name in _reversals(told)}
    return out


def _reversals(told: Mapping[str, Any]) -> dict[str, bool]:
    """Under which reversals the parameters say that merges are confirmed, and under which not."""
    given = told.get("reversals")
    by_name = given.items() if isinstance(given, Mapping) else ()
    return {name: bool(options.get("confirm")) for name, options in by_name if isinstance(options, Mapping)}

"""Conditions of a decision table that hold together: a rule that is made of another one never applies where that does
not."""

from __future__ import annotations

from collections.abc import Mapping

from mapgraft.decision import Condition, Range, holds

When = Mapping[str, Condition]


def together(*whens: When) -> dict[str, Condition] | None:
    """Conditions that hold where all of the given ones do; None where that is nowhere."""
    out: dict[str, Condition] = {}
    for when in whens:
        for name, condition in when.items():
            both = _both(out[name], condition) if name in out else condition
            if both is None:
                return None
            out[name] = both
    return out


def _both(one: Condition, other: Condition) -> Condition | None:
    """What meets two conditions on one field; None where nothing does."""
    if isinstance(one, Range):
        return _within(one, other) if isinstance(other, Range) else _both(other, one)
    if not isinstance(one, list):
        return one if holds(other, one) else None
    if not isinstance(other, Range | list):
        return other if holds(one, other) else None
    return [value for value in one if holds(other, value)] or None


def _within(one: Range, other: Range) -> Range | None:
    low = max((end for end in (one.min, other.min) if end is not None), default=None)
    high = min((end for end in (one.max, other.max) if end is not None), default=None)
    return None if low is not None and high is not None and low > high else Range(min=low, max=high)

"""Which examples are for training and which for testing: buildings decide, never pairs of maps."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Final

SPLITS: Final = ("train", "validation", "test")
_SHARES: Final = (0.70, 0.15, 0.15)


def split_by_name(environment: str) -> str:
    """The split of a building: the same whatever other buildings there are, about 70, 15 and 15 of a hundred."""
    digest = hashlib.blake2b(environment.encode(), digest_size=8).digest()
    at, upto = int.from_bytes(digest, "big") / 2.0**64, 0.0
    for split, share in zip(SPLITS, _SHARES, strict=True):
        upto += share
        if at < upto:
            return split
    return SPLITS[-1]


def split_of(environment: str, decided: Mapping[str, str]) -> str | None:
    """The split of an example; ``decided`` are buildings whose split is known otherwise than by their names.

    None for two buildings (``a+b``) of different splits: one of them would be in both.
    """
    splits = {decided.get(name) or split_by_name(name) for name in environment.split("+")}
    return splits.pop() if len(splits) == 1 else None

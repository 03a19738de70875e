"""The numbers that the paper reports, to put beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from ruamel.yaml import YAML

from mapgraft.experiments.andersone2021.settings import Combination
from mapgraft.experiments.andersone2021.telling.tables import Number

SOURCE = (
    "I. Andersone, Distributed Framework for Reversible Merging of Heterogeneous Robot Maps, ICAART 2021, volume 1, "
    "pages 422-430, DOI 10.5220/0010342404220430"
)
_KINDS = {"right": True, "wrong": False}

Key = tuple[str, bool, str, str]  # combination, right or wrong, strategy in short (1M, 2M), quantity


@dataclass(frozen=True, slots=True)
class Published:
    """What the paper's tables hold, by combination, kind of merge, strategy and quantity, such as ``end_distance``.

    ``where`` says by combination which table it is from.
    """

    numbers: Mapping[Key, Number]
    where: Mapping[str, str]

    def number(self, combination: Combination, right: bool, strategy: str, quantity: str) -> Number | None:
        """An average with its range where the paper gives one, None where it tells nothing."""
        return self.numbers.get((combination.name, right, strategy, quantity))


@cache
def published() -> Published:
    """The paper's tables 1 to 4."""
    text = files(__package__).joinpath("published.yaml").read_text(encoding="utf-8")
    content: Mapping[str, Any] = YAML(typ="safe", pure=True).load(text)
    ranges = {key: given for part in content["ranges"] for key, given in _entries(part)}
    numbers = {
        key: Number(float(average), *map(float, ranges.get(key, ())))
        for part in content["averages"]
        for key, average in _entries(part)
    }
    return Published(numbers, {part["combination"]: part["where"] for part in content["averages"]})


def _entries(part: Mapping[str, Any]) -> list[tuple[Key, Any]]:
    return [
        ((part["combination"], right, strategy, quantity), value)
        for kind, right in _KINDS.items()
        for quantity, given in part[kind].items()
        for strategy, value in given.items()
    ]

"""Whether a value that a plugin gave is a number or a text; raises PluginError that goes on after the plugin's name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real

import numpy as np

from mapgraft.errors import PluginError


def finite(what: str, value: object) -> None:
    number(what, value)
    if not isinstance(value, Real) or not math.isfinite(value):
        raise PluginError(f"gave {what} of {shown(value)}, a finite number was wanted")


def number(what: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise PluginError(f"gave {what} of {shown(value)}, a number was wanted")


def numbers(what: str, values: object) -> None:
    if not isinstance(values, Mapping):
        raise PluginError(f"gave {what} of type {type(values).__name__}, a mapping from names to numbers was wanted")
    for name, value in values.items():
        text(f"a name in {what}", name)
        if not isinstance(value, Real | np.bool_):
            raise PluginError(f"gave {what} whose {name} is {shown(value)}, a number was wanted")


def text(what: str, value: object) -> None:
    if not isinstance(value, str):
        raise PluginError(f"gave {what} of type {type(value).__name__}, a text was wanted")


def shown(value: object) -> str:
    """What it is, in few words: a stranger's ``repr`` may be of any length, or fail."""
    if value is None or isinstance(value, bool | int | float | str | tuple):
        return repr(value)[:60]
    return f"a {type(value).__name__}"

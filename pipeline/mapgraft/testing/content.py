"""What a value holds, to the last bit, as something that can be compared and kept."""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Mapping, Set
from typing import Any

import numpy as np

from mapgraft.contracts import Transform


def content_of(value: object) -> Any:
    """Everything in it: arrays with type and shape, floats by their bits (so that NaN equals NaN), values by field.

    Objects that are neither values nor containers count as themselves.
    """
    if isinstance(value, Transform):
        return ("Transform", value.matrix.tobytes())
    if isinstance(value, np.ndarray):
        return (str(value.dtype), value.shape, value.tobytes())
    if isinstance(value, float | np.floating):
        return ("float", struct.pack("<d", float(value)))
    if isinstance(value, Mapping):
        return (type(value).__name__, tuple((content_of(k), content_of(v)) for k, v in value.items()))
    if isinstance(value, Set):
        return (type(value).__name__, frozenset(content_of(v) for v in value))
    if isinstance(value, list | tuple):
        return (type(value).__name__, tuple(content_of(v) for v in value))
    if isinstance(value, bytearray | memoryview):
        return bytes(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [(f.name, content_of(getattr(value, f.name))) for f in dataclasses.fields(value)]
        return (type(value).__name__, tuple(fields))
    if isinstance(value, str | bytes | int | bool | complex | type(None)):
        return (type(value).__name__, value)
    return ("object", id(value))

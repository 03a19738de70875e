"""What a message definition may ask for: definitions come with the file, and decoders run what they say.

A few bytes of definition can ask for elements without end: a type that holds itself, arrays of arrays, arrays of what
takes no bytes. Such a type is not decoded. The bounds are fixed; real types stay a thousand times below.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from rosbags.interfaces import Nodetype

from mapgraft.errors import RecordingError

MOST_BYTES: Final = 1 << 20  # of a definition's text
MOST_DEPTH: Final = 32  # types within types
MOST_ELEMENTS: Final = 1 << 16  # of arrays of fixed length that are not plain numbers, multiplied where they nest
MOST_NUMBERS: Final = 1 << 26  # of an array of plain numbers of fixed length

_FILLER: Final = "structure_needs_at_least_one_member"  # what an empty type has in memory, and ROS 1 does not write

Fields = Mapping[str, Any]  # type name → (constants, [(field, kind)]), as rosbags has it


def check_text(name: str, data: bytes) -> None:
    """Raises RecordingError when a definition is too long to be one."""
    if len(data) > MOST_BYTES:
        raise RecordingError(f"the definition of {name} has {len(data):,} bytes, the most is {MOST_BYTES:,}")


def check_type(name: str, fields: Fields) -> None:
    """Raises RecordingError when messages of a type could ask for more elements than their bytes can hold."""
    _Census(name, fields).weigh(name, ())


class _Census:
    """The least bytes and the elements of every type below one."""

    def __init__(self, name: str, fields: Fields) -> None:
        self._name, self._fields = name, fields
        self._known: dict[str, tuple[int, int]] = {}

    def weigh(self, name: str, above: tuple[str, ...]) -> tuple[int, int]:
        """(bytes that a message of the type has at least, elements that it has at least)."""
        if name in self._known:
            return self._known[name]
        if name in above:
            raise self._unfit(f"{name} holds itself")
        if len(above) >= MOST_DEPTH:
            raise self._unfit(f"its types nest deeper than {MOST_DEPTH}")
        least, elements = 0, 1
        for field, kind in self._fields.get(name, ((), ()))[1]:
            if field == _FILLER:
                continue
            more, parts = self._field(kind, (*above, name))
            least, elements = least + more, elements + parts
            if elements > MOST_ELEMENTS:
                raise self._unfit(f"it has more than {MOST_ELEMENTS:,} elements")
        self._known[name] = (least, elements)
        return least, elements

    def _field(self, kind: Any, above: tuple[str, ...]) -> tuple[int, int]:
        node, about = kind
        if node == Nodetype.BASE:
            return (4 if about[0] == "string" else 1), 0
        if node == Nodetype.NAME:
            return self.weigh(about, above)
        inner, count = about
        least, parts = self._field(inner, above)
        plain = inner[0] == Nodetype.BASE and inner[1][0] != "string"
        if node == Nodetype.SEQUENCE:
            if least == 0:
                raise self._unfit("it has a sequence of what takes no bytes")
            return 4, 0
        if count > (MOST_NUMBERS if plain else MOST_ELEMENTS):
            raise self._unfit(f"it has an array of {count:,} elements")
        return least * count, 0 if plain else max(parts, 1) * count

    def _unfit(self, why: str) -> RecordingError:
        return RecordingError(
            f"messages of type {self._name} are not decoded, because their definition is unsafe: {why}"
        )

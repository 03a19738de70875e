"""ROS 2 messages from plain values: nested mappings in, CDR out, with the definitions that readers need."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from mapgraft.errors import OutputError, PluginError
from mapgraft_schemas import message_texts

MERGE_EVENT = "mapgraft_msgs/msg/MergeEvent"
LOG_TYPE = "rcl_interfaces/msg/Log"
HEADER = "std_msgs/msg/Header"
_TIME = "builtin_interfaces/msg/Time"
_RULE = "=" * 80
_NUMPY = {"byte": "uint8", "char": "uint8", "octet": "uint8"}
_IDENTITY: Mapping[str, Mapping[str, object]] = {"geometry_msgs/msg/Quaternion": {"w": 1.0}}

Build = Callable[[object, "Place"], Any]


class Place:
    """Where and when a message is said: what its headers and stamps are filled in with."""

    __slots__ = ("frame_id", "nanosec", "sec")

    def __init__(self, stamp_ns: int, frame_id: str) -> None:
        check_stamp(stamp_ns)
        self.sec, self.nanosec = divmod(stamp_ns, 1_000_000_000)
        self.frame_id = frame_id


def check_stamp(stamp_ns: int) -> None:
    """Raises OutputError unless the stamp fits ``builtin_interfaces/msg/Time``."""
    if not 0 <= stamp_ns < 2**31 * 1_000_000_000:
        raise OutputError(
            f"a stamp of {stamp_ns} ns does not fit a ROS message, which counts from 1970 to 2038: "
            "correct the clock of the recording (clock_offset_s)"
        )


class MessageEncoder:
    """Turns nested plain values into CDR of the types of ROS 2 Humble and of our own.

    Fields that are left out get ROS 2's defaults, except that every ``std_msgs/Header`` and
    ``builtin_interfaces/Time`` gets the frame and the stamp that are given.
    """

    def __init__(self) -> None:
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._texts = message_texts()
        for name, text in self._texts.items():
            self._store.register(get_types_from_msg(text, name))
        self._builders: dict[str, Build] = {}

    def encode(self, message_type: str, fields: Mapping[str, object], stamp_ns: int, frame_id: str) -> bytes:
        """Little-endian CDR of one message.

        Raises PluginError when the type or a field does not exist or a value does not fit, OutputError when the stamp
        does not fit a ROS message.
        """
        place = Place(stamp_ns, frame_id)
        try:
            message = self._builder(message_type)(fields, place)
            return bytes(self._store.serialize_cdr(message, message_type, little_endian=True))
        except (
            TypeError,
            ValueError,
            AttributeError,
            OverflowError,
            struct.error,
            SerdeError,
            AssertionError,
        ) as error:
            raise PluginError(
                f"a {message_type} cannot be written because a value does not fit its field: {error}"
            ) from error

    def decode(self, message_type: str, data: bytes | memoryview) -> Any:
        """The message object of little-endian CDR bytes."""
        return self._store.deserialize_cdr(data, message_type)

    def is_as_here(self, message_type: str, definition: str) -> bool:
        """Whether the text of a type, and of all types it is made of, has the fields that these have here."""
        try:
            told = get_types_from_msg(definition, message_type)
        except (TypesysError, ValueError):
            return False
        return all(self._store.fielddefs.get(name) == fields for name, fields in told.items())

    def definition(self, message_type: str) -> str:
        """The text of the type and of all types it is made of, as ``ros2msg`` has it; ours with their comments."""
        self._builder(message_type)
        generated = self._store.generate_msgdef(message_type, ros_version=2)[0]
        head, *parts = generated.split(f"{_RULE}\nMSG: ")
        out = [self._texts.get(message_type, head)]
        for part in parts:
            name, _, body = part.partition("\n")
            out.append(f"{_RULE}\nMSG: {name}\n{self._texts.get(name.replace('/', '/msg/', 1), body)}")
        return "".join(text if text.endswith("\n") else text + "\n" for text in out)

    def begins_with_header(self, message_type: str) -> bool:
        """Whether the first field is a ``std_msgs/Header``, so that bytes 4 to 12 hold the stamp."""
        fields = self._fields(message_type)
        return bool(fields) and fields[0][1] == (Nodetype.NAME, HEADER)

    def _fields(self, message_type: str) -> Sequence[tuple[str, Any]]:
        if message_type not in self._store.fielddefs:
            raise PluginError(
                f"there is no message type {message_type!r}: a map type can show itself in ROS 2 types only"
            )
        return self._store.fielddefs[message_type][1]

    def _builder(self, message_type: str) -> Build:
        if message_type not in self._builders:
            self._builders[message_type] = self._made(message_type)
        return self._builders[message_type]

    def _made(self, message_type: str) -> Build:
        cls: Any = self._store.types.get(message_type)
        builds = {name: self._value(*described) for name, described in self._fields(message_type)}
        presets = _IDENTITY.get(message_type, {})

        def build(given: object, place: Place) -> Any:
            if given is None:
                given = presets if message_type != HEADER else {"frame_id": place.frame_id}
            if not isinstance(given, Mapping):
                raise TypeError(f"a {message_type} needs a mapping of its fields, found a {type(given).__name__}")
            if not given.keys() <= builds.keys():
                unknown = ", ".join(sorted(given.keys() - builds.keys()))
                raise PluginError(f"a {message_type} has no field {unknown}: check the spelling")
            return cls(**{name: value(given.get(name), place) for name, value in builds.items()})

        def build_time(given: object, place: Place) -> Any:
            return build({"sec": place.sec, "nanosec": place.nanosec} if given is None else given, place)

        return build_time if message_type == _TIME else build

    def _value(self, kind: Nodetype, described: Any) -> Build:
        if kind == Nodetype.NAME:
            return self._builder(described)
        if kind == Nodetype.BASE:
            return _scalar(described[0])
        (inner_kind, inner), count = described
        if inner_kind == Nodetype.NAME:
            build = self._builder(inner)
            return lambda given, place: [build(item, place) for item in _items(given, count)]
        if inner[0] == "string":
            return lambda given, place: [str(item) for item in _items(given, count)]
        return _numbers(_NUMPY.get(inner[0], inner[0]), count if kind == Nodetype.ARRAY else 0)


def _scalar(name: str) -> Build:
    if name == "string":
        return lambda given, place: "" if given is None else str(given)
    default: Any = False if name == "bool" else 0
    return lambda given, place: default if given is None else given


def _numbers(dtype: str, count: int) -> Build:
    def build(given: object, place: Place) -> Any:
        if given is None:
            return np.zeros(count, dtype)
        array = np.ascontiguousarray(given)
        if array.size and not np.can_cast(array.dtype, dtype, casting="same_kind"):
            raise TypeError(f"an array of {array.dtype} does not fit {dtype}[{count or ''}]")
        flat = array.astype(dtype, copy=False).reshape(-1)
        if count and len(flat) != count:
            raise ValueError(f"{len(flat)} numbers do not fit {dtype}[{count}]")
        return flat

    return build


def _items(given: object, count: int) -> Sequence[object]:
    if given is None:
        return [None] * count
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise TypeError(f"a list is needed, found a {type(given).__name__}")
    return given

"""From serialized bytes to message objects, with the types that the file itself brings along."""

from __future__ import annotations

import importlib.util
import json
import re
import struct
from collections.abc import Callable
from functools import cache, cached_property, lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple, Protocol

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mapgraft.contracts.sources import LASER_SCAN, ScanMessage, SchemaText
from mapgraft.errors import MapgraftError, RecordingError, UsageError
from mapgraft.recording.decoding.definitions import check_text, check_type
from mapgraft.recording.decoding.laser_layout import LaserScanReader
from mapgraft.recording.decoding.names import message_type
from mapgraft.recording.decoding.scan_fields import SCAN_READERS

DEFAULT_TYPESTORE = "ros2_humble"
Data = bytes | memoryview

UNDECODABLE = (
    SerdeError,
    TypesysError,
    struct.error,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    AssertionError,
    OverflowError,
    MemoryError,
    RecursionError,
    MapgraftError,
)
"""What decoding damaged or hostile bytes may raise."""
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)+", re.ASCII)
_IDL_SEPARATOR = "=" * 80
_IDL_DIRECTIVE = re.compile(r"^[ \t]*#.*$", re.MULTILINE)
_HEADER = "std_msgs/msg/Header"


class Codec(Protocol):
    """Decodes the messages of one channel; both methods raise RecordingError when the bytes do not fit the type."""

    def decode(self, data: Data) -> object: ...
    def decode_scan(self, data: Data) -> ScanMessage: ...


class Undecodable(NamedTuple):
    """Why the messages of a channel cannot be decoded, as a clause."""

    why_not: str


def codec_for(encoding: str, schema: SchemaText | None, typestore: str = DEFAULT_TYPESTORE) -> Codec | Undecodable:
    """How to decode messages of one encoding (``cdr``, ``ros1``, ``json``, ``protobuf``) with one schema.

    ``typestore`` names the rosbags typestore for CDR messages whose definition is not in the file. Definitions are
    parsed when the first message is decoded, so that listing channels stays quick. Raises UsageError for an unknown
    typestore.
    """
    if encoding == "json":
        return ObjectCodec(message_type(schema.name) if schema is not None else "", _from_json)
    if schema is None:
        return Undecodable(f"its {encoding or 'unnamed'} messages have no schema")
    if encoding == "protobuf":
        return _protobuf_codec(schema)
    if encoding in ("cdr", "ros1"):
        return _ros_codec(encoding, schema, typestore)
    return Undecodable(f"the encoding {encoding!r} is unknown here")


def known_typestore(name: str) -> Stores:
    """The rosbags typestore of a name; raises UsageError that lists the names."""
    names = [store.value for store in Stores if store not in (Stores.EMPTY, Stores.LATEST)]
    if name not in names:
        raise UsageError(f"there is no typestore {name!r}: choose one of {', '.join(names)}")
    return Stores(name)


@lru_cache(maxsize=512)
def types_of(schema: SchemaText) -> Typestore:
    """One typestore per schema, because two robots may have different versions of a message.

    Raises RecordingError when the definition cannot be parsed.
    """
    store, name = get_typestore(Stores.EMPTY), message_type(schema.name)
    if not _TYPE_NAME.fullmatch(name):  # it becomes part of generated code
        raise RecordingError(f"{name[:80]!r} cannot be the name of a message type")
    check_text(name, schema.data)
    try:
        text = schema.data.decode()
        if schema.encoding == "ros2idl":
            for part in _idl_parts(text):
                store.register(get_types_from_idl(part))
        else:
            store.register(get_types_from_msg(text, name))
        _fill_in(store, _usual(Stores.ROS1_NOETIC if schema.encoding == "ros1msg" else Stores.ROS2_HUMBLE))
    except (*UNDECODABLE, SyntaxError) as error:
        raise RecordingError(f"the definition of {name} in the recording cannot be parsed ({error})") from error
    check_type(name, store.fielddefs)
    return store


@cache
def _usual(store: Stores) -> Typestore:
    """The usual types of a distribution, made once: nobody changes them, and what they compile is kept with them."""
    return get_typestore(store)


def _fill_in(store: Typestore, usual: Typestore) -> None:
    """Take what a definition refers to but does not bring along from the usual types.

    Bags of early ROS 1 say ``Header`` and define it as ``roslib/Header``, for example.
    """
    missing = list(store.fielddefs)
    while missing:
        for _, kind in store.fielddefs[missing.pop()][1]:
            name = kind[1][0][1] if kind[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else kind[1]
            if isinstance(name, str) and name not in store.fielddefs and name in usual.fielddefs:
                store.fielddefs[name], store.types[name] = usual.fielddefs[name], usual.types[name]
                missing.append(name)


def _idl_parts(text: str) -> list[str]:
    """The definitions of an IDL schema, which rosbag2 joins by separators and ``IDL: name`` lines.

    ``#include`` lines go: what they include is there, and the parser does not know them.
    """
    text = _IDL_DIRECTIVE.sub("", text)
    if not text.startswith(_IDL_SEPARATOR):
        return [text]
    return [part.partition("\n")[2] for part in text.split(f"{_IDL_SEPARATOR}\n") if part.startswith("IDL: ")]


def _ros_codec(encoding: str, schema: SchemaText, typestore: str) -> Codec | Undecodable:
    name = message_type(schema.name)
    if schema.data:
        expected = ("ros1msg",) if encoding == "ros1" else ("ros2msg", "ros2idl")
        if schema.encoding not in expected:
            return Undecodable(f"a schema of kind {schema.encoding!r} does not go with {encoding} messages")
        return RosCodec(encoding, name, lambda: types_of(schema))
    fallback = Stores.ROS1_NOETIC if encoding == "ros1" else known_typestore(typestore)
    store = _usual(fallback)
    if name not in store.fielddefs:
        return Undecodable(f"its definition is neither in the recording nor in the typestore {fallback.value!r}")
    return RosCodec(encoding, name, lambda: store)


class RosCodec:
    """Decodes CDR or ROS 1 messages of one type with rosbags, laser scans by the fast way."""

    def __init__(self, encoding: str, name: str, load: Callable[[], Typestore]) -> None:
        self._encoding, self._name, self._load = encoding, name, load

    @cached_property
    def store(self) -> Typestore:
        """The types; raises RecordingError when the definition cannot be parsed."""
        return self._load()

    @cached_property
    def _deserialize(self) -> Callable[[Data, str], object]:
        return self.store.deserialize_ros1 if self._encoding == "ros1" else self.store.deserialize_cdr

    @cached_property
    def _read_scan(self) -> Callable[[Data], ScanMessage]:
        if self.is_plain_scan:
            return LaserScanReader(self._encoding, self._general_scan)
        return self._general_scan

    @cached_property
    def is_plain_scan(self) -> bool:
        """Whether these are laser scans with the fields that everybody's have."""
        if self._name != LASER_SCAN:
            return False
        try:
            own = self.store.fielddefs
        except RecordingError:
            return False
        usual = _usual(Stores.ROS1_NOETIC if self._encoding == "ros1" else Stores.ROS2_HUMBLE).fielddefs
        return all(name in own and own[name][1] == usual[name][1] for name in (LASER_SCAN, _HEADER))

    def _general_scan(self, data: Data) -> ScanMessage:
        return SCAN_READERS[self._name](self._deserialize(data, self._name))

    def decode(self, data: Data) -> object:
        try:
            return self._deserialize(data, self._name)
        except UNDECODABLE as error:
            raise _unfit(self._name, error) from error

    def decode_scan(self, data: Data) -> ScanMessage:
        try:
            return self._read_scan(data)
        except UNDECODABLE as error:
            raise _unfit(self._name, error) from error


class ObjectCodec:
    """Decodes messages with a function that gives an object with fields."""

    def __init__(self, name: str, load: Callable[[Data], Any]) -> None:
        self._name, self._load = name, load

    def decode(self, data: Data) -> object:
        try:
            message: object = self._load(data)
        except Exception as error:  # a decoder library may fail in any way on damaged bytes
            raise _unfit(self._name, error) from error
        return message

    def decode_scan(self, data: Data) -> ScanMessage:
        try:
            return SCAN_READERS[self._name](self._load(data))
        except Exception as error:
            raise _unfit(self._name, error) from error


def _unfit(name: str, error: BaseException) -> RecordingError:
    if isinstance(error, RecordingError):
        return error
    return RecordingError(f"a message of type {name or 'unknown'} cannot be decoded ({error or type(error).__name__})")


def _from_json(data: Data) -> object:
    return json.loads(bytes(data), object_hook=lambda fields: SimpleNamespace(**fields))


def _protobuf_codec(schema: SchemaText) -> Codec | Undecodable:
    if schema.encoding != "protobuf":
        return Undecodable(f"a schema of kind {schema.encoding!r} does not go with protobuf messages")
    if importlib.util.find_spec("mcap_protobuf") is None:
        return Undecodable("protobuf needs mcap-protobuf-support: pip install 'mapgraft[foxglove]'")
    return ObjectCodec(message_type(schema.name), _ProtobufLoader(schema))


class _ProtobufLoader:
    """Parses a protobuf message; its class is made of the schema when the first message comes."""

    def __init__(self, schema: SchemaText) -> None:
        self._schema = schema

    @cached_property
    def _parse(self) -> Callable[[bytes], Any]:
        from mcap.records import Schema
        from mcap_protobuf.decoder import DecoderFactory

        schema = Schema(id=1, name=self._schema.name, encoding=self._schema.encoding, data=self._schema.data)
        parse = DecoderFactory().decoder_for("protobuf", schema)
        if parse is None:
            raise RecordingError(f"the definition of {self._schema.name} in the recording cannot be used")
        return parse

    def __call__(self, data: Data) -> Any:
        return self._parse(bytes(data))

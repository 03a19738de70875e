"""The fast way into serialized ``tf2_msgs/TFMessage``: a walk over the bytes, for robots send many of them.

What does not end exactly where its fields say is left to the general way.
"""

from __future__ import annotations

import struct
from functools import lru_cache

from mapgraft.recording.decoding.names import bare_frame
from mapgraft.recording.decoding.records import PoseRecord

QUICK_TYPES = frozenset({"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"})
_MOST_TRANSFORMS = 10_000
_LATEST_S = 2**31 - 1  # in 2038; what the general way makes of later stamps of ROS 1, whose seconds have no sign

_uint32 = struct.Struct("<I").unpack_from
_cdr_stamp = struct.Struct("<iII").unpack_from  # seconds, nanoseconds, size of the frame's name
_ros1_stamp = struct.Struct("<IIII").unpack_from  # a sequence number before them
_doubles = struct.Struct("<7d").unpack_from
_new = tuple.__new__  # what NamedTuple's constructor does, at half the price

Data = bytes | memoryview


def transforms(encoding: str, data: Data) -> list[PoseRecord] | None:
    """The transforms of one message in ``cdr`` or ``ros1``; None when it is not of the plain kind."""
    try:
        if encoding == "cdr":
            return _from_cdr(data) if data[:2] == b"\x00\x01" else None
        return _from_ros1(data) if encoding == "ros1" else None
    except (struct.error, UnicodeDecodeError):
        return None


def _from_cdr(data: Data) -> list[PoseRecord] | None:
    """Fields are aligned to their size, counted from behind the 4 bytes of encapsulation; names end with a zero."""
    (count,) = _uint32(data, 4)
    if count > _MOST_TRANSFORMS:
        return None
    records, at = [], 8
    for _ in range(count):
        at = (at + 3) & ~3
        seconds, nanoseconds, size = _cdr_stamp(data, at)
        frame, at = bytes(data[at + 12 : at + 12 + size]), (at + 12 + size + 3) & ~3
        (size,) = _uint32(data, at)
        child, at = bytes(data[at + 4 : at + 4 + size]), ((at + size + 7) & ~7) + 4
        x, y, z, qx, qy, qz, qw = _doubles(data, at)
        at += 56
        names = (_cdr_name(frame), _cdr_name(child))
        stamp_ns = seconds * 1_000_000_000 + nanoseconds
        records.append(_new(PoseRecord, (stamp_ns, *names, (x, y, z), (qx, qy, qz, qw), None)))
    return records if 0 <= len(data) - at <= 3 else None


def _from_ros1(data: Data) -> list[PoseRecord] | None:
    (count,) = _uint32(data, 0)
    if count > _MOST_TRANSFORMS:
        return None
    records, at = [], 4
    for _ in range(count):
        _, seconds, nanoseconds, size = _ros1_stamp(data, at)
        if seconds > _LATEST_S:
            return None
        frame, at = bytes(data[at + 16 : at + 16 + size]), at + 16 + size
        (size,) = _uint32(data, at)
        child, at = bytes(data[at + 4 : at + 4 + size]), at + 4 + size
        x, y, z, qx, qy, qz, qw = _doubles(data, at)
        at += 56
        names = (_name(frame), _name(child))
        stamp_ns = seconds * 1_000_000_000 + nanoseconds
        records.append(_new(PoseRecord, (stamp_ns, *names, (x, y, z), (qx, qy, qz, qw), None)))
    return records if at == len(data) else None


@lru_cache(maxsize=4096)
def _name(encoded: bytes) -> str:
    return bare_frame(encoded.decode())


@lru_cache(maxsize=4096)
def _cdr_name(encoded: bytes) -> str:
    if not encoded.endswith(b"\x00"):
        raise struct.error("a name without its end")
    return bare_frame(encoded[:-1].decode())

"""Bytes of recordings: MCAP files, CARMEN logs, and serialized messages with their definitions."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

Run = Callable[[bytes], None]


def scratch(name: str) -> Path:
    """A file of this process, in memory where the machine has such a place."""
    room = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    return Path(tempfile.mkdtemp(prefix="mapgraft-fuzz-", dir=room)) / name


def read_through(source, mode: int) -> None:
    """Everything that a mission may ask of a source; ``mode`` chooses windows and topics, and when it is closed."""
    from mapgraft.errors import RecordingError
    from mapgraft.recording.decoding.poses import POSE_READERS, poses_of

    with source:
        times = []
        for raw in source.messages():
            times.append(raw.log_ns)
            with suppress(RecordingError):
                message = source.decode(raw)
                if raw.channel.message_type in POSE_READERS:
                    poses_of(raw.channel.message_type, message)
            if mode & 16:
                with suppress(RecordingError):
                    source.decode_scan(raw)
        middle_ns = sorted(times)[len(times) // 2] if times else 0
        begin_ns, end_ns = (middle_ns if mode & 1 else None), (middle_ns if mode & 2 else None)
        topics = [channel.topic for channel in source.channels[: mode >> 2 & 1]] if mode & 12 else None
        assert sum(1 for _ in source.messages(topics, begin_ns, end_ns)) <= len(times) if mode & 12 else True
        for scan in source.scans(topics, begin_ns, end_ns):
            assert begin_ns is None or begin_ns <= scan.log_ns
            assert end_ns is None or scan.log_ns <= end_ns
        assert all(fault.count > 0 and fault.sentence for fault in source.faults)
        for channel in source.channels:
            source.schema(channel)
        late = source.messages()
    if mode & 16:
        list(late)  # an MCAP file that is closed meanwhile says so


def of_file(open_source, path: Path) -> Run:
    """Writes all but the first byte to a file, and asks of it what that one chooses, within narrow limits or wide."""
    from mapgraft.errors import MapgraftError
    from mapgraft.recording.containers.limits import ReadLimits

    narrow, wide = ReadLimits(chunk_bytes=2000, expansion=2.0), ReadLimits()

    def run(data: bytes) -> None:
        mode = data[0] if data else 0
        path.write_bytes(data[1:])
        with suppress(MapgraftError):
            read_through(open_source(path, limits=narrow if mode & 32 else wide), mode)
        path.unlink()  # what is mapped stays as it is

    return run


def mcap() -> Run:
    """The first byte chooses what is asked of the file in the others."""
    from mapgraft.recording.containers.mcap_file import McapSource

    return of_file(McapSource, scratch("a.mcap"))


def carmen() -> Run:
    """The first byte chooses what is asked of the log in the others."""
    from mapgraft.errors import MapgraftError
    from mapgraft.recording.containers.carmen_file import CarmenSource

    path = scratch("a.log")

    def run(data: bytes) -> None:
        mode = data[0] if data else 0
        path.write_bytes(data[1:])
        with suppress(MapgraftError):
            read_through(CarmenSource(path), mode)
        for line in data[1:].splitlines() if mode & 32 else ():
            _line_by_line(line.split())

    return run


def _line_by_line(words: list[bytes]) -> None:
    """What a line says, also of lines that a log would have left out because they have no time."""
    from mapgraft.recording.containers.carmen_lines import POSE_KEYWORDS, SCAN_KEYWORDS, pose_line, scan_line, stamps

    for keyword in (*SCAN_KEYWORDS[-3:], *POSE_KEYWORDS):
        for read in (stamps, scan_line if keyword in SCAN_KEYWORDS else pose_line):
            with suppress(ValueError, OverflowError):
                read(keyword, words)


BETWEEN = b"\xfe~\xfe"
"""What stands between messages of one channel."""


def cdr() -> Run:
    """The first byte chooses how the messages are encoded; of definitions from the bytes themselves, see ``_defined``.

    Several messages of a channel stand one after another with ``BETWEEN`` between them.
    """
    from fuzz_seeds import message_kinds

    from mapgraft.errors import MapgraftError
    from mapgraft.recording.decoding.codecs import DEFAULT_TYPESTORE, Undecodable, codec_for
    from mapgraft.recording.decoding.names import message_type

    kinds = message_kinds()

    def run(data: bytes) -> None:
        typestore = DEFAULT_TYPESTORE
        if not data:
            return
        if data[0] < 128:
            encoding, schema = kinds[data[0] % len(kinds)]
            body = data[1:]
        else:
            encoding, schema, typestore, body = _defined(data[1:])
        name = "" if schema is None else message_type(schema.name)
        with suppress(MapgraftError):
            codec = codec_for(encoding, schema, typestore or DEFAULT_TYPESTORE)
            if isinstance(codec, Undecodable):
                assert codec.why_not
                return
            for one in body.split(BETWEEN):
                with suppress(MapgraftError):
                    _decoded(codec, encoding, name, one)

    return run


def _decoded(codec, encoding: str, name: str, body: bytes) -> None:
    """One message, by the quick way and by the general one, which agree."""
    from mapgraft.contracts.sources import SCAN_TYPES
    from mapgraft.recording.decoding.grids import grid_payload
    from mapgraft.recording.decoding.poses import POSE_READERS, poses_of
    from mapgraft.recording.decoding.scan_fields import SCAN_READERS
    from mapgraft.recording.decoding.scans import scan_payload
    from mapgraft.recording.poses.quick_tf import transforms

    if name in SCAN_TYPES and name in SCAN_READERS:
        quick = codec.decode_scan(body)
        assert repr(quick) == repr(SCAN_READERS[name](codec.decode(body)))
        scan_payload(quick)
    message = codec.decode(body)
    if name in POSE_READERS:
        quick_poses = transforms(encoding, body)
        general_poses = poses_of(name, message)
        if name.startswith("tf") and quick_poses is not None:
            assert repr(list(general_poses)) == repr(quick_poses)
        for record in general_poses:
            if record.valid:
                record.transform()
    if name == "nav_msgs/msg/OccupancyGrid":
        grid_payload(message)


def _defined(data: bytes):
    """A definition and messages of it: ``encoding \\0 kind \\0 name \\0 typestore \\0 definition \\0 messages``."""
    from mapgraft.contracts.sources import SchemaText

    encoding, kind, name, typestore, text, body = (data.split(b"\0", 5) + [b""] * 6)[:6]
    schema = SchemaText(name.decode("latin1"), kind.decode("latin1"), text)
    return encoding.decode("latin1"), schema, typestore.decode("latin1"), body

"""What is fuzzed: one function per kind of bytes from strangers, which may raise MapgraftError and nothing else.

Imports are made inside ``build`` functions, so that an engine can watch which branches of the imported code are taken.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

Run = Callable[[bytes], None]
CONTAINERS = "mapgraft.recording.containers"
DECODING = "mapgraft.recording.decoding"


@dataclass(frozen=True)
class Harness:
    """``build`` makes the function that takes the bytes, ``modules`` is the code that it is after.

    ``plain`` modules are imported before anybody watches: numba cannot compile what is watched.
    """

    name: str
    build: Callable[[], Run]
    modules: tuple[str, ...]
    max_bytes: int
    plain: tuple[str, ...] = ()


def _scratch(name: str) -> Path:
    """A file of this process, in memory where the machine has such a place."""
    room = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    return Path(tempfile.mkdtemp(prefix="mapgraft-fuzz-", dir=room)) / name


def _read_through(source) -> None:
    """Everything that a mission may ask of a source."""
    from mapgraft.errors import RecordingError
    from mapgraft.recording.decoding.poses import POSE_READERS, poses_of

    with source:
        for raw in source.messages():
            with suppress(RecordingError):
                message = source.decode(raw)
                if raw.channel.message_type in POSE_READERS:
                    poses_of(raw.channel.message_type, message)
        scans = list(source.scans())
        if scans:
            middle_ns = sorted(scan.log_ns for scan in scans)[len(scans) // 2]
            assert len(list(source.scans(None, middle_ns))) <= len(scans)
        assert all(fault.count > 0 and fault.sentence for fault in source.faults)
        for channel in source.channels:
            source.schema(channel)


def mcap() -> Run:
    from mapgraft.errors import MapgraftError
    from mapgraft.recording.containers.mcap_file import McapSource

    path = _scratch("a.mcap")

    def run(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(MapgraftError):
            _read_through(McapSource(path))
        path.unlink()  # what is mapped stays as it is

    return run


def carmen() -> Run:
    from mapgraft.errors import MapgraftError
    from mapgraft.recording.containers.carmen_file import CarmenSource

    path = _scratch("a.log")

    def run(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(MapgraftError):
            _read_through(CarmenSource(path))

    return run


def cdr() -> Run:
    """The first byte chooses how the message is encoded; of definitions from the bytes themselves, see ``_defined``."""
    from fuzz_seeds import message_kinds

    from mapgraft.contracts.sources import SCAN_TYPES
    from mapgraft.errors import MapgraftError
    from mapgraft.recording.decoding.codecs import Undecodable, codec_for
    from mapgraft.recording.decoding.grids import grid_payload
    from mapgraft.recording.decoding.names import message_type
    from mapgraft.recording.decoding.poses import POSE_READERS, poses_of
    from mapgraft.recording.decoding.scan_fields import SCAN_READERS
    from mapgraft.recording.decoding.scans import scan_payload
    from mapgraft.recording.poses.quick_tf import transforms

    kinds = message_kinds()

    def run(data: bytes) -> None:
        if not data:
            return
        if data[0] < 128:
            encoding, schema = kinds[data[0] % len(kinds)]
            body = data[1:]
        else:
            encoding, schema, body = _defined(data[1:])
        name = "" if schema is None else message_type(schema.name)
        with suppress(MapgraftError):
            codec = codec_for(encoding, schema)
            if isinstance(codec, Undecodable):
                assert codec.why_not
                return
            if name in SCAN_TYPES and name in SCAN_READERS:
                quick = codec.decode_scan(body)
                general = SCAN_READERS[name](codec.decode(body))
                assert repr(quick) == repr(general)
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

    return run


def _defined(data: bytes):
    """A definition and a message of it: ``encoding \\0 kind \\0 name \\0 definition \\0 message``."""
    from mapgraft.contracts.sources import SchemaText

    encoding, kind, name, text, body = (data.split(b"\0", 4) + [b""] * 5)[:5]
    schema = SchemaText(name.decode("latin1"), kind.decode("latin1"), text)
    return encoding.decode("latin1"), schema, body


def config() -> Run:
    """The first byte chooses YAML or TOML."""
    from mapgraft.config import load_config
    from mapgraft.errors import MapgraftError

    paths = (_scratch("a.yaml"), _scratch("a.toml"))

    def run(data: bytes) -> None:
        path = paths[data[0] % 2] if data else paths[0]
        path.write_bytes(data[1:])
        try:
            found = load_config(path)
        except MapgraftError as error:
            str(error).encode(errors="backslashreplace")
        else:
            found.model_dump_json()

    return run


def decision() -> Run:
    """Rules and, behind a zero byte, the facts of a pair as JSON."""
    from mapgraft.contracts import MapMetadata
    from mapgraft.decision import build_table, facts_of, parse_rules
    from mapgraft.errors import MapgraftError
    from mapgraft.plugins import load_plugins

    plugins = load_plugins()
    grid, other = MapMetadata("occupancy_grid", 0.05, known_area_m2=50.0), MapMetadata("beacons")

    def run(data: bytes) -> None:
        text, _, told = data.partition(b"\0")
        try:
            rules = parse_rules(text.decode(errors="replace"), "of the harness")
            table = build_table(plugins, [rule.model_dump(mode="json", exclude_unset=True) for rule in rules])
        except MapgraftError as error:
            str(error).encode(errors="backslashreplace")
            return
        facts = facts_of(grid, other, 1.0)
        with suppress(ValueError, RecursionError):
            given = json.loads(told)
            if isinstance(given, dict):
                facts |= {k: v for k, v in given.items() if isinstance(v, bool | int | float | str)}
        for these in (facts, facts_of(grid, grid), facts_of(other, other, None, "single_map")):
            ruling = table.choose(these)
            assert ruling.reason
            assert ruling.rejected or ruling.rule is not None
        table.source.encode()

    return run


def layer() -> Run:
    """The first byte chooses what the bytes are: a packed layer, a message, the inside of either, or an offer."""
    import zstandard

    from mapgraft.contracts import Transform
    from mapgraft.errors import MapgraftError
    from mapgraft.exchange import Offer
    from mapgraft.network.wire import MAGIC, sealed
    from mapgraft.network.wire import decode as hear
    from mapgraft.network.wire import encode as say
    from mapgraft_grid.codec import decode, encode
    from mapgraft_grid.map_type import OccupancyGrid

    map_type = OccupancyGrid()
    T = Transform.planar(1.0, 2.0, 0.5)
    pack = zstandard.ZstdCompressor(level=3, write_checksum=True).compress

    def read(data: bytes) -> None:
        found = decode(data)
        assert encode(decode(encode(found))) == encode(found)
        map_type.metadata(found)
        assert map_type.view(found).known() >= 0
        map_type.place(found, T)

    def run(data: bytes) -> None:
        kind, body = data[:1], data[1:]
        with suppress(MapgraftError):
            if kind == b"o":
                assert Offer.decode(Offer.decode(body).encode()) is not None
            elif kind in (b"m", b"w"):
                message = hear(body if kind == b"m" else sealed(MAGIC + body))
                assert hear(say(message)) == message
            elif kind == b"p":
                read(body)
            else:
                read(b"MGGRID\x01\x00" + pack(body))

    return run


HARNESSES = {
    harness.name: harness
    for harness in (
        Harness(
            "mcap",
            mcap,
            tuple(
                f"{CONTAINERS}.{name}"
                for name in (
                    "mcap_file",
                    "mcap_index",
                    "mcap_messages",
                    "mcap_records",
                    "mcap_scans",
                    "chunks",
                    "inflate",
                )
            ),
            4096,
        ),
        Harness(
            "carmen",
            carmen,
            tuple(
                f"{CONTAINERS}.{name}"
                for name in ("carmen_file", "carmen_lines", "carmen_clock", "carmen_survey", "text_lines")
            ),
            2048,
        ),
        Harness(
            "cdr",
            cdr,
            (
                *(
                    f"{DECODING}.{name}"
                    for name in (
                        "codecs",
                        "definitions",
                        "laser_layout",
                        "grids",
                        "poses",
                        "records",
                        "scan_fields",
                        "scans",
                    )
                ),
                "mapgraft.recording.poses.quick_tf",
            ),
            2048,
        ),
        Harness("config", config, ("mapgraft.config", "mapgraft.documents"), 1024),
        Harness("decision", decision, ("mapgraft.decision", "mapgraft.documents"), 1024),
        Harness("layer", layer, ("mapgraft_grid.codec", "mapgraft.exchange"), 4096, ("mapgraft_grid.map_type",)),
    )
}

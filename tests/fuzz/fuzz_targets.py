"""What is fuzzed: one harness per kind of bytes from strangers, which may raise MapgraftError and nothing else.

Imports are made inside ``build`` functions, so that an engine can watch which branches of the imported code are taken.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

import fuzz_bags
import fuzz_conversations
import fuzz_documents
import fuzz_layers
import fuzz_mcap
import fuzz_messages
import fuzz_recordings
from fuzz_documents import damaged_document
from fuzz_mutations import Own
from fuzz_recordings import Run

CONTAINERS = "mapgraft.recording.containers"
DECODING = "mapgraft.recording.decoding"


@dataclass(frozen=True)
class Harness:
    """``build`` makes the function that takes the bytes, ``modules`` is the code that it is after.

    ``plain`` modules are imported before anybody watches: numba cannot compile what is watched. ``bounds`` are made
    small (``module:NAME``), so that small inputs reach what is beyond them. ``damage`` changes an input where it makes
    sense, by way of a function that changes any bytes.
    """

    name: str
    build: Callable[[], Run]
    modules: tuple[str, ...]
    max_bytes: int
    plain: tuple[str, ...] = ()
    bounds: Mapping[str, float] = field(default_factory=dict)
    damage: Own | None = None

    @property
    def words(self) -> tuple[str, ...]:
        return tuple(WORDS[self.name].split())


@contextmanager
def bounded(harness: Harness) -> Iterator[None]:
    """With the harness's bounds in place of the usual ones."""
    before = []
    for place, value in harness.bounds.items():
        module, _, name = place.partition(":")
        found = importlib.import_module(module)
        before.append((found, name, getattr(found, name)))
        setattr(found, name, value)
    try:
        yield
    finally:
        for found, name, usual in before:
            setattr(found, name, usual)


def _modules(package: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{package}.{name}" for name in names)


WORDS = {
    "mcap": "sensor_msgs/msg/LaserScan tf2_msgs/msg/TFMessage cdr ros1 json zstd lz4 bz2 offered_qos_profiles",
    "bag": "op= conn= time= size= compression= none bz2 lz4 index_pos= chunk_pos= topic= type= latching=1",
    "db3": "cdr sensor_msgs/msg/LaserScan topics messages TABLE BLOB INTEGER",
    "carmen": "FLASER RLASER ODOM TRUEPOS ROBOTLASER1 ROBOTLASER2 LASER_READING nan inf 1e400 -1 100000 400 81.83",
    "cdr": "float64 float64[] string uint8[9] MSG: IDL: std_msgs/Header ros1msg ros2msg ros2idl module struct "
    "sequence<double> tf2_msgs/msg/TFMessage sensor_msgs/msg/LaserScan cdr ros1 json protobuf NaN Infinity null",
    "config": "mission robots poses window start_s limits rules priors verdicts null true .nan *a &a !!set merge "
    "T_receiver_donor 1e999 [[ {} files [mission] exchange reversal",
    "decision": "name when match accept fuse verify reject own.type other.type min max use metrics priority via "
    "occupancy_grid line_segments posterior log_odds sequential *a &a .nan null [[ {}",
    "layer": 'Infinity NaN null [[ "walls" "rows" "pools" "floors" "sensors" "metadata" 1e999 ~~',
    "message": "layer preview parts whole alpha MGN sequential consistency occupancy_grid provenance metadata bounds_m",
    "network": "writer-a writer-b writer-c walls floor door occupancy_grid",
}
"""What random bytes would not hit upon."""

HARNESSES = {
    harness.name: harness
    for harness in (
        Harness(
            "mcap",
            fuzz_recordings.mcap,
            (
                *_modules(CONTAINERS, "chunks", "inflate", "latching", "limits", "mcap_file", "mcap_index"),
                *_modules(CONTAINERS, "mcap_messages", "mcap_records", "mcap_scans", "mcap_shapes", "mcap_summary"),
                *_modules(CONTAINERS, "mcap_walk", "selection"),
            ),
            2600,
            bounds={
                f"{CONTAINERS}.chunks:RESIDENT_BYTES": 3000,
                f"{CONTAINERS}.inflate:ONE_SHOT_LIMIT": 1 << 16,
                f"{CONTAINERS}.limits:FREE_BYTES": 1 << 20,
                f"{CONTAINERS}.mcap_walk:BARE_BLOCK_BYTES": 300,
                f"{CONTAINERS}.mcap_shapes:_READ_BYTES": 200,
            },
            damage=fuzz_mcap.damaged,
        ),
        Harness(
            "bag",
            fuzz_bags.bag,
            _modules(CONTAINERS, "bag_file", "bag_index", "bag_records", "bag_walk"),
            2600,
            bounds={
                f"{CONTAINERS}.chunks:RESIDENT_BYTES": 3000,
                f"{CONTAINERS}.inflate:ONE_SHOT_LIMIT": 1 << 16,
                f"{CONTAINERS}.limits:FREE_BYTES": 1 << 20,
            },
        ),
        Harness(
            "db3",
            fuzz_bags.db3,
            _modules(CONTAINERS, "sqlite_file", "sqlite_opening", "sqlite_pages", "sqlite_salvage", "sqlite_topics"),
            8192,
            bounds={f"{CONTAINERS}.limits:FREE_BYTES": 1 << 20, f"{CONTAINERS}.sqlite_opening:FREE_STEPS": 100_000},
        ),
        Harness(
            "carmen",
            fuzz_recordings.carmen,
            (
                *_modules(CONTAINERS, "carmen_file", "carmen_lines", "carmen_clock", "carmen_survey"),
                *_modules(CONTAINERS, "scanning", "text_lines"),
            ),
            1300,
            bounds={
                f"{CONTAINERS}.text_lines:LONGEST_LINE_BYTES": 1000,
                f"{CONTAINERS}.text_lines:_BLOCK_BYTES": 200,
                f"{CONTAINERS}.limits:FREE_TEXT_BYTES": 6000,
                f"{CONTAINERS}.limits:TEXT_SHARE": 1e-3,
            },
        ),
        Harness(
            "cdr",
            fuzz_recordings.cdr,
            (
                *_modules(DECODING, "codecs", "definitions", "laser_layout", "grids", "names", "poses", "records"),
                *_modules(DECODING, "scan_fields", "scans"),
                "mapgraft.recording.poses.quick_tf",
            ),
            1500,
            bounds={
                f"{DECODING}.definitions:MOST_BYTES": 1400,
                f"{DECODING}.definitions:MOST_DEPTH": 6,
                f"{DECODING}.definitions:MOST_ELEMENTS": 1000,
                f"{DECODING}.laser_layout:_MOST_LAYOUTS": 2,
                "mapgraft.recording.poses.quick_tf:_MOST_TRANSFORMS": 3,
            },
        ),
        Harness(
            "config",
            fuzz_documents.config,
            ("mapgraft.config", "mapgraft.documents"),
            1100,
            bounds={"mapgraft.documents:MOST_BYTES": 1000, "mapgraft.documents:MOST_NODES": 2000},
            damage=damaged_document,
        ),
        Harness(
            "decision",
            fuzz_documents.decision,
            ("mapgraft.decision", "mapgraft.obstacles", "mapgraft.documents"),
            1100,
            bounds={"mapgraft.documents:MOST_BYTES": 1000, "mapgraft.documents:MOST_NODES": 2000},
            damage=damaged_document,
        ),
        Harness(
            "layer",
            fuzz_layers.layer,
            (
                "mapgraft_cloud.codec",
                "mapgraft_floorplan.codec",
                "mapgraft_grid.codec",
                "mapgraft_lines.codec",
                "mapgraft_standard.frames",
                "mapgraft.exchange",
            ),
            2000,
            plain=(
                "mapgraft_cloud.map_type",
                "mapgraft_floorplan.map_type",
                "mapgraft_grid.map_type",
                "mapgraft_lines.map_type",
            ),
        ),
        Harness(
            "message",
            fuzz_messages.message,
            (
                *_modules("mapgraft.network", "packing", "wire"),
                "mapgraft.graph.claims",
                "mapgraft_cloud.cutting",
                "mapgraft_grid.cutting",
                "mapgraft_lines.cutting",
            ),
            4000,
            plain=("mapgraft_cloud.map_type", "mapgraft_grid.map_type", "mapgraft_lines.map_type"),
        ),
        Harness(
            "network",
            fuzz_conversations.conversation,
            _modules("mapgraft.network", "gossip", "held", "meetings", "node", "replica"),
            6000,
            bounds={
                "mapgraft.network.gossip:MOST_EDGES": 3,
                "mapgraft.network.gossip:_AT_ONCE": 300,
                "mapgraft.network.held:MOST_PARTS": 12,
                "mapgraft.network.held:MOST_HELD_BYTES": 3000,
                "mapgraft.network.held:PIECE": 200,
                "mapgraft.network.node:MOST_PEERS": 3,
                "mapgraft.network.node:MOST_TRIES": 3,
                "mapgraft.network.replica:MOST_COPIES": 4,
            },
            damage=fuzz_conversations.disturbed,
        ),
    )
}

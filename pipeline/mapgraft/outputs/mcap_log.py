"""The merge recording: one MCAP with the maps, transforms and events of a run, as ROS 2 would have recorded them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import repeat
from operator import itemgetter
from typing import Any, BinaryIO, TypeVar

import numpy as np
from mcap.writer import CompressionType, Writer

from mapgraft.contracts import Finding, Observation, OutputMessage, Transform
from mapgraft.errors import MapError, PluginError
from mapgraft.events import DonorMap, Event, Snapshot
from mapgraft.outputs.asking import Asking
from mapgraft.outputs.event_message import encode_event, encode_log
from mapgraft.outputs.findings import TOPIC as FINDINGS_TOPIC
from mapgraft.outputs.findings import finding_markers
from mapgraft.outputs.links import MARKERS_TYPE, link_markers
from mapgraft.outputs.messages import LOG_TYPE, MERGE_EVENT, MessageEncoder, check_stamp
from mapgraft.outputs.names import ros_names
from mapgraft.outputs.poses import Path
from mapgraft.outputs.provenance import RunProvenance
from mapgraft.outputs.qos import LATCHED, STREAMED
from mapgraft.outputs.scan_points import POINTS_TYPE, scan_points
from mapgraft.outputs.staging import sync
from mapgraft.outputs.standing import StandingMerge
from mapgraft.outputs.tf import TF_TYPE, FramePair, pose_numbers
from mapgraft_schemas import VERSION, viewer_layout

T = TypeVar("T")
WORLD = "world"
EVENTS, LOG, LINKS, TF, TF_STATIC = "/merge/events", "/rosout", "/merge/links", "/tf", "/tf_static"
RUN_RECORD = "merge_run"  # the metadata record that says which run it is
_BODY_PERIOD_NS = 100_000_000  # at most ten body poses per robot and second of data time
_TYPES = {TF: TF_TYPE, EVENTS: MERGE_EVENT, LOG: LOG_TYPE}
_SHOWN = ("nav_msgs/msg/OccupancyGrid", "sensor_msgs/msg/PointCloud2")
_STAMP = slice(4, 12)  # of a message that begins with a header


class McapLog:
    """Writes one merge recording to a stream; every message carries data time and a number that rises over all topics.

    Messages are expected in order of time. Raises OSError when the stream cannot be written, OutputError when a stamp
    does not fit. A map that its type cannot show is left out, and ``unshown`` says why.
    """

    def __init__(self, stream: BinaryIO, run_id: str, provenance: RunProvenance, asking: Asking | None = None) -> None:
        self._stream, self._asking = stream, asking or Asking()
        self._encoder = MessageEncoder()
        self._names = ros_names()
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._digests: dict[str, bytes] = {}
        self._bodies: dict[str, FramePair] = {}
        self._body_due_ns: dict[str, int] = {}
        self._T_world_map: dict[str, Transform] = {}
        self._shown: dict[str, tuple[str, bool]] = {}  # topic → message type, visible in the layout
        self._sequence = 0
        self.unshown: dict[str, str] = {}  # prefix of the topic → why the map was left out for the first time
        self._writer: Any = Writer(stream, compression=CompressionType.ZSTD)
        self._writer.start("ros2", f"mapgraft/{provenance.version}")
        self._writer.add_metadata(RUN_RECORD, provenance.record(run_id))
        self._writer.add_metadata("merge_schema", {"version": VERSION})
        self._attach("config.yaml", "application/yaml", provenance.config_text)
        self._attach("decision_table.yaml", "application/yaml", provenance.decision_table_text)
        self.durable, self.ended = 0, False  # bytes on disk that end with a whole record; whether that is the last one
        self.flush()

    def went_on(self, paths: Sequence[Path], events: Sequence[tuple[int, Event]] = ()) -> None:
        """What happened since the last call, in order: body poses on /tf, at most ten per robot and second, and events
        as themselves and as lines of the log. ``events`` are numbered as ``Path.order`` is."""
        due: list[tuple[int, str, int, bytes]] = []
        for path in paths:
            rows = self._thinned(path)
            messages = self._body(path.robot).encode(path.stamps_ns[rows], path.numbers[rows])
            due += zip(path.order[rows].tolist(), repeat(TF), path.stamps_ns[rows].tolist(), messages, strict=False)
        for order, event in events:
            check_stamp(event.stamp_ns)
            name = self._names[event.receiver]
            due.append((order, EVENTS, event.stamp_ns, encode_event(event, f"{name}/map")))
            due.append((order, LOG, event.stamp_ns, encode_log(event, f"mapgraft.{name}")))
        due.sort(key=itemgetter(0))
        for _, topic, stamp_ns, message in due:
            self._write(self._channel(topic, _TYPES[topic], STREAMED), stamp_ns, message)

    def placed(self, stamp_ns: int, T_world_map: Mapping[str, Transform]) -> bool:
        """Where every map frame lies from now on, all of them each time, so that the last message says it all.

        Writes nothing and returns False when nothing has changed.
        """
        if T_world_map == self._T_world_map:
            return False
        ends = [(name, T) for name, T in self._T_world_map.items() if T_world_map.get(name) != T]
        # Viewers interpolate between two stamps of a frame: the old place, said again just before, makes it a step.
        steps = [self._transform(name, T, max(stamp_ns - 1, 0)) for name, T in ends if stamp_ns > 0]
        now = [self._transform(name, T, stamp_ns) for name, T in T_world_map.items()]
        # On one topic only: viewers refuse a frame that two topics place.
        self._say(TF_STATIC, TF_TYPE, LATCHED, stamp_ns, WORLD, {"transforms": steps + now})
        self._T_world_map = dict(T_world_map)
        return True

    def linked(self, stamp_ns: int, merges: Sequence[StandingMerge], bodies_m: Mapping[str, np.ndarray]) -> None:
        """Lines in ``world`` between the bodies of robots whose merges stand; ``bodies_m`` (3,) in the map frames."""
        ends = {
            name: self._T_world_map[name].apply(position[None])[0]
            for name, position in bodies_m.items()
            if name in self._T_world_map
        }
        self._say(LINKS, MARKERS_TYPE, LATCHED, stamp_ns, WORLD, link_markers(merges, ends))

    def found(self, stamp_ns: int, robot: str, findings: Sequence[Finding]) -> None:
        """What metrics found in a robot's map, as lines on ``/<robot>/findings``; takes away what was shown before."""
        name = self._names[robot]
        self._say(
            f"/{name}/{FINDINGS_TOPIC}", MARKERS_TYPE, LATCHED, stamp_ns, f"{name}/map", finding_markers(findings)
        )

    def scanned(self, observation: Observation) -> None:
        """What a planar scan hit, as points on ``/<robot>/scan`` in the robot's map frame."""
        fields = scan_points(observation)
        if fields is not None:
            name = self._names[observation.robot]
            self._shown[f"/{name}/scan"] = (POINTS_TYPE, True)
            self._say(f"/{name}/scan", POINTS_TYPE, STREAMED, observation.stamp_ns, f"{name}/map", fields)

    def mapped(self, snapshot: Snapshot) -> None:
        """A robot's own map on ``/<robot>/…``, its fused map on ``/<robot>/merged/…`` and what it has of others on
        ``/<robot>/donors/<donor>/…``, each where it has changed."""
        name = self._names[snapshot.robot]
        for prefix, map_ in ((f"/{name}", snapshot.own), (f"/{name}/merged", snapshot.fused)):
            self._map(snapshot, prefix, DonorMap(snapshot.map_type, map_))
        for donor, placed in snapshot.donors.items():
            self._map(snapshot, f"/{name}/donors/{self._names[donor]}", placed, visible=False)

    def flush(self) -> None:
        """Everything said so far is on disk when this returns."""
        self._writer.flush()
        sync(self._stream)
        self.durable = self._stream.tell()

    def lost(self, losses: Sequence[Mapping[str, str | int]]) -> None:
        """What of the recordings could not be used, as the metadata record ``merge_lost``."""
        self._writer.add_metadata("merge_lost", {"lost": json.dumps(losses)})

    def close(self, span_m: tuple[float, float, float] | None = None) -> bytes:
        """Finish the file (the stream stays open); returns the viewer layout that was attached to it.

        ``span_m`` is centre x, centre y and size of what there is to see in ``world``.
        """
        self._writer.add_metadata("merge_names", {name: robot for robot, name in self._names.given.items()})
        layout = json.dumps(self._layout(span_m), indent=2) + "\n"
        self._attach("layout.json", "application/json", layout)
        self._writer.finish()
        sync(self._stream)
        self.durable, self.ended = self._stream.tell(), True
        return layout.encode()

    def _map(self, snapshot: Snapshot, prefix: str, shown: DonorMap, visible: bool = True) -> None:
        stamp_ns, frame_id = snapshot.stamp_ns, f"{self._names[snapshot.robot]}/map"
        map_type, map_ = shown.map_type, shown.map

        def ask(call: Callable[[], T]) -> T | None:
            try:
                return self._asking.ask(snapshot.robot, map_type, call)
            except (MapError, PluginError) as error:  # too large to show, or a stranger's code
                self.unshown.setdefault(prefix, f"the map on {prefix} could not be shown: {error}")
                return None

        def encoded(message: OutputMessage) -> bytes:
            try:
                return self._encoder.encode(message.message_type, message.fields, stamp_ns, frame_id)
            except PluginError as error:
                raise PluginError(f"cannot be shown: {error}") from error

        for message in ask(lambda: list(map_type.messages(map_))) or ():
            topic, data = f"{prefix}/{message.suffix}", ask(partial(encoded, message))
            if data is None:
                continue
            body = bytearray(data)
            if self._encoder.begins_with_header(message.message_type):
                body[_STAMP] = bytes(8)
            digest = hashlib.blake2b(body, digest_size=16).digest()
            if self._digests.get(topic) != digest:
                self._digests[topic] = digest
                self._shown[topic] = (message.message_type, visible)
                self._write(self._channel(topic, message.message_type, LATCHED), stamp_ns, data)

    def _body(self, robot: str) -> FramePair:
        pair = self._bodies.get(robot)
        if pair is None:
            name = self._names[robot]
            pair = self._bodies[robot] = FramePair(f"{name}/map", f"{name}/base_link")
        return pair

    def _thinned(self, path: Path) -> list[int]:
        rows, due_ns = [], self._body_due_ns.get(path.robot, 0)
        for row, stamp_ns in enumerate(path.stamps_ns.tolist()):
            if stamp_ns >= due_ns:
                rows.append(row)
                due_ns = stamp_ns + _BODY_PERIOD_NS
        self._body_due_ns[path.robot] = due_ns
        return rows

    def _transform(self, robot: str, T: Transform, stamp_ns: int) -> dict[str, object]:
        x, y, z, qx, qy, qz, qw = pose_numbers(T.matrix[None])[0].tolist()
        return {
            "header": {"stamp": _time(stamp_ns), "frame_id": WORLD},
            "child_frame_id": f"{self._names[robot]}/map",
            "transform": {"translation": {"x": x, "y": y, "z": z}, "rotation": {"x": qx, "y": qy, "z": qz, "w": qw}},
        }

    def _say(
        self, topic: str, message_type: str, qos: str, stamp_ns: int, frame_id: str, fields: Mapping[str, object]
    ) -> None:
        data = self._encoder.encode(message_type, fields, stamp_ns, frame_id)
        self._write(self._channel(topic, message_type, qos), stamp_ns, data)

    def _channel(self, topic: str, message_type: str, qos: str) -> int:
        if topic not in self._channels:
            if message_type not in self._schemas:
                text = self._encoder.definition(message_type)
                self._schemas[message_type] = self._writer.register_schema(message_type, "ros2msg", text.encode())
            metadata = {"offered_qos_profiles": qos}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[message_type], metadata)
        return self._channels[topic]

    def _write(self, channel: int, stamp_ns: int, data: bytes) -> None:
        self._writer.add_message(channel, stamp_ns, data, stamp_ns, self._sequence & 0xFFFFFFFF)
        self._sequence += 1

    def _attach(self, name: str, media_type: str, text: str) -> None:
        self._writer.add_attachment(0, 0, name, media_type, text.encode())

    def _layout(self, span_m: tuple[float, float, float] | None) -> dict[str, object]:
        layout = viewer_layout()
        panel = layout["configById"]["3D!mapgraft"]
        for topic, (message_type, visible) in sorted(self._shown.items()):
            if message_type in _SHOWN:
                # frameLocked: a map moves with its frame, also when the frame moves after the map was said
                panel["topics"][topic] = {"visible": visible, "frameLocked": True, "colorMode": "map", "alpha": 0.6}
        if span_m is not None:
            x, y, size = span_m
            panel["cameraState"] |= {"targetOffset": [x, y, 0], "distance": max(size, 10.0)}
        return layout


def _time(stamp_ns: int) -> dict[str, int]:
    return {"sec": stamp_ns // 1_000_000_000, "nanosec": stamp_ns % 1_000_000_000}

"""Small sound inputs of every kind, made here, for mutations to begin from; the same bytes every time."""

from __future__ import annotations

import io
import json
from functools import cache

import numpy as np
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mapgraft.contracts import GridMessage, Observation, Scan, Transform
from mapgraft.contracts.sources import SchemaText

S = 1_000_000_000
LASER, GRID, TF = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/OccupancyGrid", "tf2_msgs/msg/TFMessage"
POSES = (
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Path",
)
NESTED = "a/msg/A"
NESTED_TEXT = (
    "a/B[2] pair\na/B[] more\nstring[<=3] words\nuint8[3] three\nwstring wide\n"
    + "=" * 80
    + "\nMSG: a/B\nfloat64 x\nstring name\n"
)
IDL = "module a { module msg { struct C { float x; sequence<double> y; string name; octet raw[4]; }; }; };"


@cache
def store_of(ros: int):
    """The usual types of either ROS, with TFMessage, which ROS 1's lack."""
    store = get_typestore(Stores.ROS2_HUMBLE if ros == 2 else Stores.ROS1_NOETIC)
    if TF not in store.fielddefs:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


def _time(store, ns: int):
    return store.types["builtin_interfaces/msg/Time"](*divmod(ns, S))


def _header(store, ros: int, frame: str = "map"):
    more = {"seq": 1} if ros == 1 else {}
    return store.types["std_msgs/msg/Header"](stamp=_time(store, 5 * S + 7), frame_id=frame, **more)


def _pose(store):
    types = store.types
    return types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](1.0, 2.0, 0.0), types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    )


def message(store, name: str, ros: int):
    """A message of one of the types that poses, scans and maps come in."""
    types, header = store.types, _header(store, ros)
    if name == LASER:
        numbers = (-1.5, 1.5, 0.5, 0.0, 0.1, 0.1, 30.0)
        ranges = np.array([1.0, 2.0, np.inf, np.nan, 4.0], np.float32)
        return types[name](header, *numbers, ranges, np.zeros(2, np.float32))
    if name == GRID:
        info = types["nav_msgs/msg/MapMetaData"](_time(store, S), 0.05, 3, 2, _pose(store))
        return types[name](header, info, np.array([-1, 0, 100, 50, 0, 0], np.int8))
    vector = types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0)
    moved = types["geometry_msgs/msg/Transform"](vector, types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.6, 0.8))
    edge = types["geometry_msgs/msg/TransformStamped"](header, "base_link", moved)
    if name == POSES[0]:
        return edge
    if name == TF:
        return types[TF]([edge, edge])
    covered = types["geometry_msgs/msg/PoseWithCovariance"](_pose(store), np.eye(6).ravel())
    if name == "nav_msgs/msg/Odometry":
        twist = types["geometry_msgs/msg/Twist"](vector, vector)
        return types[name](
            header, "base_link", covered, types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
        )
    if name == "geometry_msgs/msg/PoseWithCovarianceStamped":
        return types[name](header, covered)
    stamped = types["geometry_msgs/msg/PoseStamped"](header, _pose(store))
    return types["nav_msgs/msg/Path"](header, [stamped, stamped]) if name == "nav_msgs/msg/Path" else stamped


@cache
def message_kinds() -> list[tuple[str, SchemaText | None]]:
    """(encoding, definition) of everything that ``cdr`` begins with; ROS 1 from the second half on."""
    kinds: list[tuple[str, SchemaText | None]] = []
    for ros in (2, 1):
        store = store_of(ros)
        for name in (LASER, GRID, TF, *POSES):
            text = store.generate_msgdef(name, ros_version=ros)[0].encode()
            kinds.append(("cdr" if ros == 2 else "ros1", SchemaText(name, f"ros{ros}msg", text)))
    kinds.append(("cdr", SchemaText(NESTED, "ros2msg", NESTED_TEXT.encode())))
    kinds.append(("cdr", SchemaText("a/msg/C", "ros2idl", IDL.encode())))
    kinds.append(("cdr", SchemaText(LASER, "ros2msg", b"")))
    kinds.append(("ros1", SchemaText("nobody/Knows", "ros1msg", b"")))
    kinds.append(("cdr", SchemaText(LASER, "ros1msg", b"float32 x")))
    kinds += [("json", SchemaText(name, "jsonschema", b"{}")) for name in ("foxglove.LaserScan", *_JSON)]
    kinds += [("protobuf", _protobuf("foxglove.LaserScan")), ("protobuf", SchemaText("a.B", "protobuf", b"\x0a\x02x"))]
    kinds += [("protobuf", SchemaText("a.B", "jsonschema", b"")), ("odd", SchemaText("a/B", "odd", b"")), ("cdr", None)]
    return kinds


_POINT = {"x": 1, "y": 2, "z": 0}
_TURN = {"x": 0, "y": 0, "z": 0, "w": 1}
_STAMP = {"sec": 5, "nsec": 7}
_EDGE = {"timestamp": _STAMP, "parent_frame_id": "map", "child_frame_id": "b", "translation": _POINT, "rotation": _TURN}
_JSON = {
    "foxglove.FrameTransform": _EDGE,
    "foxglove.FrameTransforms": {"transforms": [_EDGE]},
    "foxglove.PoseInFrame": {
        "timestamp": _STAMP,
        "frame_id": "map",
        "pose": {"position": _POINT, "orientation": _TURN},
    },
    "sensor_msgs/LaserScan": {
        "header": {"stamp": {"secs": 5, "nsecs": 7}, "frame_id": "l"},
        "angle_min": -1,
        "angle_max": 1,
        "angle_increment": 0.5,
        "time_increment": 0,
        "scan_time": 0,
        "range_min": 0,
        "range_max": 10,
        "ranges": [1, None, 3],
    },
}
_FOXGLOVE_SCAN = {
    "timestamp": _STAMP,
    "frame_id": "l",
    "pose": {"position": _POINT, "orientation": _TURN},
    "start_angle": -1,
    "end_angle": 1,
    "ranges": [1, 2, 3],
}


def _protobuf_file():
    """The definition of foxglove.LaserScan, as far as a scan needs it."""
    from google.protobuf import descriptor_pb2, timestamp_pb2

    files = descriptor_pb2.FileDescriptorSet()
    timestamp_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    file = files.file.add(name="foxglove/LaserScan.proto", package="foxglove", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    scan = file.message_type.add(name="LaserScan")
    for number, (name, kind, label) in enumerate(
        (("timestamp", 11, 1), ("frame_id", 9, 1), ("start_angle", 1, 1), ("end_angle", 1, 1), ("ranges", 1, 3)), 1
    ):
        field = scan.field.add(name=name, number=number, type=kind, label=label)
        if name == "timestamp":
            field.type_name = ".google.protobuf.Timestamp"
    return files


def _protobuf(name: str) -> SchemaText:
    return SchemaText(name, "protobuf", _protobuf_file().SerializeToString())


def _protobuf_scan() -> bytes:
    import struct

    ranges = struct.pack("<3d", 1.0, 2.0, 3.0)
    fields = b"\x0a\x02\x08\x05" + b"\x12\x01l" + b"\x19" + struct.pack("<d", -1.0) + b"\x21" + struct.pack("<d", 1.0)
    return fields + b"\x2a" + bytes([len(ranges)]) + ranges


def cdr_seeds() -> list[bytes]:
    kinds, seeds = message_kinds(), []
    for k, (encoding, schema) in enumerate(kinds):
        if schema is None or encoding not in ("cdr", "ros1") or schema.name in (NESTED, "a/msg/C", "nobody/Knows"):
            continue
        ros = 2 if encoding == "cdr" else 1
        store = store_of(ros)
        made = message(store, schema.name, ros)
        data = store.serialize_cdr(made, schema.name) if ros == 2 else store.serialize_ros1(made, schema.name)
        seeds.append(bytes([k]) + bytes(data))
        if ros == 2:
            seeds.append(bytes([k]) + bytes(store.serialize_cdr(made, schema.name, little_endian=False)))
    names = [schema.name if schema else "" for _, schema in kinds]
    seeds += [bytes([names.index("foxglove.LaserScan")]) + json.dumps(_FOXGLOVE_SCAN).encode()]
    seeds += [bytes([names.index(name)]) + json.dumps(body).encode() for name, body in _JSON.items()]
    seeds += [bytes([k]) + _protobuf_scan() for k, (encoding, _) in enumerate(kinds) if encoding == "protobuf"]
    seeds += [bytes([k]) + b"\0\1\0\0" for k in range(len(kinds))]
    inner = b"\0\1\0\0" + b"\1\0\0\0" * 12
    seeds += [
        b"\xff" + b"\0".join((b"cdr", b"ros2msg", b"a/msg/A", text, inner))
        for text in (
            NESTED_TEXT.encode(),
            b"a/A self",
            b"float32[4] x\nbool y=True\nstring NAME=a",
            b"a/B[9] b\n" + b"=" * 80 + b"\nMSG: a/B\na/C[] c\n" + b"=" * 80 + b"\nMSG: a/C\n",
            b"float64[99999999999] x",
            b"Header header\nwho/Knows x",
        )
    ]
    seeds.append(b"\xff" + b"\0".join((b"cdr", b"ros2idl", b"a/msg/C", IDL.encode(), inner)))
    joined = "=" * 80 + "\nIDL: a/msg/C\n#include <x>\n" + IDL
    seeds.append(b"\xff" + b"\0".join((b"cdr", b"ros2idl", b"a/msg/C", joined.encode(), inner)))
    return seeds


def mcap_file(
    compression: str = "",
    channels: int = 2,
    count: int = 4,
    finish: bool = True,
    types: tuple[str, ...] = (),
    **options,
) -> bytes:
    """An MCAP file with a few messages in two chunks."""
    kinds = {"": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
    stream, store = io.BytesIO(), store_of(2)
    writer = Writer(stream, chunk_size=1 << 30, compression=kinds[compression], **options)
    writer.start("ros2")
    names = types or (LASER, TF)[:channels]
    ids = []
    for number, name in enumerate(names):
        text = store.generate_msgdef(name, ros_version=2)[0].encode()
        ids.append(writer.register_channel(f"/t{number}", "cdr", writer.register_schema(name, "ros2msg", text)))
    for n in range(count):
        for channel, name in zip(ids, names, strict=True):
            data = bytes(store.serialize_cdr(message(store, name, 2), name))
            writer.add_message(channel, n * S, data, n * S)
        if n == count // 2:
            writer.flush()
    if finish:
        writer.finish()
    return stream.getvalue()


def mcap_seeds() -> list[bytes]:
    small = {"types": (TF,), "count": 2}
    return [
        mcap_file(**small, enable_crcs=False),
        mcap_file(**small, enable_crcs=True),
        mcap_file("zstd", **small),
        mcap_file("lz4", **small),
        mcap_file(finish=False, **small),
        mcap_file(use_chunking=False, **small),
        mcap_file(index_types=IndexType.NONE, use_summary_offsets=False, **small),
        mcap_file(use_statistics=False, repeat_channels=False, repeat_schemas=False, **small),
        mcap_file(types=(LASER,), count=3, enable_crcs=False),
        mcap_file("zstd", types=(LASER,), count=6),
        mcap_file(types=(), count=3, enable_crcs=False),
        mcap_file(count=0),
        b"\x89MCAP0\r\n",
    ]


def carmen_seeds() -> list[bytes]:
    import gzip

    laser = "FLASER 5 1.0 2.0 81.9 3.0 4.0 {n} 0 0.1 {n} 0 0.1 {s} host {s}\n"
    rear = "RLASER 3 1.0 2.0 3.0 {n} 0 0.1 {n} 0 0.1 {s} host {s}\n"
    odom = "ODOM {n} 0 0.1 0.5 0 0 {s} host {s}\n"
    robot = "ROBOTLASER1 0 -1.57 3.14 0.785 80 0.01 0 5 1 2 3 4 81.9 0 {n} 0 0.1 {n} 0 0.1 0 0 0 0 0 {s} host {s}\n"
    old = "LASER_READING 3 1.0 2.0 3.0 {n} 0 0.1 {s}\n"
    true = "TRUEPOS {n} 0 0.1 {n} 0 0.1 {s} host {s}\n"

    def log(*kinds: str, stamps=range(8)) -> bytes:
        text = "# a log\nPARAM a b\n" + "".join(k.format(n=n, s=s) for n, s in enumerate(stamps) for k in kinds)
        return text.encode()

    return [
        log(laser, odom),
        log(robot, odom),
        log(laser, rear, true, stamps=[0.5 * n for n in range(8)]),
        log(old, "ODOM {n} 0 0.1 {s}\n"),
        log(laser, stamps=[0] * 8),
        log(laser, stamps=[100, 101, 102, 3, 4, 5, 6, 7]),
        log(laser, stamps=[100, 101, 0, 103, 104]),
        log(odom),
        gzip.compress(log(laser), mtime=0),
        gzip.compress(log(laser), mtime=0)[:-12],
        log(laser).replace(b"\n", b"\r\n"),
    ]


def config_seeds() -> list[bytes]:
    yaml = [
        b"mission: {start: aligned, start_s: 1, end_s: 6, every: 2}\n",
        b"robots:\n  a: {source: b, files: [x], window: {start_s: 0, end_s: 5}, poses: {topic: /o, file: p.tum}}\n",
        b"map: &m {type: grid, resolution_m: 0.05}\nrobots: {a: {map: *m}}\n",
        b"priors: [{receiver: a, donor: b, x_m: 1, y_m: 2, yaw_rad: 0.5}]\nforbid: [[a, b]]\n",
        b"verdicts: [{merge: a.b.1, action: revert, by: x}]\nrules: r.yaml\n",
        b"limits: {beams: 5, plugin_s: 1.5}\noutput: {scans: true}\nexchange: {use: at, seconds: [1]}\n",
        b"a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n",
        b"? [1, 2]\n: {a: !!set {x, y}}\n'2001-01-01': 2001-01-01 00:00:00\n",
        b"reversal: lodger\nmap: 1\nrobots: {'../x': {}, 'a b': {}}\n--- 2\n",
        b"[[[[[[[[]]]]]]]]\n",
        b"<<: {a: 1}\nx: !!binary aGk=\ny: 0x1f\nz: 1e400\n",
    ]
    toml = [b"[mission]\nstart_s = 1\nend_s = 5\n", b"a = [[[[1]]]]\nb = {c = 2001-01-01}\n", b"x = 1e400\n"]
    return [b"\0" + text for text in yaml] + [b"\1" + text for text in toml]


_PROCEDURE = "match: {use: correlation}, accept: {use: posterior}, fuse: {use: log_odds}, verify: {use: sequential}"


def decision_seeds() -> list[bytes]:
    texts = [
        "- {name: r, " + _PROCEDURE + "}",
        "- {name: r, when: {own.type: occupancy_grid, resolution_ratio: {min: 0.1, max: 10}}, " + _PROCEDURE + "}",
        "- {name: r, when: {own.a: [1, x, true], prior: false}, reject: never, priority: 5}",
        "- {name: r, via: occupancy_grid, candidates: 2, reverse: {allow: [ledger]}, " + _PROCEDURE + "}",
        "- {name: r, match: {use: nosuch}, accept: {use: thresholds, metrics: {similarity: {min: 1}}}, "
        "fuse: {use: log_odds}, verify: {use: thresholds, metrics: [distance], every: 3, log: {every: 9}}}",
        "- {name: r, retry: {growth: 0.5}, refine: {every: null}, metrics: {rays: {}}, " + _PROCEDURE + "}",
        "- {name: r}\n- {name: s, reject: no, match: {use: x}}\n- 5\n- {when: {odd: 1}}",
        "- {name: r, when: {own.observations: {min: .nan, max: -.inf}, other.type: 5}, reject: x}",
        "{}",
        "- &a {name: r, when: {own.type: x}, reject: no}\n- *a",
    ]
    facts = [b"", b'{"own.a": true, "reversal": "ledger", "prior": false}', b'{"own.a": "x", "own.type": 3}', b"[1]"]
    return [text.encode() + (b"\0" + told if told else b"") for text in texts for told in facts]


def layer_seeds() -> list[bytes]:
    import zstandard

    from mapgraft.contracts import MapMetadata, Provenance
    from mapgraft.exchange import Offer
    from mapgraft.graph.claims import Source
    from mapgraft.network.held import Held
    from mapgraft.network.wire import Copy, Hello, Namesake, Parts, Summary, Told, Want, encode
    from mapgraft_grid.map_type import OccupancyGrid

    T = Transform.planar(1.0, 2.0, 0.3)
    angles = np.linspace(-1, 1, 9)
    scan = Scan(np.stack((np.cos(angles), np.sin(angles)), 1), np.full(9, 3.0, np.float32), np.ones(9, np.bool_))
    ready = GridMessage(np.array([[0, 100], [-1, 50]], np.int8), 0.1, Transform.identity())
    layers = []
    for payload, kind in ((None, ""), (scan, "scan"), (ready, "grid_message")):
        grid = OccupancyGrid(resolution_m=0.1)
        layer = grid.new_layer()
        if payload is not None:
            grid.integrate(layer, Observation("a", 0, 0, "laser", kind, payload, T, T))
        layers.append(grid.encode(layer))
    held = Held()
    for version, data in enumerate(layers, start=1):
        held.publish(b"writer-1", b"offer", version, "whole", {b"": data})
    assert held.whole is not None
    a, copy = Source("a", 1), Copy(Source("a", 1), "layer")
    messages = [
        encode(message)
        for message in (
            Hello(b"writer-1", b"offer", bytes(16), bytes(16), (b"claim",)),
            Summary({a: bytes(16)}, (a,), True),
            Told((b"claim", b"another")),
            Want(copy, 2, b"writer-1", False, {b"part": 2}),
            Parts(copy, 1, held.whole, 0, 1, tuple(held.pieces(1, {}, False))),
            Parts(copy, 1, reason="there is none"),
            Namesake(a, b"writer-1"),
        )
    ]
    offers = [
        Offer(Provenance("a", 1, 2), MapMetadata("occupancy_grid", 0.05, bounds_m=bounds, extra={"x": 1})).encode()
        for bounds in (None, (0.0, 0.0, 1.0, 1.0))
    ]
    inner = [zstandard.ZstdDecompressor().decompressobj().decompress(data[8:]) for data in layers]
    return [
        *(b"p" + data for data in layers),
        *(b"m" + data for data in messages),
        *(b"w" + data[4:-8] for data in messages),
        *(b"o" + data for data in offers),
        *(b"i" + data for data in inner),
    ]


SEEDS = {
    "mcap": mcap_seeds,
    "carmen": carmen_seeds,
    "cdr": cdr_seeds,
    "config": config_seeds,
    "decision": decision_seeds,
    "layer": layer_seeds,
}

"""Small sound inputs of every kind, made here, for mutations to begin from; the same bytes every time."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import struct
from functools import cache

import numpy as np
from fuzz_recordings import BETWEEN
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

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
    return [*seeds, *_defined(), *_in_rows(), *_quick()]


def definition(encoding: str, kind: str, name: str, text: str, body: bytes, typestore: str = "") -> bytes:
    """A definition with messages of it, as ``fuzz_recordings.cdr`` takes them apart."""
    return b"\xff" + b"\0".join((*(part.encode() for part in (encoding, kind, name, typestore, text)), body))


def _defined() -> list[bytes]:
    """Definitions in the file: sound, hostile, and none."""
    inner, line = b"\0\1\0\0" + b"\1\0\0\0" * 12, "=" * 80
    chain = f"\n{line}\n".join(["a/B0 x", *(f"MSG: a/B{n}\na/B{n + 1} x" for n in range(8)), "MSG: a/B8\nbool x"])
    texts = (
        NESTED_TEXT,
        "a/A self",
        "float32[4] x\nbool y=True\nstring NAME=a",
        f"a/B[9] b\n{line}\nMSG: a/B\na/C[] c\n{line}\nMSG: a/C\n",
        f"a/B[2000] b\na/B[600] c\na/B[600] d\n{line}\nMSG: a/B\nbool c\n",
        f"a/B[600] c\na/B[600] d\n{line}\nMSG: a/B\nbool c\n",
        f"a/B b\na/B c\n{line}\nMSG: a/B\nstring[3] c\n",
        "float64[99999999999] x",
        "Header header\nwho/Knows x",
        "std_msgs/Header header\nstd_msgs/Header[2] more",
        "\x00\xff",
        "float64 x y z",
        chain,
        "# " + "x" * 1450,
    )
    found = [definition("cdr", "ros2msg", "a/msg/A", text, inner) for text in texts]
    found += [definition("ros1", "ros1msg", "a/A", text, inner[4:]) for text in texts[:6]]
    joined = f"{line}\nIDL: a/msg/C\n#include <x>\n{IDL}"
    found += [definition("cdr", "ros2idl", "a/msg/C", text, inner) for text in (IDL, joined, "module {", "")]
    for name in (LASER, GRID, TF, *POSES, "foxglove/msg/LaserScan", "nobody/msg/Knows", "1/2", "a"):
        found.append(definition("cdr", "ros2msg", name, "", inner))
        found.append(definition("cdr", "ros2msg", name, "float64 x", inner))
        found.append(definition("ros1", "", name, "", inner))
        found.append(definition("json", "", name, "", b"{}"))
    found += [
        definition("cdr", "", LASER, "", inner, typestore) for typestore in ("ros2_jazzy", "ros3", "empty", "latest")
    ]
    beams = "uint8[] stamp\nfloat64 start_angle\nfloat64 end_angle\nfloat64[] ranges\nstring frame_id"
    found.append(definition("cdr", "ros2msg", "foxglove/msg/LaserScan", beams, inner))
    found += [definition("protobuf", "protobuf", "a.B", "\x0a\x02x", b"x"), definition("protobuf", "", "a.B", "", b"x")]
    return found


def _in_rows() -> list[bytes]:
    """Several messages of one channel: alike, of other sizes, with other frames, and damaged."""
    rows = []
    for k, ros in ((0, 2), (8, 1)):
        store = store_of(ros)
        made = message(store, LASER, ros)
        scan = bytes(store.serialize_cdr(made, LASER) if ros == 2 else store.serialize_ros1(made, LASER))
        frame = scan.index(b"map")
        other = scan[:frame] + b"far" + scan[frame + 3 :]
        longer = [scan[:frame] + bytes(4 * n) + scan[frame:] for n in (1, 2)]
        count = scan.index(struct.pack("<I", 5), frame)
        fewer = scan[:count] + struct.pack("<I", 4) + scan[count + 4 :]
        big = b"\0\0" + scan[2:]
        nan = scan.replace(struct.pack("<f", -1.5), struct.pack("<f", math.nan))
        frames = [scan[:frame] + b"f%02d" % n + scan[frame + 3 :] for n in range(5)]
        sized = [_scan_of(ros, beams) for beams in (0, 1, 2, 3)]
        late = scan.replace(struct.pack("<I", 5), struct.pack("<I", 0xFB000005), 1)  # seconds without a sign
        pairs = ((late, late), (scan, scan), (scan, other), (scan, fewer), (scan, big), (scan, nan), (scan[:-1], scan))
        rows += [bytes([k]) + BETWEEN.join(row) for row in (*pairs, frames, sized, (scan, *longer, scan))]
    return rows


def _scan_of(ros: int, beams: int) -> bytes:
    store = store_of(ros)
    sound = message(store, LASER, ros)
    made = dataclasses.replace(sound, ranges=np.ones(beams, np.float32))
    return bytes(store.serialize_cdr(made, LASER) if ros == 2 else store.serialize_ros1(made, LASER))


def _quick() -> list[bytes]:
    """Transforms that the quick way leaves to the general one, and numbers that are none."""
    found = []
    for k, ros in ((2, 2), (10, 1)):
        store = store_of(ros)
        edge = message(store, POSES[0], ros)
        sound = store.types[TF]([edge, edge])
        data = bytes(store.serialize_cdr(sound, TF) if ros == 2 else store.serialize_ros1(sound, TF))
        at = 4 if ros == 2 else 0
        found += [bytes([k]) + data[:at] + struct.pack("<I", n) + data[at + 4 :] for n in (0, 1, 3, 4, 1 << 31)]
        found += [bytes([k]) + data + b"x" * n for n in (1, 4)]
        found += [bytes([k]) + data.replace(b"map\0", b"map\1"), bytes([k]) + data.replace(b"map", b"\xff\xfe\xfd")]
        second = struct.pack("<I", 5)
        found += [bytes([k]) + data.replace(second, struct.pack("<I", s)) for s in (0xFFFFFFFF, 0x7FFFFFFF)]
    grid = store_of(2)
    made = message(grid, GRID, 2)
    for info in ({"width": 0}, {"width": 4}, {"resolution": 0.0}, {"resolution": math.nan}):
        odd = dataclasses.replace(made, info=dataclasses.replace(made.info, **info))
        found.append(b"\1" + bytes(grid.serialize_cdr(odd, GRID)))
    unturned = dataclasses.replace(made.info.origin.orientation, w=0.0)
    origin = dataclasses.replace(made.info.origin, orientation=unturned)
    odd = dataclasses.replace(made, info=dataclasses.replace(made.info, origin=origin))
    return [*found, b"\1" + bytes(grid.serialize_cdr(odd, GRID))]


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

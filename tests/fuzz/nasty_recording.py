"""A small MCAP recording of robots that drive and scan, spoilt as one likes."""

from __future__ import annotations

import io
from functools import cache

import numpy as np
from fuzz_seeds import LASER, TF, store_of
from mcap.writer import CompressionType, Writer
from nasty_case import S


@cache
def sound_recording() -> bytes:
    """A robot called scan that stands still for three seconds."""
    return recording()


def recording(
    topic: str = "/scan",
    scans: int = 4,
    beams: int = 40,
    frame: str = "laser",
    poses: bool = True,
    x_m=lambda n: 0.1 * n,
    stamp=lambda n: n * S + S,
    topics: int = 1,
    edge: tuple[str, str] = ("map", "laser"),
    attachment: str = "",
    definition: bytes | None = None,
    schema: str = LASER,
    kind: str = "ros2msg",
    encoding: str = "cdr",
    angle: float = -1.0,
    quaternion=(0.0, 0.0, 0.0, 1.0),
    log=lambda n: n * S + S,
    tf_stamp=None,
    extra: tuple[tuple[int, str, str], ...] = (),
) -> bytes:
    """An MCAP file of one or many robots; every argument is a way to spoil it.

    ``extra`` transforms (parent, child) are told beside the n-th scan.
    """

    store, stream = store_of(2), io.BytesIO()
    writer = Writer(stream, compression=CompressionType.NONE)
    writer.start("ros2")
    text = store.generate_msgdef(LASER, ros_version=2)[0].encode() if definition is None else definition
    laser = writer.register_schema(schema, kind, text)
    tf = writer.register_schema(TF, "ros2msg", store.generate_msgdef(TF, ros_version=2)[0].encode())
    names = [topic] if topics == 1 else [f"/r{n}{topic}" for n in range(topics)]
    channels = [writer.register_channel(name, encoding, laser) for name in names]
    tf_channel = writer.register_channel("/tf", "cdr", tf)
    types = store.types
    for n in range(scans):
        time = types["builtin_interfaces/msg/Time"](*divmod(stamp(n), S))
        tf_time = types["builtin_interfaces/msg/Time"](*divmod((tf_stamp or stamp)(n), S))
        for number, channel in enumerate(channels):
            own = frame if topics == 1 else f"r{number}/{frame}"
            header = types["std_msgs/msg/Header"](time, own)
            ranges = np.full(beams, 2.0 + 0.01 * n, np.float32)
            scan = types[LASER](header, angle, 1.0, 0.05, 0.0, 0.1, 0.1, 30.0, ranges, np.zeros(0, np.float32))
            log_ns = log(n)
            writer.add_message(channel, log_ns, bytes(store.serialize_cdr(scan, LASER)), log_ns)
            if poses:
                told = edge if topics == 1 else (f"r{number}/map", own)
                edges = (told, *((parent, child) for k, parent, child in extra if k == n))
                turn = quaternion(n) if callable(quaternion) else quaternion
                writer.add_message(tf_channel, log_ns, _transforms(store, tf_time, edges, float(x_m(n)), turn), log_ns)
    if attachment:
        writer.add_attachment(S, S, attachment, "text/plain", b"root::0:0\n")
    writer.finish()
    return stream.getvalue()


def _transforms(store, time, edges, x_m: float, quaternion) -> bytes:
    """A tf message: each (parent, child) has the same place."""
    types = store.types
    vector = types["geometry_msgs/msg/Vector3"](x_m, 0.0, 0.0)
    moved = types["geometry_msgs/msg/Transform"](vector, types["geometry_msgs/msg/Quaternion"](*quaternion))
    stamped = [
        types["geometry_msgs/msg/TransformStamped"](types["std_msgs/msg/Header"](time, parent), child, moved)
        for parent, child in edges
    ]
    return bytes(store.serialize_cdr(types[TF](stamped), TF))

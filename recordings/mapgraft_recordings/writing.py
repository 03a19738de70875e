"""Simulated messages into an MCAP file of profile ``ros2``: zstd, and the same bytes for the same messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from mapgraft.outputs.messages import MessageEncoder
from mapgraft.outputs.qos import LATCHED, STREAMED
from mapgraft_recordings.simulator.messages import Message

_CHUNK_BYTES = 1 << 20


def write_mcap(path: Path, messages: Iterable[Message]) -> None:
    """Write messages in the order given; the file gets its name only when it is complete."""
    partial = path.with_name(f".{path.name}.partial")
    with partial.open("wb") as stream:
        recording = _Recording(stream)
        for message in messages:
            recording.add(message)
        recording.finish()
    partial.replace(path)


class _Recording:
    """An MCAP file that is being written, with a channel per topic."""

    def __init__(self, stream: BinaryIO) -> None:
        self._writer = Writer(stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="mapgraft_recordings")
        self._encoder = MessageEncoder()
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add(self, message: Message) -> None:
        if message.topic not in self._channels:
            self._channels[message.topic] = self._channel(message)
        data = self._encoder.encode(message.message_type, message.fields, message.stamp_ns, "")
        self._writer.add_message(self._channels[message.topic], message.stamp_ns, data, message.stamp_ns)

    def finish(self) -> None:
        finish: Callable[[], object] = self._writer.finish  # which has no annotations
        finish()

    def _channel(self, message: Message) -> int:
        kind = message.message_type
        if kind not in self._schemas:
            definition = self._encoder.definition(kind).encode()
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition)
        qos = LATCHED if message.topic == "/tf_static" else STREAMED
        return self._writer.register_channel(message.topic, "cdr", self._schemas[kind], {"offered_qos_profiles": qos})

"""Writing recordings: ROS 2 messages into one MCAP file, and any recordings converted into one."""

from __future__ import annotations

import heapq
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from mcap.writer import CompressionType, Writer

from mapgraft.contracts.sources import Channel, Fault, ReadFaults, SchemaText, Source
from mapgraft.errors import OutputError, RecordingError, UsageError
from mapgraft.recording.containers.limits import DEFAULT_LIMITS, ReadLimits
from mapgraft.recording.containers.opening import Reader, open_source
from mapgraft.recording.conversion import Convert, Output, Untold, converters
from mapgraft.recording.decoding.codecs import DEFAULT_TYPESTORE
from mapgraft.recording.losses import fault_sentences
from mapgraft.recording.reach import is_there
from mapgraft.recording.ros2_types import Encoded

CHUNK_BYTES = 1 << 20

# Complete, because readers refuse profiles with fields left out; transient local: late listeners get the last message.
LATCHED_QOS = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 2147483647, nsec: 4294967295}
  lifespan: {sec: 2147483647, nsec: 4294967295}
  liveliness: 1
  liveliness_lease_duration: {sec: 2147483647, nsec: 4294967295}
  avoid_ros_namespace_conventions: false
"""


class RecordingWriter:
    """Writes one MCAP file of profile ``ros2``: CDR messages, zstd chunks of 1 MiB, equal bytes for equal messages.

    Use it as a context manager: the file is written as ``.<name>.partial`` beside its place and gets its name, synced
    to the disk, when the block ends well; otherwise the partial file is removed. Give messages in order of log time,
    so that chunks do not overlap. Raises OutputError when the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._partial = path.with_name(f".{path.name}.partial")
        self._schemas: dict[SchemaText, int] = {}
        self._channels: dict[tuple[str, SchemaText], int] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._partial.unlink(missing_ok=True)  # a rest, or a link, which is not written through
            self._stream: BinaryIO = self._partial.open("xb")
        except OSError as error:
            raise _unwritable(path, error) from error
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="mapgraft")

    def write(self, topic: str, message: Encoded, log_ns: int, *, latched: bool = False) -> None:
        """Add one message; ``log_ns`` must not be negative."""
        key = (topic, message.schema)
        try:
            if key not in self._channels:
                self._channels[key] = self._channel(topic, message.schema, latched)
            self._writer.add_message(self._channels[key], log_ns, bytes(message.data), log_ns)
        except OSError as error:
            raise _unwritable(self._path, error) from error

    def _channel(self, topic: str, schema: SchemaText, latched: bool) -> int:
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        metadata = {"offered_qos_profiles": LATCHED_QOS if latched else ""}
        return self._writer.register_channel(topic, "cdr", self._schemas[schema], metadata)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                self._complete()
        except OSError as problem:
            raise _unwritable(self._path, problem) from problem
        finally:
            self._stream.close()
            self._partial.unlink(missing_ok=True)

    def _complete(self) -> None:
        finish: Callable[[], object] = self._writer.finish  # which has no annotations
        finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()
        self._partial.replace(self._path)
        folder = os.open(self._path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _unwritable(path: Path, error: OSError) -> OutputError:
    return OutputError(f"{path} cannot be written: {error.strerror or error}")


@dataclass(frozen=True, slots=True)
class Written:
    """How many messages of a type were written on a topic."""

    topic: str
    message_type: str
    count: int


@dataclass(frozen=True, slots=True)
class Skipped:
    """Messages that were left out, and why; ``count`` is None where nobody counted them."""

    file: str
    topic: str
    message_type: str
    count: int | None
    reason: str


@dataclass(frozen=True, slots=True)
class ConversionReport:
    """What a conversion wrote and left out, and what was wrong with the recordings, each by its file's name."""

    path: Path
    written: tuple[Written, ...]
    skipped: tuple[Skipped, ...]
    faults: tuple[tuple[str, Fault], ...]

    def __str__(self) -> str:
        rows = [f"{self.path}: {sum(row.count for row in self.written)} messages"]
        rows += [f"  {row.topic} ({row.message_type}): {row.count}" for row in self.written]
        rows += [
            f"  left out of {row.file}: {row.topic} ({row.message_type or 'no type'}), "
            f"{'some' if row.count is None else row.count} message(s): {row.reason}"
            for row in self.skipped
        ]
        rows += [f"  {sentence}" for sentence in fault_sentences(self.faults)]
        return "\n".join(rows)


def convert(
    paths: Sequence[str | Path],
    out: str | Path,
    *,
    typestore: str | None = None,
    readers: Sequence[Reader] = (),
    limits: ReadLimits = DEFAULT_LIMITS,
) -> ConversionReport:
    """Convert recordings of any kind into one ROS 2 MCAP file, in order of log time.

    Messages of types that cannot be told in ROS 2 are left out and counted. Where two files have a topic in common,
    the topics of every file begin with the file's name (``/robot1/scan``), so that robots stay apart. ``limits`` bound
    what a file may unpack to. Equal inputs give equal bytes. Raises RecordingError when a recording cannot be opened or
    nothing of it can be converted, UsageError when ``out`` is one of the inputs or not an .mcap file, OutputError when
    it cannot be written.
    """
    files, target = [Path(path) for path in paths], Path(out)
    _check(files, target)
    with ExitStack() as stack:
        sources = [
            stack.enter_context(open_source(file, typestore=typestore, readers=readers, limits=limits))
            for file in files
        ]
        inputs = [
            _Input(source, prefix, typestore or DEFAULT_TYPESTORE)
            for source, prefix in zip(sources, _prefixes(sources), strict=True)
        ]
        counts: Counter[tuple[str, str]] = Counter()
        if not any(item.channels for item in inputs):
            raise RecordingError(_nothing_in(files))
        with RecordingWriter(target) as writer:
            merged = heapq.merge(*(item.outputs() for item in inputs), key=lambda timed: timed[0])
            for log_ns, output in merged:
                writer.write(output.topic, output.message, log_ns, latched=output.latched)
                counts[output.topic, output.message.schema.name] += 1
            faults = tuple(fault for item in inputs for fault in item.all_faults())
            if not counts:
                raise RecordingError("; ".join([f"{_nothing_in(files)}: no message is left", *fault_sentences(faults)]))
        skipped = tuple(row for item in inputs for row in item.skipped())
    written = tuple(Written(topic, kind, count) for (topic, kind), count in sorted(counts.items()))
    return ConversionReport(target, written, skipped, faults)


def _nothing_in(files: Sequence[Path]) -> str:
    return f"nothing in {', '.join(map(str, files))} can be converted to ROS 2"


def _check(files: Sequence[Path], target: Path) -> None:
    if not files:
        raise UsageError("convert needs at least one recording")
    if target.suffix != ".mcap":
        raise UsageError(f"recordings are converted to MCAP, so the output must end in .mcap, found {target.name!r}")
    if any(is_there(file) and is_there(target) and file.samefile(target) for file in files):
        raise UsageError(f"{target} is one of the recordings to convert: choose another output")


def _prefixes(sources: Sequence[Source]) -> list[str]:
    """What to put before the topics of each file: nothing, as long as no two files share a topic."""
    topics = Counter(topic for source in sources for topic in {channel.topic for channel in source.channels})
    if all(count == 1 for count in topics.values()):
        return [""] * len(sources)
    prefixes: list[str] = []
    for source in sources:
        name = re.sub(r"\W", "_", source.path.name.partition(".")[0], flags=re.ASCII)
        name = name if name[:1].isalpha() else f"file_{name}"
        taken = sum(1 for prefix in prefixes if re.fullmatch(rf"/{name}(_\d+)?", prefix))
        prefixes.append(f"/{name}_{taken + 1}" if taken else f"/{name}")
    return prefixes


class _Input:
    """One recording on its way into the new file."""

    def __init__(self, source: Source, prefix: str, typestore: str) -> None:
        self._source = source
        self._prefix = prefix
        self._lost = ReadFaults()
        self._untold: list[tuple[Channel, str]] = []
        self.channels: dict[int, Convert] = {}
        found = converters(source, typestore)
        for channel in source.channels:
            way = found[channel.id]
            if isinstance(way, Untold):
                self._untold.append((channel, way.why_not))
            else:
                self.channels[channel.id] = way

    def outputs(self) -> Iterator[tuple[int, Output]]:
        """The converted messages with their log times, in order."""
        topics = {channel.topic for channel in self._source.channels if channel.id in self.channels}
        for raw in self._source.messages(topics):
            way = self.channels.get(raw.channel.id)
            if way is None:
                continue
            try:
                if raw.log_ns < 0:
                    raise RecordingError("a message was recorded before the year 1970")
                outputs = way(raw)
            except RecordingError as error:
                self._lost.add("message_unconvertible", str(error), topic=raw.channel.topic)
                continue
            for output in outputs:
                yield raw.log_ns, output._replace(topic=self._prefix + _absolute(output.topic))

    def skipped(self) -> list[Skipped]:
        name = self._source.path.name
        return [Skipped(name, c.topic, c.message_type, c.count, why_not) for c, why_not in self._untold]

    def all_faults(self) -> list[tuple[str, Fault]]:
        return [(self._source.path.name, fault) for fault in (*self._source.faults, *self._lost)]


def _absolute(topic: str) -> str:
    return topic if topic.startswith("/") else f"/{topic}"

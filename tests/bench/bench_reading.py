"""Reading a large MCAP file of laser scans, against bare decompression of its chunks and against mcap with rosbags.

Run on demand: ``python tests/bench/bench_reading.py [--megabytes 300] [--rounds 5]``. The files are made in the
temporary folder and removed. Every round measures all ways in turn; ratios are of the best of each, and the median of
the ratios within the rounds is printed beside them, because other work on the machine comes and goes.
"""

from __future__ import annotations

import argparse
import gc
import statistics
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from mapgraft.recording.containers.mapping import map_file
from mapgraft.recording.containers.mcap_file import McapSource
from mapgraft.recording.containers.mcap_records import Record, chunk_head

BEAMS = 1081
TYPE = "sensor_msgs/msg/LaserScan"
KINDS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
MEMORY_LIMIT_MB = 100
SPEED_LIMIT = 0.6


def write_scans(path: Path, kind: str, scans: int) -> None:
    """Scans of a wavy wall, in millimetres with a centimetre of noise, in chunks of 1 MiB."""
    types = get_typestore(Stores.ROS2_HUMBLE)
    angles = np.linspace(-2.3, 2.3, BEAMS)
    noise = np.random.default_rng(0)
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 20, compression=KINDS[kind])
        writer.start("ros2")
        schema = writer.register_schema(TYPE, "ros2msg", types.generate_msgdef(TYPE, ros_version=2)[0].encode())
        channel = writer.register_channel("/scan", "cdr", schema, {"offered_qos_profiles": ""})
        for n in range(scans):
            ranges = np.round(5 + 3 * np.sin(3 * angles + n / 100) + noise.normal(0, 0.01, BEAMS), 3)
            stamp = types.types["builtin_interfaces/msg/Time"](sec=n // 40, nanosec=n % 40 * 25_000_000)
            message = types.types[TYPE](
                header=types.types["std_msgs/msg/Header"](stamp=stamp, frame_id="laser"),
                angle_min=-2.3,
                angle_max=2.3,
                angle_increment=4.6 / (BEAMS - 1),
                time_increment=0.0,
                scan_time=0.025,
                range_min=0.1,
                range_max=30.0,
                ranges=ranges.astype(np.float32),
                intensities=np.zeros(0, np.float32),
            )
            writer.add_message(channel, n * 25_000_000, bytes(types.serialize_cdr(message, TYPE)), n * 25_000_000)
        writer.finish()


def bare(path: Path, kind: str, *, checked: bool = False) -> int:
    """Decompress every chunk and do nothing else, or check its CRC too."""
    view, size = map_file(path), 0
    unpack: dict[str, Callable[[memoryview, int], bytes | memoryview]] = {
        "none": lambda packed, _: packed,
        "lz4": lambda packed, _: lz4.frame.decompress(packed),
        "zstd": lambda packed, length: zstandard.ZstdDecompressor().decompress(packed, max_output_size=length),
    }
    with McapSource(path) as source:
        places = source._places
    for place in places:
        head = chunk_head(view, Record(6, place.offset, place.offset + 9, place.end, True))
        assert head is not None
        data = unpack[kind](view[head.begin : head.end], head.size)
        size += len(data)
        assert not checked or zlib.crc32(data) == head.crc
    return size


def by_scans(path: Path, _: str) -> int:
    """Every scan with its stamp, frame and ranges, by ``McapSource.scans``."""
    with McapSource(path) as source:
        return sum(1 for recorded in source.scans() if recorded.scan.stamp_ns >= 0 and len(recorded.scan.ranges_m))


def by_messages(path: Path, _: str) -> int:
    """The same by ``messages`` and ``decode_scan``."""
    with McapSource(path) as source:
        decode = source.decode_scan
        return sum(1 for raw in source.messages() if len(decode(raw).ranges_m))


def by_mcap_and_rosbags(path: Path, _: str) -> int:
    """mcap's fastest reader, messages decoded by rosbags."""
    types = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("rb") as stream:
        messages = NonSeekingReader(stream).iter_messages(log_time_order=False)
        return sum(1 for _, _, message in messages if types.deserialize_cdr(message.data, TYPE))


WAYS: dict[str, Callable[[Path, str], int]] = {
    "bare": bare,
    "bare + CRC": partial(bare, checked=True),
    "scans": by_scans,
    "messages": by_messages,
    "mcap+rosbags": by_mcap_and_rosbags,
}


def measure(path: Path, kind: str, rounds: int, megabytes: float) -> float:
    """Print the speed of every way; the ratio of ``scans`` to bare decompression (best of each)."""
    seconds: dict[str, list[float]] = {way: [] for way in WAYS}
    for _ in range(rounds):
        for way, run in WAYS.items():
            gc.collect()
            start = time.perf_counter()
            run(path, kind)
            seconds[way].append(time.perf_counter() - start)
    for way, times in seconds.items():
        ratios = [one / other for one, other in zip(seconds["bare"], times, strict=True)]
        print(
            f"  {kind:5} {way:13} {megabytes / min(times):7.0f} MB/s   "
            f"{min(seconds['bare']) / min(times):5.0%} of bare decompression (median {statistics.median(ratios):.0%})"
        )
    return min(seconds["bare"]) / min(seconds["scans"])


def memory_growth_mb(path: Path) -> float:
    """How much anonymous memory a process grows by while it reads the whole file (mapped file pages aside)."""
    script = (
        "import sys; from pathlib import Path; from mapgraft.recording.containers.mcap_file import McapSource\n"
        "def anonymous():\n"
        "    rows = dict(line.split(':', 1) for line in open('/proc/self/status'))\n"
        "    return int(rows['RssAnon'].split()[0]) / 1024\n"
        "source = McapSource(Path(sys.argv[1])); before = peak = anonymous()\n"
        "for n, recorded in enumerate(source.scans()):\n"
        "    peak = max(peak, anonymous()) if n % 500 == 0 else peak\n"
        "print(peak - before)"
    )
    done = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True)
    return float(done.stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    scans = arguments.megabytes * 10**6 // (4 * BEAMS + 100)
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS:
            path = Path(folder) / f"{kind}.mcap"
            write_scans(path, kind, scans)
            packed = path.stat().st_size / 1e6
            print(f"{kind}: {scans} scans of {BEAMS} beams, {arguments.megabytes} MB, file {packed:.0f} MB")
            ratio = measure(path, kind, arguments.rounds, arguments.megabytes)
            growth = memory_growth_mb(path)
            print(f"  {kind:5} memory growth {growth:.0f} MB (limit {MEMORY_LIMIT_MB})")
            if kind != "none":
                print(f"  {kind:5} {'reaches' if ratio >= SPEED_LIMIT else 'MISSES'} {SPEED_LIMIT:.0%}")
            path.unlink()


if __name__ == "__main__":
    main()

"""Bytes of bags: ROS 1 bags, and the databases of ROS 2 bags."""

from __future__ import annotations

from contextlib import suppress

from fuzz_recordings import Run, of_file, read_through, scratch


def bag() -> Run:
    """The first byte chooses what is asked of the bag in the others."""
    from mapgraft.recording.containers.bag_file import BagSource

    return of_file(BagSource, scratch("a.bag"))


def db3() -> Run:
    """The first byte chooses what is asked of the database in the others."""
    from mapgraft.errors import MapgraftError
    from mapgraft.recording.containers.limits import ReadLimits
    from mapgraft.recording.containers.sqlite_file import SqliteSource

    path = scratch("a.db3")
    log = path.with_name("a.db3-wal")
    narrow, wide = ReadLimits(chunk_bytes=500, expansion=2.0), ReadLimits(chunk_bytes=1 << 20)

    def run(data: bytes) -> None:
        mode = data[0] if data else 0
        path.write_bytes(data[1:])
        if mode & 64:
            log.write_bytes(data[-200:])
        with suppress(MapgraftError):
            read_through(SqliteSource(path, limits=narrow if mode & 32 else wide), mode)
        path.unlink()
        log.unlink(missing_ok=True)
        log.with_name("a.db3-shm").unlink(missing_ok=True)

    return run

"""A plugin with a file format for the map type of ``beacons``: one whole metre to a line."""

from __future__ import annotations

from pathlib import Path

from mapgraft.contracts import Descriptor, MapError, hookimpl


def read(path: Path) -> tuple[int, ...]:
    """The places at which a beacon was heard."""
    try:
        return tuple(int(line) for line in path.read_text().split())
    except ValueError as error:
        raise MapError(f"{path.name} must hold whole numbers: {error}") from None


@hookimpl
def register_formats(register):
    register(
        Descriptor("lines", "beacon_files:read", "one whole metre to a line", accepts=(".beacons",), gives="heard")
    )

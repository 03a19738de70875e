"""What a run needs of whatever keeps it: a folder, or the tables of a data set."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Any, Protocol, Self

import pyarrow as pa

from mapgraft.events import Sink
from mapgraft.network.radio import Traffic
from mapgraft.outputs.provenance import RunProvenance


class RunOutput(Sink, Protocol):
    """A sink that also keeps what is known when a run is over; left by an error, it keeps no finished run.

    ``unshown`` says which maps could not be written, ``unfinished`` what other runs have left behind, in sentences.
    """

    @property
    def unshown(self) -> Sequence[str]: ...
    @property
    def unfinished(self) -> Sequence[str]: ...
    def open(self) -> Self:
        """Begin to write; whatever comes through on the way leaves nothing of what was begun."""
        ...

    def exemplified(self, rows: pa.Table) -> None:
        """Rows of the table of examples, in its schema."""
        ...

    def write_maps(self) -> None: ...
    def keep(self, name: str, data: bytes) -> None: ...
    def timed(self, stage: str, elapsed_s: float, count: int = 0) -> None: ...
    def carried(self, traffic: Traffic) -> None: ...
    def lost(self, losses: Sequence[Mapping[str, str | int]]) -> None: ...
    def noticed(self, remarks: Sequence[str]) -> None: ...
    def audited(self, findings: list[dict[str, Any]]) -> None: ...
    def finish(self) -> None: ...
    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


OpenOutput = Callable[[str, str, RunProvenance], RunOutput]
"""Opens one for a run: its stem, its id, what it is made of."""

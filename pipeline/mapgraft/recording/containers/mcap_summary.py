"""What an MCAP file's summary says, and how much of that can be believed."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter

from mcap.records import ChunkIndex, Footer

from mapgraft.contracts.sources import ReadFaults
from mapgraft.recording.containers.mcap_records import (
    FOOTER_BYTES,
    MAGIC,
    OPCODE_CHUNK,
    RECORD_HEAD,
    Parsed,
    Record,
    parsed,
    records,
)
from mapgraft.recording.containers.mcap_shapes import next_beginning
from mapgraft.recording.containers.octets import Octets

_WALKED = "the file is walked instead"


@dataclass(frozen=True, slots=True)
class Summary:
    """The records of a summary from ``begin`` on; not ``trusted`` when they do not match their checksum, and
    not ``checked`` when there is none."""

    begin: int
    values: Sequence[Parsed]
    trusted: bool
    checked: bool


def read_summary(view: Octets, faults: ReadFaults) -> Summary | None:
    """The summary of a whole file; None when there is none. Adds what is wrong with it to ``faults``."""
    if len(view) < len(MAGIC) + FOOTER_BYTES or bytes(view[-len(MAGIC) :]) != MAGIC:
        faults.add("cut_off", "the recording was cut off (it has no end mark): what was written is read", place=0)
        return None
    end = len(view) - FOOTER_BYTES
    footer = parsed(view, Record(2, end, end + RECORD_HEAD, end + RECORD_HEAD + 20, True))
    is_footer = view[end] == 2 and int.from_bytes(view[end + 1 : end + RECORD_HEAD], "little") == 20
    if not is_footer or not isinstance(footer, Footer) or not 0 <= footer.summary_start <= end:
        faults.add("summary_damaged", f"the recording's summary cannot be found: {_WALKED}", place=0)
        return None
    if footer.summary_start == 0:
        return None
    checked = view[footer.summary_start : end + RECORD_HEAD + 16]
    trusted = not footer.summary_crc or zlib.crc32(checked) == footer.summary_crc
    if not trusted:
        faults.add("summary_damaged", f"the recording's summary is damaged: {_WALKED}", place=0)
    values = [parsed(view, record) for record in records(view, footer.summary_start, end)]
    found = [value for value in values if value is not None]
    return Summary(footer.summary_start, found, trusted, bool(footer.summary_crc))


def believable_chunks(view: Octets, summary: Summary | None, faults: ReadFaults) -> list[ChunkIndex]:
    """The entries of the chunk index that can all be true at once, by where they begin; none without a summary.

    As long as the chunks lie one behind the other, the summary has a checksum, and the first and the last chunk are
    where it says, no other chunk is looked at.
    """
    if summary is None or not summary.trusted:
        return []
    told = sorted((v for v in summary.values if isinstance(v, ChunkIndex)), key=attrgetter("chunk_start_offset"))
    kept = _disjoint(told, summary.begin)
    orderly = all(_behind(one) <= other.chunk_start_offset for one, other in pairwise(told))
    moved = any(_is_elsewhere(view, kept[:n]) for n in {1, len(kept)} if kept)
    if moved or not (summary.checked and orderly and len(kept) == len(told)):
        kept = _disjoint([value for value in told if _is_there(view, value)], summary.begin)
    if len(kept) < len(told):
        sentence = f"{len(told) - len(kept)} of {len(told)} entries of the recording's chunk index cannot be true"
        faults.add("summary_damaged", f"{sentence}: what they should tell is searched for", place=1)
    return kept


def _disjoint(told: Sequence[ChunkIndex], stop: int) -> list[ChunkIndex]:
    kept: list[ChunkIndex] = []
    reached = len(MAGIC)
    for value in told:
        after = value.chunk_start_offset + value.chunk_length
        fits = reached <= value.chunk_start_offset and after <= stop and value.chunk_length > RECORD_HEAD
        if fits and value.message_start_time <= value.message_end_time:
            kept.append(value)
            reached = after
    return kept


def _behind(value: ChunkIndex) -> int:
    """Where the chunk and its message indexes end."""
    return int(value.chunk_start_offset + value.chunk_length + value.message_index_length)


def _is_there(view: Octets, value: ChunkIndex) -> bool:
    """Whether there is a chunk of that length at that place."""
    record = next(records(view, value.chunk_start_offset, len(view)), None)
    return record is not None and record.opcode == OPCODE_CHUNK and record.end == record.offset + value.chunk_length


def _is_elsewhere(view: Octets, told: Sequence[ChunkIndex]) -> bool:
    """Whether the last of these chunks is not where it should be, but begins between the one before and its own end."""
    if _is_there(view, told[-1]):
        return False
    end = told[-1].chunk_start_offset + told[-1].chunk_length
    begin = _behind(told[-2]) if len(told) > 1 else len(MAGIC)
    return next_beginning(view, begin, end, bare=False) < end

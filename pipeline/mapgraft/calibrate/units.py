"""What of examples can be taken for independent: the same two maps are one thing, however often they were matched."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

Unit = tuple[str, ...]
UNIT_COLUMNS: Final = (
    *("run_id", "example_id", "merge_id", "receiver", "donor", "receiver_version", "donor_version"),
    *("recording", "recording_sha256", "stamp", "pair_sha256"),
)


def unit_of(row: Mapping[str, Any]) -> Unit:
    """What an example (a row with ``UNIT_COLUMNS``) is one look at; equal for examples that are not independent.

    Two robots of a recording are one unit: they may meet again, or be run again with another configuration. So are two
    windows that an evaluation has drawn: they may be mapped at other resolutions, or judged by other rules. Examples of
    versions that did not tell the pair's digest are known by their recordings, and by what was drawn of them.
    """
    if row.get("pair_sha256"):
        return (row["pair_sha256"],)
    read = tuple(row.get("recording_sha256") or (row["run_id"],))
    if row["merge_id"] is not None:
        return (*read, *sorted((row["receiver"], row["donor"])))
    drawn = (row.get(name) for name in ("recording", "stamp", "receiver_version", "donor_version"))
    return (*read, *map(str, drawn), row["example_id"].partition(".")[0])

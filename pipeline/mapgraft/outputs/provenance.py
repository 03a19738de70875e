"""What a run was made of: software, plugins, configuration, decision table, input files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime


@dataclass(frozen=True, slots=True)
class InputFile:
    """One file that was replayed; ``path`` as it was given, ``sha256`` of its bytes in hex.

    A file of an object store may be known by the store's ``etag`` instead, which changes with its contents: then
    ``sha256`` is empty, for nobody has read the file whole. ``modified_ns`` is when a file on a disk was last written,
    where somebody wants to know it again by that.
    """

    path: str
    sha256: str
    size_bytes: int
    etag: str = ""
    modified_ns: int | None = None

    @property
    def identity(self) -> str:
        """Equal for equal contents, as far as these are known."""
        return self.sha256 or f"etag {self.etag} {self.size_bytes}"

    @property
    def told(self) -> dict[str, str | int]:
        """The file as documents tell of it: path, digest and size, and the etag where it has one."""
        known: dict[str, str | int] = {"path": self.path, "sha256": self.sha256, "size_bytes": self.size_bytes}
        return known | ({"etag": self.etag} if self.etag else {})


@dataclass(frozen=True, slots=True)
class RunProvenance:
    """Everything needed to make the same run again.

    ``plugins`` maps a plugin's name to its distribution and version. ``config_text`` and ``decision_table_text`` are
    YAML as used, with everything that was left out filled in. ``started_at`` (with a time zone) and ``host`` are the
    only things that differ between equal replays; they go nowhere but into the metadata record ``merge_run``.
    """

    version: str
    config_text: str
    decision_table_text: str
    inputs: Sequence[InputFile]
    started_at: datetime
    host: str
    plugins: Mapping[str, str] = field(default_factory=dict)

    def record(self, run_id: str) -> dict[str, str]:
        """The metadata record ``merge_run``; of one length for one host, so that file offsets do not depend on time."""
        return {
            "run_id": run_id,
            "software": "mapgraft",
            "version": self.version,
            "plugins": json.dumps(dict(sorted(self.plugins.items()))),
            "config_sha256": _digest(self.config_text),
            "decision_table_sha256": _digest(self.decision_table_text),
            "inputs": json.dumps([file.told for file in self.inputs]),
            "host": self.host,
            "started_at": self.started_at.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
        }


def run_id_of(provenance: RunProvenance) -> str:
    """The id of a run: equal for equal software, plugins, configuration, decision table and input **contents**.

    A letter and 15 hex digits, so that no reader of the hive partition ``run_id=…`` takes it for a number or a date.
    """
    essence = {
        "version": provenance.version,
        "plugins": dict(sorted(provenance.plugins.items())),
        "config": provenance.config_text,
        "decision_table": provenance.decision_table_text,
        "inputs": [file.identity for file in provenance.inputs],
    }
    return "r" + _digest(json.dumps(essence, sort_keys=True))[:15]


def is_run_id(text: str) -> bool:
    """Whether a text can be a run's id: a letter and then letters, digits, '_' and '-', so that it can be in a name."""
    return text[:1].isalpha() and text.isascii() and text.replace("_", "").replace("-", "").isalnum()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()

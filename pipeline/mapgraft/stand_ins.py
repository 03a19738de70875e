"""Recordings that are not on this machine, and what stands in for them here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mapgraft.outputs.provenance import InputFile
from mapgraft.recording.containers.octets import Octets


@dataclass(frozen=True, slots=True)
class StandIns:
    """What is known of some of a run's files beside their paths.

    ``octets`` holds the bytes of MCAP files that are read by ranges; their paths are only names. ``known`` says what
    files are, so that nobody has to read them whole to find out.
    """

    octets: Mapping[Path, Octets] = field(default_factory=dict)
    known: Mapping[Path, InputFile] = field(default_factory=dict)


NONE = StandIns()

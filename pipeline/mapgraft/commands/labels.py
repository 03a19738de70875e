"""``mapgraft labels``: what people say of examples, out to a CSV file and in again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mapgraft.commands.unread import tell_unread
from mapgraft.commands.written_file import require_writable
from mapgraft.console import cell, results
from mapgraft.examples.labels_csv import exported, imported
from mapgraft.examples.reading import ExampleFolder
from mapgraft.outputs.staging import writing


def export_and_show(outs: Sequence[Path], to: Path, *, everything: bool) -> None:
    """Write the words to a file; raises UsageError where a folder has no examples, or there can be no such file."""
    require_writable("--out", to)
    tell_unread(outs)
    text, count = exported([ExampleFolder(out) for out in outs], everything=everything)
    with writing(to):
        to.write_text(text, encoding="utf-8")
    results().print(cell(f"{count} words written to {to}"))


def import_and_show(out: Path, files: Sequence[Path], annotator: str) -> None:
    """Add what CSV files say to the labels of a folder, and say how much of it was new."""
    tell_unread([out])
    folder = ExampleFolder(out)
    for path in files:
        added, before = imported(folder, path, annotator)
        results().print(cell(f"{path}: {added} words added to {out}" + (f", {before} there before" if before else "")))

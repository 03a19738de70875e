"""``mapgraft dataset``: examples of runs and evaluations, with their labels, as a dataset that others can use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from mapgraft.commands.unread import tell_unread
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.errors import UsageError
from mapgraft.examples.publishing import publish


def publish_and_show(
    outs: Sequence[Path], dataset: Path, splits: Sequence[str], licence: str | None, *, as_json: bool
) -> None:
    """Publish, and say what the dataset holds now."""
    tell_unread([*outs, dataset])
    published = publish(outs, dataset, dict(_split(text) for text in splits), licence)
    if as_json:
        print_json({"rows": published.rows, **asdict(published)})
        return
    for split, rows in published.rows.items():
        names = [name for name, where in published.environments.items() if where == split]
        results().print(cell(f"{split:<12}{rows:>8} examples  {', '.join(names)}"))
    results().print(cell(f"Written to {dataset}; its card is {dataset / 'README.md'}"))
    if between := sum(published.left_out.values()):
        said = f"{between} examples of two buildings were left out, because the two are in different splits"
        remarks().print(cell(f"{said}: --split ENVIRONMENT=… puts buildings elsewhere"), style="yellow")
    if empty := [split for split, rows in published.rows.items() if not rows]:
        said = f"no building is in {' and '.join(empty)}"
        remarks().print(cell(f"{said}: --split ENVIRONMENT={empty[0]} puts one there"), style="yellow")


def _split(text: str) -> tuple[str, str]:
    environment, separator, split = text.rpartition("=")
    if not separator:
        raise UsageError(f"--split wants ENVIRONMENT=train, =validation or =test, found {text!r}")
    return environment, split

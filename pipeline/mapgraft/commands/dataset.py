"""``mapgraft dataset``: examples of runs and evaluations, with their labels, as a dataset that others can use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from mapgraft.commands.unread import tell_unread
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.errors import UsageError
from mapgraft.examples.publishing import Published, publish
from mapgraft.examples.reading import ExampleFolder


def publish_and_show(
    outs: Sequence[Path], dataset: Path, splits: Sequence[str], licence: str | None, *, as_json: bool
) -> None:
    """Publish, and say what the dataset holds now."""
    tell_unread([*outs, dataset])
    wanted = dict(_split(text) for text in splits)
    published = publish(outs, dataset, wanted, licence)
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
    if absent := sorted(wanted.keys() - _environments_in(dataset, published)):
        said = (
            f"no example in the dataset is of {' or '.join(absent)}: what --split says of that is for examples to come"
        )
        remarks().print(cell(said), style="yellow")
    if empty := [split for split, rows in published.rows.items() if not rows]:
        said = f"no example is in {' and '.join(empty)}"
        remarks().print(cell(f"{said}: --split ENVIRONMENT={empty[0]} puts one there"), style="yellow")


def _environments_in(dataset: Path, published: Published) -> set[str]:
    """The buildings of which the dataset has examples."""
    if not published.parts:
        return set()
    column = ExampleFolder(dataset).rows(["environment"])["environment"]
    return {name for environment in column.unique().to_pylist() for name in environment.split("+")}


def _split(text: str) -> tuple[str, str]:
    environment, separator, split = text.rpartition("=")
    if not separator:
        raise UsageError(f"--split wants ENVIRONMENT=train, =validation or =test, found {text!r}")
    return environment, split

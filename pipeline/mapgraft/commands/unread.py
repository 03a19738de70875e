"""What persons said and nobody can read any more, told by every command that makes something of their words."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from mapgraft.console import cell, remarks
from mapgraft.outputs.label_parts import unread_parts


def tell_unread(folders: Iterable[Path]) -> None:
    """Name the parts of ``labels/`` in these folders that are damaged, each once."""
    for folder in {path.resolve(): path for path in folders}.values():
        for path, reason in sorted(unread_parts(folder).items()):
            said = f"{path} cannot be read, and what was said there is missing here ({reason}): "
            remarks().print(cell(f"{said}put a sound copy in its place, or remove it"), style="yellow", soft_wrap=True)

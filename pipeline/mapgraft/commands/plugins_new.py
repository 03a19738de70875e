"""``mapgraft plugins new``: a package to begin with, whose tests pass as it stands."""

from __future__ import annotations

import importlib.metadata
import keyword
import re
from importlib import resources
from pathlib import Path
from string import Template
from typing import Final

from mapgraft import __version__
from mapgraft.console import cell, results
from mapgraft.contracts.plugin import CONTRACT
from mapgraft.errors import OutputError, UsageError
from mapgraft.plugins import GROUP, load_plugins

_NAME: Final = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_FILES: Final = {
    "pyproject.toml": "pyproject.toml.txt",
    "README.md": "README.md.txt",
    "src/{module}.py": "module.py.txt",
    "tests/test_laws.py": "test_laws.py.txt",
}


def new_plugin(name: str, folder: Path | None) -> None:
    """Write the package into a new folder and say what to do next.

    Raises UsageError for a name that cannot be one, OutputError when the folder has something in it already.
    """
    _require_free(name)
    target = folder or Path(f"mapgraft-{name.replace('_', '-')}")
    _require_empty(target)
    for path, text in package_of(name).items():
        file = target / path
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
        except OSError as error:
            raise OutputError(f"{file} cannot be written: {error.strerror}; choose another folder with --out") from None
    results().print(cell(f"wrote {', '.join(package_of(name))} to {target}"))
    results().print(cell(f"next: cd {target} && pip install -e '.[test]' && pytest"))


def package_of(name: str) -> dict[str, str]:
    """The files of a new package: path → text."""
    major, minor, *_ = __version__.split(".")
    module = f"mapgraft_{name}"
    words = {
        "name": name,
        "module": module,
        "Class": "".join(word.capitalize() for word in name.split("_")),
        "distribution": f"mapgraft-{name.replace('_', '-')}",
        "contract": str(CONTRACT),
        "version": f"{major}.{minor}",
        "next_version": str(int(major) + 1),
    }
    template = resources.files("mapgraft.testing") / "template"
    return {
        path.format(module=module): Template((template / file).read_text(encoding="utf-8")).substitute(words)
        for path, file in _FILES.items()
    }


def _require_free(name: str) -> None:
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        near = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
        hint = f": how about {near!r}?" if _NAME.fullmatch(near) and not keyword.iskeyword(near) else ""
        raise UsageError(
            f"a plugin's name must be lower-case letters, digits and '_', and no word of Python's, found {name!r}{hint}"
        )
    plugins = load_plugins()
    taken = {offered.descriptor.name for offered in plugins.offered.values()}
    if name in importlib.metadata.entry_points(group=GROUP).names or name in taken:
        raise UsageError(f"the name {name!r} is taken: 'mapgraft plugins list' shows by whom; choose another one")


def _require_empty(target: Path) -> None:
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise OutputError(f"{target} is there already, and nothing is overwritten: choose another folder with --out")

"""``mapgraft plugins list`` and ``show``."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Sequence
from typing import Any

from rich.table import Table

from mapgraft.console import cell, print_json, results
from mapgraft.decision import build_table
from mapgraft.errors import PluginError
from mapgraft.plugins import Offered, Plugins, load_plugins


def list_plugins(*, as_json: bool, without: Sequence[str]) -> None:
    """Print what is installed, and what could not be loaded and why."""
    plugins = load_plugins(without)
    build_table(plugins)  # finds out which plugins' rules do not fit
    if as_json:
        print_json(
            {
                "offered": [_row(offered) for _, offered in sorted(plugins.offered.items())],
                "rules": [{"name": rules.name, "plugin": rules.origin.plugin} for rules in plugins.rules],
                "broken": [{**_origin(broken.origin), "reason": broken.reason} for broken in plugins.broken],
            }
        )
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in ("kind", "name", "plugin", "what it is"):
        table.add_column(column)
    for _, offered in sorted(plugins.offered.items()):
        note = f"  [{offered.remedy}]" if offered.missing else ""
        table.add_row(
            offered.kind, cell(offered.descriptor.name), cell(offered.origin.plugin),
            cell(offered.descriptor.summary + note),
        )  # fmt: skip
    for rules in plugins.rules:
        table.add_row("rules", cell(rules.name), cell(rules.origin.plugin), "rules of the default decision table")
    console = results()
    console.print(table)
    for broken in plugins.broken:
        console.print(
            cell(f"broken: {broken.origin.plugin} ({broken.origin.distribution}): {broken.reason}"), style="red"
        )


def show_plugin(name: str, *, as_json: bool) -> None:
    """Print everything of that name; raises PluginError when there is none."""
    plugins = load_plugins()
    found = [offered for (_, known), offered in sorted(plugins.offered.items()) if known == name]
    if not found:
        names = ", ".join(sorted({known for _, known in plugins.offered}))
        raise PluginError(f"nothing installed is called {name!r}: there are {names}")
    rows = [
        {**_row(offered), "parameters": _parameters(plugins, offered), "text": _text(plugins, offered)}
        for offered in found
    ]
    if as_json:
        print_json(rows)
        return
    console = results()
    for row in rows:
        console.print(cell(f"{row['kind']} {row['name']}: {row['summary']}"), style="bold")
        console.print(cell(f"from {row['plugin']} ({row['distribution']} {row['version']}), {row['factory']}"))
        if row["missing"]:
            console.print(cell(row["missing"]), style="red")
        if row["accepts"]:
            console.print(
                cell(f"accepts {', '.join(row['accepts'])}" + (f", gives {row['gives']}" if row["gives"] else ""))
            )
        for parameter, default in row["parameters"].items():
            console.print(cell(f"  {parameter} = {default}"))
        if row["text"]:
            console.print(cell("\n" + _unwrapped(row["text"])))


def _unwrapped(text: str) -> str:
    """One line per paragraph, which the terminal wraps at its own width; indented lines and lists stay lines."""
    return re.sub(r"(?<=\S)\n(?=[^\s*-])", " ", text)


def _row(offered: Offered) -> dict[str, Any]:
    descriptor = dataclasses.asdict(offered.descriptor)
    return {"kind": offered.kind, **descriptor, **_origin(offered.origin), "missing": offered.remedy}


def _origin(origin: Any) -> dict[str, str]:
    return {"plugin": origin.plugin, "distribution": origin.distribution, "version": origin.version}


def _parameters(plugins: Plugins, offered: Offered) -> dict[str, str]:
    if offered.missing:
        return {}
    signature = inspect.signature(plugins.function(offered.kind, offered.descriptor.name))
    return {
        parameter.name: "required" if parameter.default is parameter.empty else repr(parameter.default)
        for parameter in signature.parameters.values()
    }


def _text(plugins: Plugins, offered: Offered) -> str:
    if offered.missing:
        return ""
    return inspect.getdoc(plugins.function(offered.kind, offered.descriptor.name)) or ""

"""Write docs/hooks.md from the hookspecs and the contracts; with ``--check``, exit with 1 when it is not up to date."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from mapgraft import contracts, hooks

PAGE = Path(__file__).parent / "hooks.md"
HEAD = """# Reference of the hooks

Written by `python docs/write_hooks.py` from `mapgraft.hooks` and `mapgraft.contracts`; what it all means is told in
[Writing a plugin](plugins.md). The version of the contracts is {contract}.

A plugin is a module with functions of these names, marked with `mapgraft.contracts.hookimpl`. Each is called once, with
`register`, when plugins are listed or used.

| hook | for |
|---|---|
{rows}

## What is registered: `Descriptor`

```python
{descriptor}
```

{about}
"""


def page() -> str:
    """The whole page."""
    found = [(name, made) for name, made in vars(hooks).items() if name.startswith("register_")]
    rows = "\n".join(f"| [`{name}`](#{name}) | {_text(made).splitlines()[0]} |" for name, made in found)
    head = HEAD.format(
        contract=".".join(map(str, contracts.CONTRACT)),
        rows=rows,
        descriptor=_signature("Descriptor", contracts.Descriptor),
        about=_text(contracts.Descriptor),
    )
    return head + "".join(part for name, made in found for part in _hook(name, made))


def _hook(name: str, made: object) -> Iterator[str]:
    """The section of one hook, with the protocol of what its factories make."""
    text = _text(made)
    yield f"\n## `{name}`\n\n{text}\n"
    for named in re.findall(r"`(\w+)`", text):
        protocol = getattr(contracts, named, None)
        if not getattr(protocol, "_is_protocol", False):
            continue
        if about := _text(protocol):
            yield f"\n{about}\n"
        for method, function in vars(protocol).items():
            if method.startswith("_"):
                continue
            if isinstance(function, property):
                yield f"\n**`{method}`** {_text(function)}".rstrip() + "\n"
            elif inspect.isfunction(function):
                yield f"\n```python\n{_signature(method, function)}\n```\n"
                if function.__doc__:
                    yield f"\n{_text(function)}\n"


def _text(described: object) -> str:
    """A docstring as Markdown: code between single ticks, tables as they stand."""
    text = inspect.cleandoc(getattr(described, "__doc__", None) or "").replace("``", "`").replace("::\n", ":\n")
    return re.sub(r"(?ms)^(=+  =+\n.*?^=+  =+)$", r"```text\n\1\n```", text)


def _signature(name: str, described: Callable[..., object]) -> str:
    """Names, annotations as they are written, and defaults; one parameter to a line where it gets long."""
    signature = inspect.signature(described)
    parts = [_parameter(parameter) for parameter in signature.parameters.values()]
    returned = signature.return_annotation
    after = "" if returned in (None, signature.empty) else f" -> {returned}"
    line = f"{name}({', '.join(parts)}){after}"
    return line if len(line) <= 110 else f"{name}(\n    " + ",\n    ".join(parts) + f",\n){after}"


def _parameter(parameter: inspect.Parameter) -> str:
    typed = parameter.name if parameter.annotation is parameter.empty else f"{parameter.name}: {parameter.annotation}"
    if parameter.default is parameter.empty:
        return typed
    default = "{}" if "factory" in repr(parameter.default) else repr(parameter.default)
    return f"{typed} = {default}"


if __name__ == "__main__":
    if "--check" in sys.argv[1:]:
        sys.exit(0 if PAGE.read_text(encoding="utf-8") == page() else 1)
    PAGE.write_text(page(), encoding="utf-8")

"""The hooks a plugin may implement. Each gets a ``register`` and calls it with descriptors."""

from __future__ import annotations

from mapgraft.contracts.plugin import Register, RegisterRules, hookspec


@hookspec
def register_map_types(register: Register) -> None:
    """Kinds of maps (``MapType``)."""


@hookspec
def register_matchers(register: Register) -> None:
    """Ways to find the transform between two maps (``Matcher``)."""


@hookspec
def register_acceptors(register: Register) -> None:
    """Ways to choose among candidates (``Acceptor``)."""


@hookspec
def register_fusers(register: Register) -> None:
    """Ways to bring a donor's evidence in (``Fuser``)."""


@hookspec
def register_metrics(register: Register) -> None:
    """Measurements of a merge (``Metric``, which makes a ``Tracker`` for each merge)."""


@hookspec
def register_verifiers(register: Register) -> None:
    """Judgements of a merge from its measurements (``Verifier``)."""


@hookspec
def register_conversions(register: Register) -> None:
    """Ways from one map type to another (``Conversion``)."""


@hookspec
def register_policies(register: Register) -> None:
    """When robots exchange their maps (``Policy``)."""


@hookspec
def register_rules(register: RegisterRules) -> None:
    """Rules of the default decision table: ``register(name of the table, YAML text)``."""


@hookspec
def register_readers(register: Register) -> None:
    """Containers of recordings: the factory *is* a function ``open(path)`` and gives a ``Source``."""


@hookspec
def register_decoders(register: Register) -> None:
    """Message types that become payloads of observations: the factory *is* a function ``decode(message)``."""


@hookspec
def register_formats(register: Register) -> None:
    """Files that hold one ready map: the factory *is* a function ``read(path, **options)`` and gives a payload."""

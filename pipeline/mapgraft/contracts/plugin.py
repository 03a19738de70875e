"""How a plugin presents itself: frozen descriptors with lazy factories, registered through pluggy hooks.

A plugin is a module with ``@hookimpl`` functions and one entry point in the group ``mapgraft``::

    from mapgraft.contracts import Descriptor, hookimpl

    MAPGRAFT_CONTRACT = (1, 0)

    @hookimpl
    def register_metrics(register):
        register(Descriptor("overlap", "my_package.overlap:Overlap", "shared area over the smaller area",
                            accepts=("occupancy_grid",)))

The hooks are ``register_map_types``, ``register_matchers``, ``register_acceptors``, ``register_fusers``,
``register_metrics``, ``register_verifiers``, ``register_conversions``, ``register_policies``, ``register_readers``,
``register_decoders`` and ``register_formats``, each with ``register(Descriptor(...))``, and ``register_rules``, whose
``register(name, yaml_text)`` takes the text of a decision table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import pluggy

from mapgraft.errors import PluginError

PROJECT = "mapgraft"
CONTRACT: Final = (1, 0)
"""The version of everything in ``mapgraft.contracts``. The first number changes when a plugin written for it could
break, the second one when something comes in addition."""
DECLARED_IN: Final = "MAPGRAFT_CONTRACT"
"""Where a plugin's module says which version it was written for: ``MAPGRAFT_CONTRACT = (1, 0)``."""
UNDECLARED: Final = (1, 0)
"""What a plugin was written for that does not say it: the first version there was, whatever is installed today."""

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@dataclass(frozen=True, slots=True)
class Descriptor:
    """One thing a plugin offers. Nothing of it is imported until the thing is used.

    ``name`` is what rules and configurations say; ``factory`` is ``"module:attribute"``, called with keyword arguments
    from the configuration; ``summary`` is one line for ``mapgraft plugins list``.

    A factory raises ConfigError when a value is impossible; a keyword it does not have is found by the engine.

    Further fields by kind (acceptors, verifiers and policies have none). Where ``accepts`` is empty every map type will
    do; where it does not hold the two maps' types, a rule that names the thing does not apply and says so.

    ============  =====================================================================================================
    map types     ``observes``: payload kind → preference; a robot whose map type is not configured gets the type with
                  the highest preference for what it observes
    matchers      ``accepts``: the map type of both maps, or (target type, source type); ``uses_prior``: a prior
                  narrows the search to where it says, and of two hypotheses for the same two maps the better one has
                  the higher score, whatever the prior. Only such a matcher refines merges that stand, and only if it
                  tells ``prior_score``. ``needs_prior``: without a prior it has nothing to say
    fusers        ``accepts`` as for matchers
    metrics       ``accepts``: the map type of both maps; ``stream``: it counts what the observations since the
                  registration say, and so equals a replay of these, not a fresh look at the two maps
    conversions   ``accepts``: the type converted from, ``gives``: the type converted to
    decoders      ``accepts``: message types (``sensor_msgs/msg/PointCloud2``), ``gives``: the payload kind;
                  the factory is a function ``decode(message) -> payload``
    readers       ``accepts``: file suffixes; the factory is a function ``open(path) -> Source``
    formats       ``accepts``: file suffixes, ``gives``: the payload kind; ``read(path, **options) -> payload``
    ============  =====================================================================================================

    ``requires`` names modules that must be importable and ``extra`` the extra that installs them; where one is missing
    the descriptor is listed with what to install. ``laws`` names classes (``"module:Class"``) that inherit from
    ``mapgraft.testing`` and say how to try the thing's laws, for ``mapgraft plugins check``. ``api`` is the version of
    this contract it was written for, where that is not what the module says for all (``MAPGRAFT_CONTRACT``); a plugin
    that says nothing was written for the first one.
    """

    name: str
    factory: str
    summary: str
    accepts: tuple[str, ...] = ()
    gives: str = ""
    observes: Mapping[str, int] = field(default_factory=dict)
    uses_prior: bool = False
    needs_prior: bool = False
    stream: bool = False
    requires: tuple[str, ...] = ()
    extra: str = ""
    laws: tuple[str, ...] = ()
    api: tuple[int, int] = UNDECLARED

    def __post_init__(self) -> None:
        if not self.name or not self.name.replace("_", "").replace(".", "").replace("-", "").isalnum():
            raise PluginError(f"a plugin's name must be letters, digits, '_', '-' and '.', found {self.name!r}")
        if self.factory.count(":") != 1:
            raise PluginError(f"the factory of {self.name!r} must be 'module:attribute', found {self.factory!r}")
        require_contract(repr(self.name), self.api)
        for laws in self.laws:
            if laws.count(":") != 1:
                raise PluginError(f"the laws of {self.name!r} must be 'module:Class', found {laws!r}")


def require_contract(who: str, version: object) -> None:
    """Raise PluginError unless what was written for that version of the contracts works with this one."""
    if not (isinstance(version, tuple) and len(version) == 2 and all(isinstance(part, int) for part in version)):
        raise PluginError(
            f"{who} must say for which contract it was written as {DECLARED_IN} = {CONTRACT}, found {version!r}"
        )
    if version[0] == CONTRACT[0] and version[1] <= CONTRACT[1]:
        return
    what = "update mapgraft" if version > CONTRACT else "update the plugin"
    here = ".".join(map(str, CONTRACT))
    raise PluginError(f"{who} was written for contract {version[0]}.{version[1]}, this mapgraft has {here}: {what}")


Register = Callable[[Descriptor], None]
RegisterRules = Callable[[str, str], None]  # (name of the table, its YAML text)

"""The conformance kit: the laws that plugins keep, as classes to inherit from in a test module.

A subclass says how a thing is made, pytest collects its laws as tests, and hypothesis looks for what breaks them::

    from mapgraft.testing import MapTypeLaws

    class TestMyMaps(MapTypeLaws):
        def make_map_type(self):
            return MyMaps()

Needs the extra ``testing`` (pytest and hypothesis). ``mapgraft plugins check NAME`` tries the same laws on what is
installed.
"""

from __future__ import annotations

from mapgraft.errors import PluginError

try:
    import hypothesis as _hypothesis  # noqa: F401
except ModuleNotFoundError:
    raise PluginError("the conformance kit needs hypothesis and pytest: pip install 'mapgraft[testing]'") from None

from mapgraft.testing.conversions import ConversionLaws
from mapgraft.testing.fusers import FuserLaws
from mapgraft.testing.judging import AcceptorLaws, PolicyLaws, VerifierLaws
from mapgraft.testing.laws import (
    BrokenLawError,
    Drawing,
    Law,
    Laws,
    NotTriedError,
    Outcome,
    examine,
    law,
    laws_of,
    require,
)
from mapgraft.testing.listing import PluginLaws
from mapgraft.testing.map_types import MapTypeLaws
from mapgraft.testing.matchers import MatcherLaws
from mapgraft.testing.metrics import MetricLaws
from mapgraft.testing.observing import READY_KINDS, observe
from mapgraft.testing.rooms import Room, look, rooms
from mapgraft.testing.scenes import Scene, moved, planar_moves, scenes_from, scenes_of
from mapgraft.testing.supply import Supply, layer_of

__all__ = [
    "READY_KINDS",
    "AcceptorLaws",
    "BrokenLawError",
    "ConversionLaws",
    "Drawing",
    "FuserLaws",
    "Law",
    "Laws",
    "MapTypeLaws",
    "MatcherLaws",
    "MetricLaws",
    "NotTriedError",
    "Outcome",
    "PluginLaws",
    "PolicyLaws",
    "Room",
    "Scene",
    "Supply",
    "VerifierLaws",
    "examine",
    "law",
    "laws_of",
    "layer_of",
    "look",
    "moved",
    "observe",
    "planar_moves",
    "require",
    "rooms",
    "scenes_from",
    "scenes_of",
]

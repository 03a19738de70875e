"""How a robot keeps what was merged into its map, and takes it out again."""

from mapgraft.config import ReversalName
from mapgraft.contracts import MapType
from mapgraft.reversal.ledger import Ledger
from mapgraft.reversal.multi_map import MultiMap
from mapgraft.reversal.protocol import Reversal
from mapgraft.reversal.single_map import SingleMap

__all__ = ["Ledger", "MultiMap", "Reversal", "SingleMap", "new_reversal"]


def new_reversal(name: ReversalName, map_type: MapType) -> Reversal:
    """An empty map of that type, kept in that way."""
    kinds: dict[ReversalName, type[Ledger] | type[MultiMap] | type[SingleMap]] = {
        "ledger": Ledger,
        "multi_map": MultiMap,
        "single_map": SingleMap,
    }
    return kinds[name](map_type)

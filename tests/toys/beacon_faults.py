"""One fault for every law: the plugin ``beacons`` with the smallest change that breaks it."""

import map_type_faults
import tool_faults
from fault_book import FAULTS, faulty_laws

__all__ = ["FAULTS", "faulty_laws", "map_type_faults", "tool_faults"]

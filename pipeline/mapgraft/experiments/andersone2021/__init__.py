"""Section 4 of I. Andersone, Distributed Framework for Reversible Merging of Heterogeneous Robot Maps (ICAART 2021).

Partial maps of one recording are merged by Carpin's matcher, rightly and wrongly; the receiver maps on, keeping the
merge in one map, in two maps, and in the ledger; similarity and distance are measured, and the merge is taken out.
"""

from mapgraft.experiments.andersone2021.outcome import Experiment, Kept, Merge, Search
from mapgraft.experiments.andersone2021.protocol import Laboratory, conduct
from mapgraft.experiments.andersone2021.settings import STRATEGIES, Combination, Settings

__all__ = ["STRATEGIES", "Combination", "Experiment", "Kept", "Laboratory", "Merge", "Search", "Settings", "conduct"]

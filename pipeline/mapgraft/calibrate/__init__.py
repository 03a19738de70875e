"""Thresholds from labelled examples, with the guarantee they carry, and where they carry none.

``read_labels`` reads examples, ``calibrate`` sets the limits of every rule that labels tell of, ``rules_text`` writes
them as a decision table, ``document`` as JSON and ``page_of`` as a page.
"""

from mapgraft.calibrate.fitting import Asked, Calibration, Fit, RuleFit, calibrate
from mapgraft.calibrate.labelled import Labelled, Labels, read_labels

__all__ = ["Asked", "Calibration", "Fit", "Labelled", "Labels", "RuleFit", "calibrate", "read_labels"]

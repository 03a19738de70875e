"""The report of a run: one HTML page that is complete in itself, made from the run's folder alone."""

from mapgraft.outputs.report.page import page_of, publish

__all__ = ["page_of", "publish"]

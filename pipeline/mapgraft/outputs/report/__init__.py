"""The report of a run: one HTML page that is complete in itself, made from the run's folder alone."""

from mapgraft.outputs.report.page import REPORT, page_of, publish

__all__ = ["REPORT", "page_of", "publish"]

"""The report of an estimate: what logs said of a robot, as a page of sections."""

from oed.report.estimate.page import write_estimate

__all__ = ["write_estimate"]

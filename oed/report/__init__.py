"""Reports: a Record in, files out. Nothing here solves or integrates."""

from oed.report.page import write_report

__all__ = ["write_report"]

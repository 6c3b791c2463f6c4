"""Reports: a Record in, files out. Nothing here solves or integrates."""

from oed.report.comparison import write_comparison
from oed.report.page import write_report

__all__ = ["write_comparison", "write_report"]

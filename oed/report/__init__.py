"""Reports: a record in, files out. Nothing here solves or integrates."""

from oed.report.comparison import write_comparison
from oed.report.estimate import write_estimate
from oed.report.film.animation import animate
from oed.report.index import write_index
from oed.report.loop import write_loop
from oed.report.page import write_report
from oed.report.plan import write_plan
from oed.report.sweep import write_sweep

__all__ = [
    "animate",
    "write_comparison",
    "write_estimate",
    "write_index",
    "write_loop",
    "write_plan",
    "write_report",
    "write_sweep",
]

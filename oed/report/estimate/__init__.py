"""The page of an estimate, what logs said of a robot: sections in the order in which its owner needs them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from oed.foundation.arguments import typed
from oed.records.record import ESTIMATE, EstimateRecord
from oed.report.estimate.dead_reckoning import errors_over_time, validation
from oed.report.estimate.fit import error_bars, fit
from oed.report.estimate.logs import logs
from oed.report.estimate.models import models
from oed.report.estimate.parameters import nuisances, summary, trust
from oed.report.page import render
from oed.report.parts.provenance import estimate_provenance
from oed.report.parts.section import Section

SECTIONS: tuple[Callable[[EstimateRecord], Section | None], ...] = (
    summary,
    trust,
    errors_over_time,
    validation,
    fit,
    error_bars,
    nuisances,
    models,
    logs,
    estimate_provenance,
)
"""In the order of the page; a function returns None where the estimate has nothing for its section."""
__all__ = ["estimate_sections", "write_estimate"]


@typed
def write_estimate(record: EstimateRecord, folder: str | Path, figures: Sequence[str] = ()) -> Path:
    """Write estimate.html, estimate.md and figures/estimate_*.svg into `folder`; returns estimate.html.

    Args:
        record: the estimate.
        folder: that of the estimate; a design's report may be there, too.
        figures: formats in which figures are written beside the SVG of each: "pdf", "png".

    Raises:
        TypeError: plain data instead of an estimate.
        UserMistake: the folder cannot be written to.
    """
    if not isinstance(record, EstimateRecord):
        raise TypeError("expected an EstimateRecord, as `estimate` and `load_estimate` return; not its data")
    title = f"{record.title}: estimate from logs"
    return render(title, estimate_sections(record), Path(folder), ESTIMATE, figures)


def estimate_sections(record: EstimateRecord) -> list[Section]:
    """The sections that the estimate has something for, in order."""
    return [section for make in SECTIONS if (section := make(record)) is not None]

"""The page of an estimate: its sections in the order in which a robot's owner needs them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from oed.records.record import ESTIMATE
from oed.report.estimate.along import along
from oed.report.estimate.certainty import certainty
from oed.report.estimate.fit import fit
from oed.report.estimate.left_out import left_out
from oed.report.estimate.logs import logs
from oed.report.estimate.models import models
from oed.report.estimate.provenance import provenance
from oed.report.estimate.reading import Data, study_of
from oed.report.estimate.reckoned import reckoned
from oed.report.estimate.summary import summary
from oed.report.page import render
from oed.report.parts.section import Section

NAME = ESTIMATE
"""Of the page's files, without suffix."""
SECTIONS: tuple[Callable[[Data], Section | None], ...] = (
    summary,
    certainty,
    along,
    fit,
    reckoned,
    left_out,
    models,
    logs,
    provenance,
)
"""In the order of the page; a function returns None where the estimate has nothing for its section."""


def write_estimate(data: Data, folder: str | Path) -> Path:
    """Write estimate.html, estimate.md and figures/estimate_*.svg into `folder`; returns estimate.html.

    Args:
        data: what estimate.json holds.
        folder: that of the estimate; a design's report may be there, too.

    Raises:
        UserMistake: the folder cannot be written to.
    """
    title = f"{study_of(data).get('name', 'Robot')}: estimate from logs"
    return render(title, estimate_sections(data), Path(folder), NAME)


def estimate_sections(data: Data) -> list[Section]:
    """The sections that the estimate has something for, in order."""
    made = (make(data) for make in SECTIONS)
    return [section for section in made if section is not None]

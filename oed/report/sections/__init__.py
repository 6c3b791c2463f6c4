"""The sections of a report. A new one is a function here in a file and its name in `SECTIONS`."""

from collections.abc import Callable

from oed.records.record import Record
from oed.report.parts.provenance import provenance
from oed.report.parts.section import Section
from oed.report.sections.candidates import candidates, criteria, paper
from oed.report.sections.drives import paths, player, wheels
from oed.report.sections.limits import limits
from oed.report.sections.physics import physics
from oed.report.sections.precision import precision
from oed.report.sections.robustness import robustness
from oed.report.sections.searches import certificate, convergence, starts
from oed.report.sections.summary import question, summary
from oed.report.sections.validation import validation

SECTIONS: tuple[Callable[[Record], Section | None], ...] = (
    summary,
    certificate,
    candidates,
    criteria,
    paths,
    player,
    wheels,
    paper,
    limits,
    robustness,
    starts,
    convergence,
    precision,
    validation,
    physics,
    question,
    provenance,
)
"""In the order of the page; a function returns None where the record has nothing for its section."""

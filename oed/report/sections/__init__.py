"""The sections of a report. A new one is a function here in a file and its name in `SECTIONS`."""

from collections.abc import Callable

from oed.records.record import Record
from oed.report.parts.section import Section
from oed.report.sections.candidates import candidates
from oed.report.sections.certificate import certificate
from oed.report.sections.convergence import convergence
from oed.report.sections.criteria import criteria
from oed.report.sections.deviations import deviations
from oed.report.sections.drives import paths, wheels
from oed.report.sections.limits import limits
from oed.report.sections.paper import paper
from oed.report.sections.physics import physics
from oed.report.sections.player import player
from oed.report.sections.provenance import provenance
from oed.report.sections.robustness import robustness
from oed.report.sections.starts import starts
from oed.report.sections.summary import summary
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
    deviations,
    validation,
    physics,
    provenance,
)
"""In the order of the page; a function returns None where the record has nothing for its section."""

"""The sections of a report. A new one is a function here in a file and its name in `SECTIONS`."""

from collections.abc import Callable
from dataclasses import replace

from oed.records.record import Record
from oed.report.parts.provenance import provenance
from oed.report.parts.section import Section
from oed.report.sections.candidates import candidates, comparison, criteria, paper
from oed.report.sections.courses import courses, inputs, sensitivity
from oed.report.sections.drift import drift
from oed.report.sections.drives import paths, wheels
from oed.report.sections.first import first
from oed.report.sections.limits import limits
from oed.report.sections.physics import physics
from oed.report.sections.precision import precision
from oed.report.sections.readings import readings
from oed.report.sections.refinement import refinement
from oed.report.sections.robustness import robustness
from oed.report.sections.searches import convergence, starts
from oed.report.sections.summary import question
from oed.report.sections.sureness import sureness
from oed.report.sections.systems import experiment
from oed.report.sections.validation import validation

Make = Callable[[Record], Section | None]


def _folded(make: Make) -> Make:
    # Of a section for those who ask: open where there is no design, as it then says why.
    def made(record: Record) -> Section | None:
        section = make(record)
        return section and replace(section, folded=record.best is not None)

    return made


_DETAILS: tuple[Make, ...] = (
    _folded(question),
    _folded(candidates),
    _folded(criteria),
    _folded(paper),
    _folded(precision),
    _folded(starts),
    _folded(convergence),
    _folded(provenance),
)
SECTIONS: dict[str, tuple[Make, ...]] = {
    "robots": (
        first,
        comparison,
        sureness,
        refinement,
        validation,
        robustness,
        readings,
        drift,
        limits,
        paths,
        wheels,
        physics,
        *_DETAILS,
    ),
    "systems": (
        experiment,
        comparison,
        readings,
        courses,
        sensitivity,
        sureness,
        refinement,
        validation,
        robustness,
        drift,
        limits,
        inputs,
        *_DETAILS,
    ),
}
"""Of each domain in the order of the page; a function returns None where there is nothing for its section."""

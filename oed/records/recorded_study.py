"""The study that a record holds: data, of which no code is run unless it is trusted."""

from __future__ import annotations

from pathlib import Path

from oed.foundation.errors import FileFlaw, Flaw, ProblemError, RecordError, StudyError
from oed.foundation.shown import shown
from oed.kernel.measurement.prior import Prior
from oed.records.record import Record
from oed.records.recorded_prior import prior_of
from oed.records.stored.echo import in_record
from oed.study.own_code import named_code
from oed.study.study import PriorRecord, Study, StudyFile, read_study
from oed.study.yaml_source import plain_source

TRUST = "if you trust it give --trust (in Python trust=True): it holds for this one call"
"""What to do with a record that asks for more than to be read."""


def recorded_study(record: Record, *, trust: bool = False) -> Study:
    """The study that a record was made of.

    Args:
        record: the record.
        trust: whether Python code that a record names which was read from a file may be run, and other files
            that it names be read.

    Raises:
        RecordError: a study that this version does not understand, or code that is not trusted, or a prior
            of another file.
    """
    place, trusted = record.file or Path("record"), trust or record.file is None
    if not trusted:
        _refuse_code(record.study, place)
    try:
        source = plain_source(str(place), record.study_text, record.echo)
        return read_study(source, prior_of if trusted else _refused_prior)
    except StudyError as error:
        raise in_record(error.flaws) from None


def _refuse_code(file: StudyFile, place: Path) -> None:
    flaws = [
        FileFlaw(
            str(place),
            0,
            0,
            key,
            f"{part.object} is code, of {part.module_file}, and would be run; read it, and {TRUST}",
        )
        for key, part in named_code(file)
    ]
    if flaws:
        raise RecordError(flaws)


def _refused_prior(wanted: PriorRecord, folder: Path) -> Prior:
    # Records hold priors as numbers: one that names another record has been written by somebody else.
    text = f"would be read from {shown(wanted.record)}, another file than this one; {TRUST}"
    raise ProblemError([Flaw(("prior", "record"), text)])

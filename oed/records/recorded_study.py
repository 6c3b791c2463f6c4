"""What a saved record gives to a new study: its own study, of which no code is run unless it is trusted, and
the covariance that it predicts for a drive, a prior.
"""

from __future__ import annotations

from pathlib import Path

from oed.foundation.errors import FileIssue, Issue, PathFileError, ProblemError, RecordError, StudyError
from oed.foundation.shown import shown
from oed.kernel.criteria import E, TaskDrive
from oed.kernel.measurement.prior import Prior
from oed.records.path_file import read_trajectory
from oed.records.record import Record, load_record
from oed.records.stored.door import in_record
from oed.study.study import AnyStudyFile, PriorRecord, Study, read_study
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
        raise in_record(error.issues) from None


def _refuse_code(file: AnyStudyFile, place: Path) -> None:
    issues = [
        FileIssue(
            str(place),
            0,
            0,
            key,
            f"{part.object} is code, of {part.module_file}, and would be run; read it, and {TRUST}",
        )
        for key, part in file.named_code()
    ]
    if issues:
        raise RecordError(issues)


def _refused_prior(wanted: PriorRecord, folder: Path) -> Prior:
    # Records hold priors as numbers: one that names another record has been written by somebody else.
    text = f"would be read from {shown(wanted.record)}, another file than this one; {TRUST}"
    raise ProblemError([Issue(("prior", "record"), text)])


def prior_of(wanted: PriorRecord, folder: Path) -> Prior:
    """The prior that a record predicts; the record is found from `folder`.

    Raises:
        ProblemError: no such record or result, or one that predicts no covariance; names the study's key.
    """
    try:
        saved = load_record(folder / wanted.record)
    except RecordError as error:
        raise ProblemError([Issue(("prior", "record"), "; ".join(map(str, error.issues)))]) from None
    result = saved.result(wanted.result)
    if result is None:
        names = ", ".join(one.name for one in saved.results) or "none"
        asked = wanted.result or "a feasible result"
        raise ProblemError([Issue(("prior", "result"), f"expected one of {names}; found no {asked}")])
    found = [one for one in result.covariances if not any(None in row for row in one.covariance)]
    if len(found) != 1:
        text = f"the record's {result.name} predicts no covariance of all parameters together"
        raise ProblemError([Issue(("prior", "record"), text)])
    # That prediction has the record's own prior in it, and with it the logs that made that.
    before = saved.study.prior
    logs = before.logs if isinstance(before, Prior) else {}
    return Prior(parameters=found[0].parameters, covariance=found[0].covariance, logs=logs)


def drives_of(file: Path, study: AnyStudyFile) -> list[TaskDrive]:
    """The drives of a trajectory CSV for a study's system, every run by itself.

    Raises:
        ProblemError: a file that cannot be read, with its own lines; the key is the caller's.
    """
    try:
        # What is judged does not matter to what is driven.
        problem = study.model_copy(update={"criterion": E(), "weights": None}).problem()
        read = read_trajectory(file, problem)
    except PathFileError as error:
        raise ProblemError([Issue((), str(issue)) for issue in error.issues]) from None
    return [
        TaskDrive(
            inputs=tuple(map(tuple, one.inputs.tolist())),
            period=one.period,
            start=tuple(one.start.tolist()),
        )
        for one in read.each
    ]

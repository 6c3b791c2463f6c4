"""What the record of an earlier study says before the next: the covariance that it predicts for a drive."""

from __future__ import annotations

from pathlib import Path

from oed.foundation.errors import Flaw, ProblemError, RecordError
from oed.kernel.measurement.prior import Prior
from oed.records.record import load_record
from oed.study.study import PriorRecord


def prior_of(wanted: PriorRecord, folder: Path) -> Prior:
    """The prior that a record predicts; the record is found from `folder`.

    Raises:
        ProblemError: no such record or result, or one that predicts no covariance; names the study's key.
    """
    try:
        saved = load_record(folder / wanted.record)
    except RecordError as error:
        raise ProblemError([Flaw(("prior", "record"), "; ".join(map(str, error.flaws)))]) from None
    result = saved.result(wanted.result)
    if result is None:
        names = ", ".join(one.name for one in saved.results) or "none"
        asked = wanted.result or "a feasible result"
        raise ProblemError([Flaw(("prior", "result"), f"expected one of {names}; found no {asked}")])
    found = [one for one in result.covariances if _all_known(one.covariance)]
    if len(found) != 1:
        text = f"the record's {result.name} predicts no covariance of all parameters together"
        raise ProblemError([Flaw(("prior", "record"), text)])
    return Prior(parameters=found[0].parameters, covariance=found[0].covariance)


def _all_known(covariance: list[list[float | None]]) -> bool:
    return all(value is not None for row in covariance for value in row)

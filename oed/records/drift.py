"""How much the logs of an estimate drift, for the design of the next drive."""

from __future__ import annotations

from pathlib import Path

from oed.estimation.methods.log_errors import DRIFT, RATES
from oed.foundation.errors import Issue, ProblemError, RecordError
from oed.records.record import load_estimate
from oed.study.estimated import Drift


def drift_of(folder: Path) -> Drift:
    """The drift that an estimate reports.

    Raises:
        ProblemError: no such estimate, or one that says nothing of drift; the key is the caller's.
    """
    try:
        found = load_estimate(folder).drift
    except RecordError as error:
        raise ProblemError([Issue((), "; ".join(map(str, error.issues)))]) from None
    if found is None:
        text = "expected an estimate that says how much its logs drift: of poses, by joint or likelihood"
        raise ProblemError([Issue((), text)])
    return Drift(**{rate: getattr(found, name) for name, rate in zip(DRIFT, RATES, strict=True)})

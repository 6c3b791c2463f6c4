"""The gist of an estimate in sentences: what it is worth on the road, and what speaks against it."""

from __future__ import annotations

from collections.abc import Sequence

from oed.foundation.text import in_signs, quantity, unit_for
from oed.records.stored.estimate import EstimateRecord
from oed.report.estimate.dead_reckoning import Run, folds_of, means, one_by_one, tested
from oed.report.estimate.logs import LogFinding, findings
from oed.report.parts.prose import Prose

SAY = Prose("estimate/gist")
GAINS = (
    ("drift over 1 m of path", "drift_position", "m"),
    ("position error (RMS)", "rmse_position", "m"),
    ("heading error (RMS)", "rmse_heading", "rad"),
)
"""What one sentence says of dead reckoning, and the numbers' names and units."""
WORSE = 1.05
"""Ratio of errors after and before from which on the estimate has made dead reckoning worse."""


def gains(record: EstimateRecord) -> list[str]:
    """A sentence each on the test set and on cross-validation; [] without positions."""
    test, folds = tested(record.test_set), folds_of(record)
    parts = SAY("folds", len(record.cross_validation), one_by_one(record))
    found = (_gain(SAY("test_set", len(test)), test), _gain(parts, folds))
    return list(filter(None, found))


def _gain(which: str, runs: Sequence[Run]) -> str:
    pairs = [(name, means(runs, key), unit) for name, key, unit in GAINS]
    return SAY("gain", which, [_change(name, *pair, unit) for name, pair, unit in pairs if pair])


def _change(name: str, before: float, after: float, unit: str) -> tuple[str, str, str]:
    shown, factor = unit_for([max(before, after)], unit)
    return name, quantity(before * factor, shown), quantity(after * factor, shown)


def warnings(record: EstimateRecord) -> list[str]:
    """What must not be overlooked, the gravest first."""
    found = [SAY("not_converged")] if record.converged is False else []
    found += [sentence(text) for text in record.not_identifiable]
    return list(filter(None, [*found, *_doubts(record), _worse(record), *_failed(record)]))


def notes(record: EstimateRecord) -> list[str]:
    """What was decided or seen on the way."""
    return [sentence(text) for text in record.notes]


def _worse(record: EstimateRecord) -> str:
    runs = tested(record.test_set) or folds_of(record)
    pairs = [(name, means(runs, key)) for name, key, _ in GAINS]
    return SAY("worse", [name for name, pair in pairs if pair is not None and pair[1] > WORSE * pair[0]])


def _failed(record: EstimateRecord) -> list[str]:
    # The other ways to a covariance allow for what is left of correlations and of differences between logs.
    trusting = record.covariance_kind == "information"
    grave = {"outliers", "whiteness", "logs_agree"} if trusting else {"outliers"}
    return [sentence(one.message) for one in record.diagnostics if not one.passed and one.name in grave]


def _doubts(record: EstimateRecord) -> list[str]:
    return [_doubt(group) for (_, doubtful), group in findings(record).items() if doubtful]


def _doubt(group: Sequence[LogFinding]) -> str:
    first = group[0]
    others = len({one.log for one in group} - {first.log})
    return SAY("doubt", first.log, in_signs(first.finding.message), others)


def sentence(text: str) -> str:
    """A message as a sentence of a page."""
    shown = in_signs(text)
    return f"{shown[:1].upper()}{shown[1:].rstrip('.')}."

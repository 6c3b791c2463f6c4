"""An estimate in the few lines that a terminal has room for."""

from __future__ import annotations

from oed.foundation.text import MISSING
from oed.records.stored.estimate import EstimateRecord
from oed.report.estimate.fit import segment_text
from oed.report.estimate.gist import gains, notes, warnings
from oed.report.estimate.logs import offset_clocks
from oed.report.estimate.models import model_lines
from oed.report.estimate.parameters import estimate_cells

CLOCKS_APART = 0.02
"""Offset of two clocks that is worth a line [s]."""
DRIFT = {None: "", True: "; longer ones drift", False: "; no drift found"}
"""What is said of segments that drift, or do not."""


def estimate_rows(record: EstimateRecord) -> list[list[str]]:
    """Of every parameter name, unit, nominal value, estimate, error, interval and change [%]."""
    return [[cell.replace(MISSING, "-") for cell in estimate_cells(one)] for one in record.parameters]


def estimate_lines(record: EstimateRecord) -> list[str]:
    """What the errors rest on, clocks, dead reckoning, models compared, warnings."""
    drift = DRIFT[record.segments.drifts if record.segments else None]
    clocks = offset_clocks(record, CLOCKS_APART)
    return [
        f"standard errors: {record.covariance_kind}, from {segment_text(record)}{drift}",
        *([f"wheels' clock ahead of the poses': {clocks}"] if clocks else []),
        *gains(record),
        *model_lines(record),
        *(f"warning: {text}" for text in warnings(record)),
        *(f"note: {text}" for text in notes(record)),
    ]

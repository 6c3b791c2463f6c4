"""An estimate in the few lines that a terminal has room for."""

from __future__ import annotations

from oed.report.estimate.gist import gains, notes, offset_clocks, warnings
from oed.report.estimate.models import model_lines
from oed.report.estimate.reading import Data, entries, segment_text
from oed.report.estimate.summary import estimate_cells
from oed.report.parts.tables import MISSING

CLOCKS_APART = 0.02
"""Offset of two clocks that is worth a line [s]."""


def estimate_rows(data: Data) -> list[list[str]]:
    """Of every parameter name, unit, nominal value, estimate, error, interval and change [%]."""
    cells = (estimate_cells(one) for one in entries(data, "parameters"))
    return [[str(cell).replace(MISSING, "-") for cell in row] for row in cells]


def estimate_lines(data: Data) -> list[str]:
    """What the errors rest on, clocks, dead reckoning, models compared, warnings."""
    lines = [f"standard errors: {data.get('covariance_kind')}, from {segment_text(data)}{_drift(data)}"]
    clocks = offset_clocks(data, CLOCKS_APART)
    if clocks:
        lines.append(f"wheels' clock ahead of the poses': {clocks}")
    lines += [*gains(data), *model_lines(data), *(f"warning: {text}" for text in warnings(data))]
    return [*lines, *(f"note: {text}" for text in notes(data))]


def _drift(data: Data) -> str:
    drifts = (data.get("segments") or {}).get("drifts")
    if drifts is None:
        return ""
    return "; longer ones drift" if drifts else "; no drift found"

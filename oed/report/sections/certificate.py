"""How far from the best possible: the upper bound that is proved, the gap, and what it rests on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oed.foundation.text import significant
from oed.records.record import Record
from oed.report.parts.section import Section
from oed.report.parts.tables import Column, Table


def certificate(record: Record) -> Section | None:
    """The record's certificate, None without one."""
    found = record.data.get("certificate")
    if not found:
        return None
    notices = ("This bound is loose: it leaves much open about how good a drive could be.",)
    return Section(
        "How far from the best possible",
        notices=notices if found.get("loose") else (),
        paragraphs=tuple(_reading(found)),
        tables=(_caps(found),) if len(found.get("caps", ())) > 1 else (),
    )


def _reading(found: Mapping[str, Any]) -> list[str]:
    six = significant(6)
    paragraphs = [
        f"No drive that satisfies the limits exactly has an objective above {six(found['upper_bound'])}. "
        f"This is proved by: {found['method']}. It assumes: {'; '.join(found['assumptions'])}."
    ]
    widened = found.get("widened")
    if widened:
        paragraphs.append(
            f"Scoring tolerates that a limit is exceeded by {percent(widened['tolerance'])} of its size. "
            f"With all limits so much wider, no drive has an objective above {six(widened['upper_bound'])}."
        )
    if found["gap"] is not None:
        paragraphs.append(_gap(found))
    if not found.get("complete", True):
        nodes = f" after {found['nodes']} nodes" if found.get("nodes") else ""
        paragraphs.append(
            f"The search for the bound was ended{nodes} by its limit of nodes, or a time limit; "
            "more of either may lower it."
        )
    spline, best = found.get("spline_objective"), found.get("best")
    if found.get("drive") and spline and best and best > spline:
        paragraphs.append(
            f"The drive `{found['drive']}`, which the search for the bound came upon, may change its speeds "
            f"from sample to sample. The best spline found has {percent(1 - spline / best)} less: that is "
            "lost to the splines' coefficients and to the search over them, not to the limits."
        )
    multiplier = found.get("multiplier")
    if multiplier:
        rows = "; ".join(" ".join(significant(4)(entry) for entry in row) for row in multiplier)
        paragraphs.append(
            "The multiplier Z of λ_min(F) ≤ tr(Z F), before any branching and in the scaled parameters, "
            f"is [{rows}]."
        )
    return paragraphs


def _gap(found: Mapping[str, Any]) -> str:
    # Drives that satisfy the limits exactly, and within the tolerance, each against its own bound.
    reached = f" ({significant(6)(found['best'])})" if found.get("best") else ""
    to = found.get("gap_to", found["upper_bound"])
    exact = to == found["upper_bound"]
    which = "satisfies the limits exactly and" if exact else "satisfies the limits within that tolerance and"
    of = "that bound" if exact and not found.get("widened") else "the bound for such drives"
    return (
        f"The best drive found{reached} {which} is within {percent(found['gap'])} of {of}: no drive can be "
        "better by more."
    )


def percent(share: float) -> str:
    """A share in percent, two digits of it; a bound reached to rounding is within 0.001 %."""
    return f"{significant(2)(100 * share)} %" if share > 1e-5 else "0.001 %"


def _caps(found: Mapping[str, Any]) -> Table:
    columns = (Column("upper bound", "", significant(6)), Column("proved by"), Column("assumes"))
    rows = tuple((cap["upper_bound"], cap["method"], "; ".join(cap["assumptions"])) for cap in found["caps"])
    return Table(columns, rows, "All bounds found; the smallest counts")

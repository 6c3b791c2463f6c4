"""The promised precision against simulated experiments."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from oed.foundation.text import fixed, listing, readable, significant, unit_text, words
from oed.records.record import Record
from oed.report.parts.measured import nuisance_names
from oed.report.parts.reading import is_regression
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table
from oed.report.sections.estimates import clouds, units_of

Outcome = Mapping[str, Any]

ROUNDING = 1e-9
"""Standard error of a ratio of variances below which it is that of rounding."""

HEADINGS = {
    "known": "with the true headings",
    "predicted": "with the headings that the first stage predicts, as in the paper",
    "measured": "with a noisy heading measured at every sample",
    "corrected": "with a noisy heading measured at every sample, corrected for errors in variables",
}
PROMISES = {
    "ols": "ordinary least squares, promising s²(W'W)⁻¹ [Choi, eq. 18] with s² one displacement's variance, "
    "as if displacements were independent and headings exact",
    "sandwich": "the same ordinary least squares, promising their covariance under all the noise there is, "
    "σ²(W'W)⁻¹W'KW(W'W)⁻¹ and what the headings add",
    "gls": "generalised least squares, which weigh by the noise's covariance and promise σ²(W'K⁻¹W)⁻¹",
    "errors_in_variables": "least squares with the bias taken out that noisy headings inside W cause, "
    "promising their covariance to first order",
}
"""Estimator -> what it does, and what its covariance is."""


def validation(record: Record) -> Section | None:
    """Verdict, tests of the best drive, estimates with their ellipses, and all drives side by side."""
    outcome = record.data["validation"]
    if outcome is None or not outcome["results"]:
        return None
    best = record.best
    entries = outcome["results"]
    name = best["name"] if best is not None else None
    chosen = [one for one in entries if one["name"] == name] or entries[:1]
    several = len(_estimators(entries)) > 1
    verdicts = [f"{_titled(one, several)}: {one['verdict']}" for one in chosen]
    return Section(
        "Validation by simulation",
        paragraphs=(_intro(record, outcome, _estimators(entries)), *verdicts),
        figures=clouds(record, entries, chosen, several),
        tables=(
            *(_checks(one, outcome["alpha"], several) for one in chosen),
            _side_by_side(record, entries, chosen[0], several),
        ),
    )


def _estimators(entries: Sequence[Outcome]) -> list[str]:
    # Records from before there was a choice are the paper's.
    return list(dict.fromkeys(one.get("estimator") or "ols" for one in entries))


def _titled(entry: Outcome, several: bool) -> str:
    return f"{entry['name']} by {words(entry['estimator'])}" if several else str(entry["name"])


def _intro(record: Record, outcome: Outcome, estimators: list[str]) -> str:
    simulated = f"Each drive was simulated {outcome['replicates']} times with the study's noise; each time "
    if not is_regression(record):
        return f"{simulated}{_joint(record, outcome)}"
    as_in_paper = record.data["study"]["measurement"].get("noise_model", "increments") == "increments"
    told = _regressions(outcome, estimators, as_in_paper)
    return f"{simulated}{told}{_without_prior(record)}"


def _regressions(outcome: Outcome, estimators: list[str], as_in_paper: bool) -> str:
    heading = HEADINGS[outcome["heading"]]
    if estimators == ["ols"] and as_in_paper:
        exact = ", for which the formula is made" if outcome["heading"] == "known" else ""
        return (
            "the coefficients were estimated by two-stage least squares [Choi, eqs 12, 16] "
            f"{heading}{exact}. The promise is σ²(W'W)⁻¹ [Choi, eq. 18]."
        )
    told = [PROMISES.get(name, words(name)) for name in estimators]
    if len(told) == 1:
        return f"the coefficients were estimated {heading} by {told[0]}."
    named = "; ".join(f"{words(name)} is {promise}" for name, promise in zip(estimators, told, strict=True))
    return f"the coefficients were estimated {heading}, in {len(told)} ways: {named}."


def _without_prior(record: Record) -> str:
    if not record.data["study"].get("prior"):
        return ""
    return (
        " What was known beforehand takes no part in these estimates, so that their promises are those of "
        "the drive alone, wider than the predictions above."
    )


def _joint(record: Record, outcome: Outcome) -> str:
    along = nuisance_names(record)
    beside = f", along with {listing(along)}" if along else ""
    prior = record.data["study"].get("prior")
    further = ", and what was known beforehand counted as a reading" if prior else ""
    loss = outcome.get("loss") or "linear"
    robust = (
        f" A robust loss ({words(loss)}) bounded the influence of outliers; the promise allows for its cost."
        if loss != "linear"
        else ""
    )
    return (
        f"the parameters were estimated by nonlinear least squares from all readings together{beside}"
        f"{further}. The promise is F⁻¹.{robust}"
    )


def _checks(entry: Outcome, alpha: float, several: bool) -> Table:
    columns = (
        Column("test"),
        Column("question"),
        Column("found", "", significant(4)),
        Column("expected from", "", significant(4)),
        Column("to", "", significant(4)),
        Column("p-value", "", significant(2)),
        Column("passed"),
    )
    rows = tuple(
        (
            check["name"],
            check["question"],
            float(check["statistic"]),
            float(check["expected"][0]),
            float(check["expected"][1]),
            float(check["p_value"]),
            bool(check["passed"]),
        )
        for check in entry["checks"]
    )
    name = _titled(entry, several)
    caption = f"Tests of {name}, judged together: a right formula fails with probability {alpha:g}"
    if any(check["passed"] and not _inside(check) for check in entry["checks"]):
        caption += "; a single one may well be outside its range"
    return Table(columns, rows, caption)


def _inside(check: Mapping[str, Any]) -> bool:
    return bool(check["expected"][0] <= check["statistic"] <= check["expected"][1])


def _side_by_side(record: Record, entries: Sequence[Outcome], chosen: Outcome, several: bool) -> Table:
    units = {parameter["name"]: parameter["unit"] for parameter in record.data["parameters"]}
    shown = units_of(record, chosen)
    finer = any(shown[name][0] != readable(1.0, units[name])[1] for name in chosen["parameters"])
    columns = (
        Column("result"),
        *((Column("estimator"),) if several else ()),
        Column("parameter"),
        Column("unit"),
        Column("true", "", significant(4)),
        Column("mean estimate", "", significant(4)),
        *((Column("deviations in"),) if finer else ()),
        Column("promised deviation", "", significant(3)),
        Column("simulated deviation", "", significant(3)),
        Column("variance, simulated/promised", "", fixed(3)),
        Column("± (paired)", "", _error),
        Column("all tests passed"),
    )
    rows = []
    for entry in entries:
        estimator = (words(entry["estimator"]),) if several else ()
        for index, name in enumerate(entry["parameters"]):
            unit, factor = shown[name]
            between = (unit or "1",) if finer else ()
            means, sizes = _means(entry, index, units[name]), _deviations(entry, index, factor)
            rows.append((str(entry["name"]), *estimator, *means, *between, *sizes))
    return Table(columns, tuple(rows), "All drives that tell the parameters apart")


def _error(size: float) -> str:
    # What rounding alone leaves is nothing.
    return significant(1)(size if size > ROUNDING else 0.0)


def _means(entry: Outcome, index: int, unit: str) -> tuple[Cell, ...]:
    # As many digits as show an estimate that is off by a hundredth of its deviation.
    scale, shown = readable(1.0, unit)
    hundredth = scale * math.sqrt(entry["promised_covariance"][index][index]) / 100.0
    write = fixed(max(0, math.ceil(-math.log10(hundredth))) if hundredth > 0 else 4)
    true, mean = write(scale * entry["true"][index]), write(scale * entry["mean"][index])
    return words(entry["parameters"][index]), unit_text(shown) or "1", true, mean


def _deviations(entry: Outcome, index: int, factor: float) -> tuple[Cell, ...]:
    return (
        factor * math.sqrt(entry["promised_covariance"][index][index]),
        factor * math.sqrt(entry["sampled_covariance"][index][index]),
        float(entry["paired_variance_ratio"][index]),
        float(entry["paired_standard_error"][index]),
        bool(entry["passed"]),
    )

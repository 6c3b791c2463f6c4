"""Model selection: by likelihood, by cross-validation, and what each model has for parameters."""

from __future__ import annotations

from collections.abc import Sequence

from oed.foundation.text import (
    MISSING,
    error_text,
    fixed,
    own_unit,
    shown_unit,
    significant,
    size_text,
    to_error,
    whole,
    words,
)
from oed.records.stored.estimate import ComparedModel, EstimateRecord, Score
from oed.report.parts.prose import Prose
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table, scaled, sized

SAY = Prose("estimate/models")
LIKELIHOODS, PREDICTION = ("aicc", "bic"), "held_out"
"""Measures of a model."""


def models(record: EstimateRecord) -> Section | None:
    """Verdict, tables by likelihood and by prediction, parameters; None where no models were compared."""
    if not record.models:
        return None
    tables = (_by_likelihood(record), _by_prediction(record), _parameters(record))
    said = (verdict(record), _likelihood(record), _prediction(record))
    return Section(
        "Model selection",
        notices=tuple(filter(None, (SAY("note", one) for one in record.models))),
        paragraphs=tuple(filter(None, said)),
        tables=tuple(table for table in tables if table is not None),
    )


def model_lines(record: EstimateRecord) -> list[str]:
    """The comparison in a few lines; [] where no models were compared."""
    return [*map(_line, record.models), verdict(record)] if record.models else []


def _line(one: ComparedModel) -> str:
    score = one.scores.get(PREDICTION)
    error = "" if score is None or score.value is None else size_text(score.value, "m")
    return SAY("line", one, error)


def verdict(record: EstimateRecord) -> str:
    """Which model is the best, and whether all measures say so."""
    compared = record.comparison
    if compared is None:
        return ""
    able = sum(one.comparable for one in compared.models)
    return SAY("verdict", compared.best, able, compared.favourites)


def _likelihood(record: EstimateRecord) -> str:
    compared, scores = record.comparison, [one for model in record.models for one in model.scores.values()]
    correlated = compared is not None and (compared.inflation or 1.0) > 1
    return SAY(
        "likelihood",
        record,
        bool(_scored(record, *LIKELIHOODS)),
        compared if correlated else None,
        # A state of its own in every segment's start is dear, however true the model.
        [one for one in record.models if (one.starts or 0.0) >= 1],
        any(one.interval for one in scores),
    )


def _prediction(record: EstimateRecord) -> str:
    return SAY("prediction", bool(_scored(record, PREDICTION)), len(record.logs))


def _scored(record: EstimateRecord, *measures: str) -> list[ComparedModel]:
    return [one for one in record.models if any(measure in one.scores for measure in measures)]


def _by_likelihood(record: EstimateRecord) -> Table | None:
    rows = tuple(_likelihood_row(one) for one in _scored(record, *LIKELIHOODS))
    columns = (
        Column("model"),
        Column("parameters", "", whole),
        Column("fitted in all", "", whole),
        Column("log-likelihood", "", fixed(1)),
        Column("ΔAICc", "", fixed(1)),
        Column("ΔBIC", "", fixed(1)),
        Column("± (95 %)", "", fixed(1)),
        Column("verdict"),
    )
    caption = "Models by likelihood: differences to the best, the less the better"
    return Table(columns, rows, caption) if rows else None


def _likelihood_row(one: ComparedModel) -> tuple[Cell, ...]:
    fitted, scores = (
        (one.unknowns or 0.0) + (one.starts or 0.0),
        [one.scores.get(name) for name in LIKELIHOODS],
    )
    # Both differ by what the numbers fitted cost, which is the same for every log.
    ends = next((score.interval for score in scores if score and score.interval), [None, None])
    low, high = ends
    return (
        SAY("label", one),
        float(len(one.parameters)),
        fitted,
        one.log_likelihood,
        *(None if score is None else score.difference for score in scores),
        None if low is None or high is None else (high - low) / 2,
        _standing(one, LIKELIHOODS),
    )


def _by_prediction(record: EstimateRecord) -> Table | None:
    scores = [(one, one.scores[PREDICTION]) for one in _scored(record, PREDICTION)]
    if not scores:
        return None
    column, factor = sized("typical position error", [score.value for _, score in scores], "m")
    least = min(score.value or 0.0 for _, score in scores)
    percent = 100 / least if least else 0.0
    columns = (
        Column("model"),
        column,
        Column("more than the best", "%", fixed(1)),
        Column("95 % interval", "%", fixed(1)),
        Column("verdict"),
    )
    rows = tuple(
        (
            SAY("label", one),
            scaled(score.value, factor),
            (score.difference or 0.0) * percent,
            _span(score, percent),
            _standing(one, (PREDICTION,)),
        )
        for one, score in scores
    )
    return Table(columns, rows, "Models by cross-validated dead reckoning")


def _span(score: Score, factor: float) -> str:
    low, high = score.interval or (None, None)
    if low is None or high is None:
        return MISSING
    return f"{fixed(1)(low * factor)} to {fixed(1)(high * factor)}"


def _standing(one: ComparedModel, measures: Sequence[str]) -> str:
    scores = {measure: one.scores[measure] for measure in measures if measure in one.scores}
    best = [measure for measure, score in scores.items() if not score.difference]
    equal = [measure for measure, score in scores.items() if score.equal and measure not in best]
    return SAY("standing", best, equal, len(scores))


def _parameters(record: EstimateRecord) -> Table | None:
    rows: list[tuple[Cell, ...]] = []
    for one in record.models:
        known = [entry for entry in one.parameters if entry.value is not None and one.comparable]
        for entry in known:
            factor, error = own_unit(entry.unit)[1], entry.standard_error
            value, spread = to_error(entry.value, error, factor), error_text(error, factor)
            rows.append((SAY("label", one), words(entry.name), shown_unit(entry.unit), value, spread))
    columns = (
        Column("model"),
        Column("parameter"),
        Column("unit"),
        Column("estimate", "", significant(5)),
        Column("± standard error", "", significant(2)),
    )
    return Table(columns, tuple(rows), "What each model is fitted with") if rows else None

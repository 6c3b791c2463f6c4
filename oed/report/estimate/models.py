"""Model selection: by likelihood, by cross-validation, and what each model has for parameters."""

from __future__ import annotations

from collections.abc import Sequence

from oed.foundation.text import (
    fixed,
    size_text,
    whole,
    words,
)
from oed.records.stored.compared import ComparedModel, Score
from oed.records.stored.estimate import EstimateRecord
from oed.report.parts.prose import Prose
from oed.report.parts.section import Column, Section, Table, estimated, sized

SAY = Prose("estimate/models")
LIKELIHOODS, PREDICTION = ("aicc", "bic"), "held_out"
"""Measures of a model."""
LABEL = Column("model", cell=lambda one: SAY("label", one))


def models(record: EstimateRecord) -> Section | None:
    """Verdict, tables by likelihood and by prediction, parameters; None where no models were compared."""
    if not record.models:
        return None
    tables = (_by_likelihood(record), _by_prediction(record), _parameters(record))
    predicted = SAY("prediction", bool(_scored(record, PREDICTION)), len(record.logs))
    notices = (SAY("note", one) for one in record.models)
    said = (verdict(record), _likelihood(record), predicted)
    return Section.of("Model selection", *said, *tables, notices=notices)


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


def _scored(record: EstimateRecord, *measures: str) -> list[ComparedModel]:
    return [one for one in record.models if any(measure in one.scores for measure in measures)]


def _by_likelihood(record: EstimateRecord) -> Table | None:
    def difference(one: ComparedModel, measure: str) -> float | None:
        return one.scores[measure].difference if measure in one.scores else None

    def half_interval(one: ComparedModel) -> float | None:
        # Both differ by what the numbers fitted cost, which is the same for every log.
        scores = [one.scores[name] for name in LIKELIHOODS if name in one.scores]
        low, high = next((score.interval for score in scores if score.interval), (None, None))
        return None if low is None or high is None else (high - low) / 2

    scored = _scored(record, *LIKELIHOODS)
    columns = (
        LABEL,
        Column("parameters", "", whole, lambda one: float(len(one.parameters))),
        Column("fitted in all", "", whole, lambda one: (one.unknowns or 0.0) + (one.starts or 0.0)),
        Column("log-likelihood", "", fixed(1), lambda one: one.log_likelihood),
        Column("ΔAICc", "", fixed(1), lambda one: difference(one, "aicc")),
        Column("ΔBIC", "", fixed(1), lambda one: difference(one, "bic")),
        Column("± (95 %)", "", fixed(1), half_interval),
        Column("verdict", cell=lambda one: _standing(one, LIKELIHOODS)),
    )
    caption = "Models by likelihood: differences to the best, the less the better"
    return Table.of(scored, columns, caption) if scored else None


def _by_prediction(record: EstimateRecord) -> Table | None:
    def score(one: ComparedModel) -> Score:
        return one.scores[PREDICTION]

    def span(one: ComparedModel) -> str | None:
        low, high = score(one).interval or (None, None)
        if low is None or high is None:
            return None
        return f"{fixed(1)(low * percent)} to {fixed(1)(high * percent)}"

    scored = _scored(record, PREDICTION)
    if not scored:
        return None
    sizes = [score(one).value for one in scored]
    least = min(size or 0.0 for size in sizes)
    percent = 100 / least if least else 0.0
    columns = (
        LABEL,
        sized("typical position error", "m", sizes, lambda one: score(one).value),
        Column("more than the best", "%", fixed(1), lambda one: (score(one).difference or 0.0) * percent),
        Column("95 % interval", "%", fixed(1), span),
        Column("verdict", cell=lambda one: _standing(one, (PREDICTION,))),
    )
    return Table.of(scored, columns, "Models by cross-validated dead reckoning")


def _standing(one: ComparedModel, measures: Sequence[str]) -> str:
    scores = {measure: one.scores[measure] for measure in measures if measure in one.scores}
    best = [measure for measure, score in scores.items() if not score.difference]
    equal = [measure for measure, score in scores.items() if score.equal and measure not in best]
    return SAY("standing", best, equal, len(scores))


def _parameters(record: EstimateRecord) -> Table | None:
    comparable = [one for one in record.models if one.comparable]
    items = [(one, entry) for one in comparable for entry in one.parameters if entry.value is not None]
    columns = (
        Column("model", cell=lambda item: SAY("label", item[0])),
        Column("parameter", cell=lambda item: words(item[1].name)),
        *estimated(lambda item: item[1]),
    )
    return Table.of(items, columns, "What each model is fitted with") if items else None

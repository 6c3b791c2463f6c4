"""Models compared: by likelihood, by the prediction of logs left out, and what each has for parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from oed.foundation.text import count, fixed, listing, significant, unit_text, whole, words
from oed.report.estimate.numbers import error_text, known, own_unit, scaled, size_text, sized, to_error
from oed.report.estimate.reading import Data, asked
from oed.report.parts.section import Section
from oed.report.parts.tables import MISSING, Cell, Column, Table

Model = Mapping[str, Any]

MEASURES = {"aicc": "AICc", "bic": "BIC", "held_out": "the prediction of logs left out"}
"""Measure -> what it is called."""
COUNTED = {
    "blocks": "by how much successive parts of the logs disagree",
    "correlations": "by the residuals' correlations",
}
"""How correlated readings are counted, in words."""
NOISES = {
    "constant": "a constant noise of its own, of the size that makes the readings most likely",
    "stated": "the noise that the study states",
}
USUAL_NOISE = (
    "noise of its own, of the same form for all, whose size and growth with speed and yaw rate make the "
    "readings most likely"
)


def models(data: Data) -> Section | None:
    """Verdict, tables by likelihood and by prediction, parameters; None where no models were compared."""
    if not _models(data):
        return None
    tables = (_by_likelihood(data), _by_prediction(data), _parameters(data))
    return Section(
        "Models compared",
        notices=tuple(notes(data)),
        paragraphs=tuple(
            filter(None, (verdict(data), _likelihood_explained(data), _prediction_explained(data)))
        ),
        tables=tuple(table for table in tables if table is not None),
    )


def model_lines(data: Data) -> list[str]:
    """The comparison in a few lines; [] where no models were compared."""
    if not _models(data):
        return []
    return [*map(_line, _models(data)), verdict(data)]


def _line(one: Model) -> str:
    name = f"model {_label(one)}"
    if not one["comparable"]:
        return f"{name}: not comparable: {one['reason']}"
    told = [count(len(one["parameters"]), "parameter")]
    for measure in ("aicc", "bic"):
        score = one["scores"].get(measure)
        told += [f"{MEASURES[measure]} {_plus(score['difference'])}"] if score else []
    error = known((one["scores"].get("held_out") or {}).get("value"))
    told += [] if error is None else [f"position error of logs left out {size_text(error, 'm')}"]
    return f"{name}: {', '.join(told)}" + (f" ({one['doubt']})" if one["doubt"] else "")


def verdict(data: Data) -> str:
    """Which model is the best, and whether all measures say so."""
    compared = data["comparison"]
    best, able = compared["best"], [one for one in _models(data) if one["comparable"]]
    if not best or len(able) < 2:
        return "There are no two models that can be compared."
    names = list(dict.fromkeys(best.values()))
    parts = [f"{words(name)} is the best by {_measures(best, name)}" for name in names]
    text = f"Of {count(len(able), 'model')} {'; '.join(parts)}."
    if len(names) == 1:
        equal = [words(name) for name in compared["favourites"] if name not in names]
        return f"{text} Practically equal to it: {listing(equal)}." if equal else text
    equal = [words(name) for name in compared["favourites"]]
    by = "both" if len(best) == 2 else f"all {len(best)}"
    return f"{text} " + (f"As good as the best by {by}: {listing(equal)}." if equal else "They disagree.")


def _measures(best: Mapping[str, str], name: str) -> str:
    return listing([MEASURES[measure] for measure, first in best.items() if first == name])


def notes(data: Data) -> list[str]:
    """Models that cannot be compared, or whose fit is in doubt."""
    found = []
    for one in _models(data):
        if not one["comparable"]:
            found.append(f"{_label(one)} cannot be compared: {one['reason']}.")
        elif one["doubt"]:
            found.append(f"{_label(one)}: {one['doubt']}.")
    return found


def _models(data: Data) -> list[Model]:
    return list((data.get("comparison") or {}).get("models") or [])


def _label(one: Model) -> str:
    own = " (the study's)" if one["own"] else ""
    return f"{words(str(one['name']))}{own}"


def _having(data: Data, measures: Sequence[str]) -> list[Model]:
    return [one for one in _models(data) if any(measure in one["scores"] for measure in measures)]


def _likelihood_explained(data: Data) -> str:
    if not _having(data, ("aicc", "bic")):
        if asked(data, "loss") in ("auto", "linear"):
            return ""
        return "A robust loss is no likelihood of the readings: only predictions are compared."
    noise = NOISES.get(str(asked(data, "noise")), USUAL_NOISE)
    return (
        f"Every model is fitted to the same readings, in the same segments, and has {noise}. AICc and BIC "
        "set how likely a model makes the readings against the number of what is fitted: AICc looks for the "
        "best prediction, BIC for the true model; less is better, and a difference of 2 or less is next to "
        f"nothing.{_counted(data['comparison'])}{_interval(data)}{_starts(data)}"
    )


def _starts(data: Data) -> str:
    # A state of its own in every segment's start is dear, however true the model.
    told = [one for one in _models(data) if (known(one["starts"]) or 0.0) >= 1]
    if not told:
        return ""
    each = [f"{known(one['starts']) or 0.0:.0f} of {_label(one)}" for one in told]
    return (
        f" States of segments' starts that not all models have are fitted, too ({listing(each)}): they weigh "
        "against such a model where segments are short. Predictions need none."
    )


def _counted(compared: Mapping[str, Any]) -> str:
    readings, factor = known(compared["readings"]) or 0.0, known(compared["inflation"]) or 1.0
    if factor <= 1:
        return ""
    how = COUNTED.get(str(compared["inflation_by"]), "")
    return (
        f" Residuals are correlated, so that {factor:.3g} readings count as one, judged {how}: of "
        f"{readings:.0f} there remain {readings / factor:.0f}."
    )


def _interval(data: Data) -> str:
    scores = [score for one in _models(data) for score in one["scores"].values()]
    if not any(score["interval"] for score in scores):
        return ""
    return " 95 % of differences lie so far to either side, by how much they vary from log to log."


def _prediction_explained(data: Data) -> str:
    if not _having(data, ("held_out",)):
        return "A single log leaves no other to be predicted." if len(data.get("logs") or []) == 1 else ""
    return (
        "The position error is that of dead reckoning along each log (RMS) by the model fitted to the others"
        "; typical is the geometric mean of the logs'. Up to 5 % more is practically equal."
    )


def _by_likelihood(data: Data) -> Table | None:
    having = _having(data, ("aicc", "bic"))
    if not having:
        return None
    columns = [
        Column("model"),
        Column("parameters", "", whole),
        Column("fitted in all", "", whole),
        Column("log-likelihood", "", fixed(1)),
    ]
    columns += [Column(f"Δ{MEASURES[measure]}", "", fixed(1)) for measure in ("aicc", "bic")]
    columns += [Column("± (95 %)", "", fixed(1)), Column("verdict")]
    rows = tuple(_likelihood_row(one) for one in having)
    return Table(tuple(columns), rows, "Models by likelihood: differences to the best, the less the better")


def _likelihood_row(one: Model) -> tuple[Cell, ...]:
    fitted = (known(one["unknowns"]) or 0.0) + (known(one["starts"]) or 0.0)
    cells: list[Cell] = [_label(one), float(len(one["parameters"])), fitted, known(one["log_likelihood"])]
    scores = [one["scores"].get(measure) or {} for measure in ("aicc", "bic")]
    cells += [known(score.get("difference")) for score in scores]
    # Both differ by what the numbers fitted cost, which is the same for every log.
    low, high = next((score["interval"] for score in scores if score.get("interval")), (None, None))
    half = None if low is None or high is None else (high - low) / 2
    return *cells, half, _by_measures(one, ("aicc", "bic"))


def _by_prediction(data: Data) -> Table | None:
    having = _having(data, ("held_out",))
    if not having:
        return None
    scores = [one["scores"]["held_out"] for one in having]
    column, factor = sized("typical position error", [known(score["value"]) for score in scores], "m")
    least = min(known(score["value"]) or 0.0 for score in scores)
    rows = []
    for one, score in zip(having, scores, strict=True):
        percent = 100 / least if least else 0.0
        more = (known(score["difference"]) or 0.0) * percent
        error = scaled(known(score["value"]), factor)
        rows.append((_label(one), error, more, _span(score, percent, 1), _by_measures(one, ("held_out",))))
    columns = (
        Column("model"),
        column,
        Column("more than the best", "%", fixed(1)),
        Column("95 % interval", "%", fixed(1)),
        Column("verdict"),
    )
    return Table(columns, tuple(rows), "Models by dead reckoning of logs left out")


def _span(score: Mapping[str, Any], factor: float, decimals: int) -> str:
    ends = [known(end) for end in score.get("interval") or ()]
    if len(ends) != 2 or None in ends:
        return MISSING
    low, high = (fixed(decimals)((end or 0.0) * factor) for end in ends)
    return f"{low} to {high}"


def _by_measures(one: Model, measures: Sequence[str]) -> str:
    scores = {measure: one["scores"][measure] for measure in measures if measure in one["scores"]}
    best = [measure for measure, score in scores.items() if not score["difference"]]
    equal = [measure for measure, score in scores.items() if score["equal"] and measure not in best]
    told = []
    for what, which in (("best", best), ("practically equal", equal)):
        if len(which) == len(scores):
            return what
        if which:
            told.append(f"{what} by {listing([MEASURES[name] for name in which])}")
    return ", ".join(told) or "worse"


def _parameters(data: Data) -> Table | None:
    rows = []
    for one in _models(data):
        for entry in one["parameters"]:
            unit, factor = own_unit(str(entry["unit"] or ""))
            value, error = known(entry["value"]), known(entry["standard_error"])
            if value is not None and one["comparable"]:
                shown = unit_text(unit) or "1"
                cells = (_label(one), words(str(entry["name"])), shown)
                rows.append((*cells, to_error(value, error, factor), error_text(error, factor)))
    columns = (
        Column("model"),
        Column("parameter"),
        Column("unit"),
        Column("estimate", "", significant(5)),
        Column("± standard error", "", significant(2)),
    )
    return Table(columns, tuple(rows), "What each model is fitted with") if rows else None


def _plus(value: float | None) -> str:
    return "?" if value is None else f"+{value:.1f}" if value else "best"

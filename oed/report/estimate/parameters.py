"""What was estimated, and what it is worth on the road: parameters, nuisance parameters, coefficients."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from oed.foundation.text import (
    MISSING,
    decimals_of,
    error_text,
    in_signs,
    nominal_text,
    own_unit,
    quantity,
    significant,
    size_text,
    to_error,
    unit_for,
    unit_text,
    words,
)
from oed.records.stored.estimate import Estimated, EstimateRecord, Finding, FoundNoise, Unknown
from oed.report.estimate.dead_reckoning import (
    Run,
    folds_of,
    means,
    one_by_one,
    path_picture,
    reckoned,
    tested,
)
from oed.report.estimate.fit import error_line
from oed.report.estimate.logs import MOST_ROWS, clock_label, clocks, findings, offset_clocks
from oed.report.estimate.models import model_lines
from oed.report.parts.prose import Prose
from oed.report.parts.section import Cell, Column, Section, Table, estimated, lasting, span_text

SAY = Prose("estimate/parameters")
PLACES = {
    "sensor_x": "pose sensor ahead of the robot's origin",
    "sensor_y": "pose sensor to the left of it",
    "sensor_heading": "pose sensor turned to the left",
}
"""Coordinates of the sensor in words."""
GAINS = (
    ("drift over 1 m of path", "drift_position", "m"),
    ("position error (RMS)", "rmse_position", "m"),
    ("heading error (RMS)", "rmse_heading", "rad"),
)
"""What one sentence says of dead reckoning, and the numbers' names and units."""
WORSE = 1.05
"""Ratio of errors after and before from which on the estimate has made dead reckoning worse."""
SKIPPED = ("skipped_inputs", "skipped_poses")
"""Findings that a terminal names though they cast no doubt: what of a log was left out."""
BIAS = "bias, at most"
"""Heading of what noise of the inputs may do."""
INTERVAL = 5
"""Place of the column of intervals."""
WORTH_A_LINE = 0.02
"""Offset of two clocks that is worth a line in a terminal [s]."""


def summary(record: EstimateRecord) -> Section:
    """The first screen: warnings; paths before and after beside the estimates, whether to trust them, what
    next, and what was decided on the way.
    """
    warned = warnings(record)
    failed = sum(not one.passed for one in record.diagnostics)
    unseen = bool(tested(record.test_set) or folds_of(record))
    judged = SAY("trust", len(warned), failed, len(record.diagnostics), unseen)
    made = Section.of(
        "Summary",
        _finding(record),
        judged,
        SAY("next", *_worst(record), bool((record.study or {}).get("trajectory"))),
        path_picture(record),
        _brief(record),
        notices=warned,
    )
    intervals = Section("Intervals", tables=(estimates(record),))
    return replace(made, first=True, remarks=tuple(map(sentence, record.notes)), folds=(intervals,))


def _finding(record: EstimateRecord) -> str:
    # What the estimates do for odometry, else how far what changed most is from its nominal value.
    which, runs = reckoned(record)
    errors = means(runs, "rmse_position")
    if errors is not None:
        return SAY("odometry", [size_text(error, "m") for error in errors], which)
    changes = {
        one.name: 100 * (one.value - one.nominal) / one.reference
        for one in record.parameters
        if one.value is not None and one.nominal is not None and one.reference
    }
    name = max(changes, key=lambda name: abs(changes[name]), default="")
    return SAY("changed", words(name), changes.get(name, 0.0))


def _brief(record: EstimateRecord) -> Table:
    def estimate(one: Estimated) -> str:
        unit, factor = own_unit(one.unit)
        value, error = (
            to_error(one.value, one.standard_error, factor),
            error_text(one.standard_error, factor),
        )
        return f"{value} ± {error} {unit_text(unit)}".strip()

    def nominal(one: Estimated) -> str:
        return f"{_nominal(one)} {unit_text(own_unit(one.unit)[0])}".strip()

    columns = (
        Column("parameter", cell=lambda one: words(one.name)),
        Column("nominal", "", significant(5), nominal),
        Column("estimate ± standard error", "", significant(5), estimate),
        Column("change", "%", significant(3), _change),
        *_bias(record, with_unit=True),
    )
    return Table.of(record.parameters, columns)


def trust(record: EstimateRecord) -> Section:
    """What the estimates do for dead reckoning, how they lie to the nominal values, and what they rest on."""
    origin = SAY("origin", record, lasting(sum(log.seconds or 0.0 for log in record.logs)))
    outside = [one.name for one in record.parameters if one.nominal_outside]
    nominal = SAY("nominal", outside, len(record.parameters))
    return Section.of("Before and after", " ".join(gains(record)), nominal, origin)


def _worst(record: EstimateRecord) -> tuple[str, str]:
    # The parameter of the largest relative standard error, and that error; ("", "") where none is known.
    shares = {
        one.name: 100 * one.standard_error / (abs(one.value) if one.reference else one.size or abs(one.value))
        for one in record.parameters
        if one.value and one.standard_error is not None
    }
    if not shares:
        return "", ""
    name = max(shares, key=lambda name: shares[name])
    return words(name), f"{significant(2)(shares[name])} %"


def estimates(record: EstimateRecord) -> Table:
    """Every parameter with its nominal value, estimate, error, interval and change."""
    unit, value, error = estimated()
    columns = (
        Column("parameter", cell=lambda one: words(one.name)),
        unit,
        Column("nominal", "", significant(5), _nominal),
        value,
        error,
        Column("95 % interval", "", significant(5), _interval),
        Column("change", "% of nominal", significant(3), _change),
        *_bias(record),
    )
    return Table.of(record.parameters, columns, "Estimates, rounded to their errors' second digit")


def _nominal(one: Estimated) -> str:
    return MISSING if one.nominal is None else nominal_text(one.nominal * own_unit(one.unit)[1])


def _interval(one: Estimated | Unknown) -> str:
    low, high = one.interval or (None, None)
    return span_text(low, high, one.standard_error, own_unit(one.unit)[1])


def _bias(record: EstimateRecord, *, with_unit: bool = False) -> list[Column]:
    # By how much noise of the inputs may have moved estimates, where it may have moved any by much.
    def size(one: Estimated) -> str:
        if one.bias is None or one.name not in record.diluted:
            return ""
        unit, factor = own_unit(one.unit)
        return f"{one.bias * factor:+.2g} {unit_text(unit) if with_unit else ''}".strip()

    return [Column(BIAS, "", significant(2), size)] if record.diluted else []


def _change(one: Estimated) -> str:
    if one.value is None or one.nominal is None or not one.reference:
        return MISSING
    percent, error = 100.0 / one.reference, one.standard_error
    rounded = decimals_of(None if error is None else error * percent) is not None
    change = one.value - one.nominal
    text = to_error(change, error, percent) if rounded else significant(3)(percent * change)
    return text if text.startswith("-") or not change else f"+{text}"


def estimate_rows(record: EstimateRecord) -> list[list[str]]:
    """The table of estimates for a terminal, which has no room for their intervals."""
    rows = ([*row[:INTERVAL], *row[INTERVAL + 1 :]] for row in estimates(record).cells)
    return [[cell.replace(MISSING, "-") for cell in row] for row in rows]


def estimate_lines(record: EstimateRecord) -> list[str]:
    """For a terminal: doubts of single estimates, what the errors rest on, clocks, dead reckoning, models
    compared, other warnings.
    """
    offset, warned, first = offset_clocks(record, WORTH_A_LINE), warnings(record), len(record.doubts)
    return [
        *(f"warning: {text}" for text in warned[:first]),
        error_line(record),
        *([f"wheels' clock ahead of the poses': {offset}"] if offset else []),
        *gains(record),
        *model_lines(record),
        *(f"warning: {text}" for text in warned[first:]),
        *(f"note: {_doubt(group)}" for (one, _), group in findings(record).items() if one in SKIPPED),
        *(f"note: {sentence(text)}" for text in record.notes),
    ]


def gains(record: EstimateRecord) -> list[str]:
    """A sentence each on the test set and on cross-validation; [] without positions."""
    test, folds = tested(record.test_set), folds_of(record)
    parts = SAY("folds", len(record.cross_validation), one_by_one(record))
    found = (_gain(SAY("test_set", len(test)), test), _gain(parts, folds))
    return list(filter(None, found))


def _gain(which: str, runs: Sequence[Run]) -> str:
    pairs = [(name, means(runs, key), unit) for name, key, unit in GAINS]
    return SAY("gain", which, [_fell(name, *pair, unit) for name, pair, unit in pairs if pair])


def _fell(name: str, before: float, after: float, unit: str) -> tuple[str, str, str]:
    shown, factor = unit_for([max(before, after)], unit)
    return name, quantity(before * factor, shown), quantity(after * factor, shown)


def warnings(record: EstimateRecord) -> list[str]:
    """What must not be overlooked, the gravest first."""
    found = [sentence(one.message) for one in record.doubts]
    found += [SAY("not_converged")] if record.converged is False else []
    found += [sentence(text) for text in record.not_identifiable]
    found += [_doubt(group) for (_, doubtful), group in findings(record).items() if doubtful]
    return list(filter(None, [*found, _worse(record), *_failed(record)]))


def _worse(record: EstimateRecord) -> str:
    runs = tested(record.test_set) or folds_of(record)
    pairs = [(name, means(runs, key)) for name, key, _ in GAINS]
    return SAY("worse", [name for name, pair in pairs if pair is not None and pair[1] > WORSE * pair[0]])


def _failed(record: EstimateRecord) -> list[str]:
    # The other ways to a covariance allow for what is left of correlations; of differences between logs none
    # does but by how much whole logs disagree.
    trusting = record.covariance_kind == "information" and not record.log_errors
    grave = {"outliers", "whiteness", "logs_agree"} if trusting else {"outliers"}
    failed = (one for one in record.diagnostics if not one.passed)
    return [sentence(one.message) for one in failed if one.name in grave or one.allowed_for is False]


def _doubt(group: Sequence[tuple[str, Finding]]) -> str:
    log, first = group[0]
    return SAY("doubt", log, in_signs(first.message), len({name for name, _ in group} - {log}))


def sentence(text: str) -> str:
    """A message as a sentence of a page."""
    shown = in_signs(text)
    return f"{shown[:1].upper()}{shown[1:].rstrip('.')}{'' if shown.endswith('?') else '.'}"


def nuisances(record: EstimateRecord) -> Section | None:
    """Everything estimated beside the parameters, None where there is nothing."""
    places = (one for one in record.nuisances if one.name in PLACES)
    own = (one for one in record.nuisances if one.name not in PLACES and one.name != "clock_offset")
    tables = (
        _table("place", places, "Where the pose sensor sits"),
        _table("constant", own, "Constants of sensors"),
        _clocks(record),
        _noise(record),
        _coefficients(record),
    )
    found = [table for table in tables if table.rows]
    warned = SAY("clocks", offset_clocks(record))
    return Section.of("Nuisance parameters", *found, notices=[warned]) if found else None


def _table(title: str, some: Iterable[Unknown], caption: str) -> Table:
    name = Column(title, cell=lambda one: PLACES.get(one.name, words(one.name.replace(".", ": ", 1))))
    return Table.of(some, (name, *estimated()), caption)


def _coefficients(record: EstimateRecord) -> Table:
    table = _table("coefficient", record.coefficients, "Coefficients that these give")
    if not any(one.interval for one in record.coefficients):
        return table
    column = Column("95 % interval", cell=_interval)
    return Table.of(record.coefficients, (*table.columns, column), SAY("coefficients", record))


def _clocks(record: EstimateRecord) -> Table:
    every, caption = clocks(record), "How far the wheels' clock is ahead of the poses'"
    more = len(every) - MOST_ROWS
    if more > 0:
        every = sorted(every, key=lambda one: -abs(one.value or 0.0))[:MOST_ROWS]
        caption += ", the largest first"
    table = Table.of(every, (Column("log", cell=lambda one: clock_label(record, one)), *estimated()), caption)
    return table if more <= 0 else replace(table, rows=(*table.rows, (f"and {more} more", "", "", "")))


def _noise(record: EstimateRecord) -> Table:
    def at_rest(one: FoundNoise) -> Cell:
        return None if one.at_rest is None else size_text(one.at_rest, one.unit or "")

    def growth(name: str, per: str) -> Callable[[FoundNoise], str]:
        def text(one: FoundNoise) -> str:
            size = getattr(one, name)
            return f"{size_text(size, one.unit or '')} per {per}" if size else "none found"

        return text

    columns = (
        Column("readings", cell=lambda one: words(one.about)),
        Column("at rest", "", significant(3), at_rest),
        Column("growth with speed", "", significant(3), growth("per_speed", "m/s")),
        Column("growth with yaw rate", "", significant(3), growth("per_yaw_rate", "rad/s")),
    )
    own = any("position" in one.about or "heading" in one.about for one in record.noise)
    caption = "Noise of the poses" if own and len(record.noise) < 3 else "Noise of the readings"
    return Table.of(record.noise, columns, caption)

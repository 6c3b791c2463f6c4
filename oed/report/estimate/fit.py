"""What the error bars rest on: segments, ways to a covariance, tests of what the fit leaves."""

from __future__ import annotations

from collections.abc import Sequence

from oed.foundation.text import (
    error_text,
    fixed,
    in_signs,
    own_unit,
    shown_unit,
    significant,
    size_text,
    slug,
    words,
)
from oed.records.stored.estimate import EstimateRecord, FoundError, TriedLength
from oed.records.stored.parts import Column as Numbers
from oed.report.figures import calibration as figures
from oed.report.figures.calibration import Residuals, residuals_of
from oed.report.parts.prose import Prose
from oed.report.parts.section import Column, Picture, Section, Table, probability, sized

SAY = Prose("estimate/fit")
KINDS = ("information", "drift", "sandwich", "bootstrap")
"""Ways to a covariance, the most trusting first."""
UNEQUAL = 1.1
"""Ratio of standard errors from which on they are worth comparing in words."""
STRONG = 0.5
"""Correlation from which on the strongest of several is named."""
TESTS = {
    "whiteness": "residuals are white",
    "outliers": "no outliers",
    "stated_noise": "noise is as specified",
    "logs_agree": "logs agree",
}
"""Tests in words, as what they ask."""


def error_bars(record: EstimateRecord) -> Section:
    """Standard errors side by side, segments, correlations."""
    return Section.of(
        "What the error bars rest on",
        SAY("segments", record),
        SAY("errors", record, len(_kinds(record)) == 1, *_more_than_predicted(record)),
        _side_by_side(record),
        _errors(record),
        _lengths(record),
        _correlations(record),
    )


def error_line(record: EstimateRecord) -> str:
    """For a terminal: how standard errors were found, and from what."""
    return SAY("line", record)


def _more_than_predicted(record: EstimateRecord) -> tuple[str, str]:
    # How many times the errors in use are those of the information; nothing where they are about the same.
    kind = record.covariance_kind or ""
    pairs = [(one.error(kind), one.error("information")) for one in record.parameters]
    ratios = [own / other for own, other in pairs if own and other]
    if kind == "information" or max(ratios, default=0.0) < UNEQUAL:
        return "", ""
    return f"{min(ratios):.2g}", f"{max(ratios):.2g}"


def _kinds(record: EstimateRecord) -> list[str]:
    found = {kind for one in record.parameters for kind in one.standard_errors or {}}
    return [kind for kind in KINDS if kind in found] + sorted(found - set(KINDS))


def _side_by_side(record: EstimateRecord) -> Table | None:
    kinds, used = _kinds(record), record.covariance_kind
    if len(kinds) < 2:
        return None

    def column(kind: str) -> Column:
        title = f"{kind} (used)" if kind == used else kind
        return Column(
            title, "", significant(2), lambda one: error_text(one.error(kind), own_unit(one.unit)[1])
        )

    columns = (
        Column("parameter", cell=lambda one: words(one.name)),
        Column("unit", cell=lambda one: shown_unit(one.unit)),
        *map(column, kinds),
    )
    return Table.of(record.parameters, columns, "Standard errors")


def _errors(record: EstimateRecord) -> Table | None:
    if not record.log_errors:
        return None
    columns = (
        Column("", cell=lambda one: SAY("kind", one.kind)),
        Column("of", cell=lambda one: one.about),
        Column("size", cell=lambda one: _size(one.size, one.unit)),
        Column("95 % interval", cell=_size_interval),
    )
    return Table.of([one for one in record.log_errors if one.size], columns, SAY("errors_table"))


def _size_interval(one: FoundError) -> str:
    low, high = one.interval
    return "as specified" if low == high else " to ".join(_size(end, one.unit) for end in (low, high))


def _size(size: float | None, unit: str) -> str:
    return "" if size is None else size_text(size, unit, 2)


def _lengths(record: EstimateRecord) -> Table | None:
    segments = record.segments
    if segments is None or len(segments.tried) < 2:
        return None

    units = {one.about: one.unit for one in record.noise}

    def size(about: str) -> Column:
        unit = units.get(about) or ("m" if about == "position" else "rad")
        sizes = [one.sizes.get(about) for one in segments.tried]
        return sized(words(about), unit, sizes, lambda one: one.sizes.get(about))

    columns = (
        Column("segments", cell=lambda one: "whole logs" if one.seconds is None else f"{one.seconds:.3g} s"),
        *map(size, segments.tried[0].sizes),
        Column("variance over the shortest's", "", fixed(2), lambda one: _growth(one, segments.tried[0])),
        Column("chosen", cell=lambda one: "chosen" if one.seconds == segments.seconds else ""),
    )
    return Table.of(segments.tried, columns, "Size of the residuals (RMS) by the length of the segments")


def _growth(one: TriedLength, first: TriedLength) -> float | None:
    pairs = [(one.sizes.get(about), shortest) for about, shortest in first.sizes.items()]
    ratios = [(size / shortest) ** 2 for size, shortest in pairs if size is not None and shortest]
    return max(ratios, default=None)


def _correlations(record: EstimateRecord) -> Table | None:
    names, matrix = [words(one.name) for one in record.parameters], record.correlation
    if len(names) < 2 or not matrix:
        return None
    columns = (Column(""), *(Column(name, "", fixed(2)) for name in names[:-1]))
    rows = tuple(
        (name, *(matrix[row][column] if column < row else "" for column in range(len(names) - 1)))
        for row, name in enumerate(names)
        if row
    )
    return Table(columns, rows, SAY("strongest", *_strongest(names, matrix)))


def _strongest(names: Sequence[str], matrix: Sequence[Numbers]) -> tuple[str, str]:
    sizes = {
        (names[column], names[row]): abs(matrix[row][column] or 0.0)
        for row in range(len(names))
        for column in range(row)
    }
    pair = max(sizes, key=lambda names: sizes[names])
    return pair if len(sizes) > 1 and sizes[pair] >= STRONG else ("", "")


def fit(record: EstimateRecord) -> Section | None:
    """Verdicts, and a figure of the residuals of each kind of reading."""
    tests, drawn = record.diagnostics, residuals_of(record)
    if not tests and not drawn:
        return None
    failed = sum(not one.passed for one in tests)
    differ = any(not one.passed and one.allowed_for is False for one in tests)
    verdict = SAY("verdict", failed, len(tests), record.covariance_kind, bool(record.log_errors), differ)
    table = _tests(record) if tests else None
    return Section.of("Does the fit hold", verdict, table, *map(_picture, drawn))


def _tests(record: EstimateRecord) -> Table:
    columns = (
        Column("test", cell=lambda one: TESTS.get(one.name, words(one.name))),
        Column("of", cell=lambda one: words(one.about)),
        Column("verdict", cell=lambda one: "passed" if one.passed else "not\u00a0passed"),
        Column("statistic", "", significant(3), lambda one: one.statistic),
        Column("p-value", "", probability, lambda one: one.p_value),
        Column("in words", cell=lambda one: in_signs(one.message)),
    )
    return Table.of(record.diagnostics, columns, "Tests of the fit")


def _picture(one: Residuals) -> Picture:
    alt = f"Residuals of the {words(one.about)} over time, against speed, their distribution and correlations"
    name = f"estimate_residuals_{slug(one.about)}"
    return Picture(name, alt, SAY("residuals", one), figures.residuals(one))

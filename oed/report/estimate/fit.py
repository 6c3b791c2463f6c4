"""Does the fit hold? Tests of what it leaves, and the residuals to look at."""

from __future__ import annotations

from functools import partial
from typing import Any

from oed.foundation.text import count, significant, slug, words
from oed.report.estimate.numbers import known, probability
from oed.report.estimate.reading import Data, entries, in_signs
from oed.report.estimate.residuals import Residuals, residuals_of
from oed.report.parts.section import Picture, Section
from oed.report.parts.tables import MISSING, Column, Table

TESTS = {
    "whiteness": "residuals are white",
    "outliers": "no outliers",
    "stated_noise": "noise is as stated",
    "logs_agree": "logs agree",
}
"""Tests in words, as what they ask."""


def fit(data: Data) -> Section | None:
    """Verdicts, and a figure of the residuals of each kind of reading."""
    tests, drawn = entries(data, "diagnostics"), residuals_of(data)
    if not tests and not drawn:
        return None
    return Section(
        "Does the fit hold",
        paragraphs=(_verdict(data),) if tests else (),
        tables=(_tests(data),) if tests else (),
        figures=tuple(_picture(one) for one in drawn),
    )


def _verdict(data: Data) -> str:
    tests = entries(data, "diagnostics")
    failed = sum(not one["passed"] for one in tests)
    if not failed:
        return f"All {len(tests)} tests are passed: nothing speaks against the fit."
    text = f"{failed} of {count(len(tests), 'test')} {'is' if failed == 1 else 'are'} not passed."
    if data.get("covariance_kind") == "information":
        return f"{text} The error bars rest on the tests that ask for white residuals and logs that agree."
    return (
        f"{text} Real logs seldom have white residuals: wheels slip and sensors drift. The error bars above "
        "allow for that, since they do not rest on the noise model."
    )


def _tests(data: Data) -> Table:
    columns = (
        Column("test"),
        Column("of"),
        Column("verdict"),
        Column("statistic", "", significant(3)),
        Column("p-value", "", significant(2)),
        Column("in words"),
    )
    rows = []
    for one in entries(data, "diagnostics"):
        p_value = known(one.get("p_value"))
        rows.append(
            (
                TESTS.get(one["name"], words(str(one["name"]))),
                words(str(one["about"])),
                "passed" if one["passed"] else "not\u00a0passed",
                known(one.get("statistic")),
                MISSING if p_value is None else probability(p_value),
                in_signs(str(one["message"])),
            )
        )
    return Table(columns, tuple(rows), "Tests of the fit")


def _picture(one: Residuals) -> Picture:
    about = words(one.about)
    numbered = ", numbered as in the table of logs" if one.numbered else ""
    size = "their size in all" if one.at_rest is None else "the noise that the fit takes them to have"
    size += ", at the yaw rates driven at such speeds" if one.per_yaw_rate else ""
    caption = (
        f"Residuals of the {about}. Above: over time, one log after the other in alternating shades{numbered}"
        "; triangles at the edges stand for what lies beyond. Below, left: against speed, with their size "
        f"(RMS) by speed (line with dots) and {size} (dashed). Middle: in units of that against what a "
        "normal distribution would give (dashed). Right: correlation with residuals so many readings later; "
        "of white residuals 95 % lie between the dashed lines."
    )
    alt = f"Residuals of the {about} over time, against speed, their distribution and correlations"
    return Picture(f"estimate_residuals_{slug(one.about)}", alt, caption, partial(_draw, one))


def _draw(one: Residuals) -> Any:
    from oed.report.estimate import figures

    return figures.residuals(one)

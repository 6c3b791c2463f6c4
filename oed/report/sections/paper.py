"""The numbers by which the founding paper compares paths [Choi, eqs 17, 18 and the table of section 4]."""

from __future__ import annotations

from oed.foundation.text import readable, significant
from oed.kernel.criteria import E
from oed.kernel.measurement.information import scaling_text
from oed.records.record import Record
from oed.report.parts.reading import Entry, blocks, is_regression, value, with_drive
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table

RESPONSES = {"position": "m", "heading": "rad"}
"""SI unit of the measurement y of each block."""


def paper(record: Record) -> Section | None:
    """One row per result: eigenvalues, cond(W), s_min(W), |y| and the error factor of eq. 17.

    None for sensors: they have no regressor W.
    """
    if not with_drive(record) or not is_regression(record):
        return None
    unit = _response_unit(record)
    columns = (*_columns(record), *_response_columns(unit))
    rows = tuple(_row(entry, unit) for entry in record.results)
    return Section("The paper's figures", paragraphs=_reading(record, unit), tables=(Table(columns, rows),))


def _columns(record: Record) -> tuple[Column, ...]:
    # Without scaling F is W'W, and W is in radians of wheel angle.
    square = "rad²" if record.data["study"]["criterion"]["scaling"] == "none" else ""
    four = significant(4)
    return (
        Column("result"),
        Column("λ_min", square, four),
        Column("λ_max", square, four),
        Column("cond(W)", "", four),
        Column("s_min(W)", "rad", four),
    )


def _response_unit(record: Record) -> str | None:
    # |y| has a unit only where all rows of W measure one kind of thing.
    names = blocks(record)
    return RESPONSES.get(names[0]) if len(names) == 1 else None


def _response_columns(unit: str | None) -> tuple[Column, ...]:
    if unit is None:
        return ()
    shown = readable(1.0, unit)[1]
    return Column("|y|", shown, significant(4)), Column("cond(W)/|y|", f"1/{shown}", significant(4))


def _row(entry: Entry, unit: str | None) -> tuple[Cell, ...]:
    keys = ("lambda_min", "lambda_max", "condition_number", "smallest_singular_value")
    numbers = [value(entry, key) for key in keys]
    return (str(entry["name"]), *numbers, *_response(entry, unit))


def _response(entry: Entry, unit: str | None) -> tuple[Cell, ...]:
    if unit is None:
        return ()
    size, condition = value(entry, "norm_y"), value(entry, "condition_number")
    if size is None or condition is None:
        return None, None
    shown, _ = readable(size, unit)
    return shown, condition / shown if shown else None


def _reading(record: Record, unit: str | None) -> tuple[str, ...]:
    general = (
        "W is the regressor of y = W c + ρ, with ρ the noise: s_min(W) and cond(W) = s_max/s_min are "
        "taken of W itself, in radians of wheel angle."
    )
    if unit is None:
        factor = "|y| and eq. 17 are left out: this W has rows in m and in rad."
    else:
        factor = (
            "The relative error |c − ĉ|/|c| is at most cond(W)/|y| times |ρ| [Choi, eq. 17], with |y| the "
            f"size of the noise-free measurement, in {readable(1.0, unit)[1]}; smaller is better."
        )
    return f"{general} {_bound(record)}", *_eigenvalues(record), factor


def _bound(record: Record) -> str:
    study = record.study
    if getattr(study.measurement, "noise_model", "increments") == "absolute":
        return (
            "The bound σ/s_min(W) on the standard deviations [Choi, eq. 18] takes independent displacements; "
            "here neighbours share the error of the pose between them, which only F knows."
        )
    bound = "The parameters' standard deviations are at most σ/s_min(W) [Choi, eq. 18]"
    aimed = isinstance(study.criterion, E)
    return f"{bound}, so a large s_min is what a drive is designed for." if aimed else f"{bound}."


def _eigenvalues(record: Record) -> tuple[str, ...]:
    # What is special about F, whose eigenvalues stand in the table; in the paper's case it is W'W.
    study = record.data["study"]
    scaling, notes = study["criterion"]["scaling"], []
    if scaling != "none":
        notes.append(f"is in units of the noise, the parameters taken {scaling_text(scaling)}")
    if study.get("prior"):
        notes.append("holds what was known beforehand, which W does not")
    if study["criterion"].get("subset"):
        notes.append("is on the parameters that the criterion judges, the others eliminated")
    return (f"The information F, of which λ_min and λ_max are, {'; it '.join(notes)}.",) if notes else ()

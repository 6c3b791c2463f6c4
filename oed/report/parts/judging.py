"""What the criteria's numbers mean to a reader: efficiencies, and what each drive was searched for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from oed.kernel.criteria import CRITERIA
from oed.records.record import Record
from oed.report.parts.reading import Entry, is_regression, solver_options
from oed.report.parts.wording import count, deviation_text, listing, quantity, words

KINDS = {
    name: criterion.model_construct(kind=name)
    for criterion in CRITERIA
    if (name := str(criterion.model_fields["kind"].default))
}
"""Criteria by kind, for what does not depend on their options."""

SINGULAR = 1e-9
"""Share of the largest eigenvalue below which the smallest one counts as 0, in records that do not say so."""

NUMBERS = {"E": "λ_min", "D": "log det F", "A": "-tr F⁻¹", "modified_E": "-cond(F)"}
"""What a criterion's number is, in short."""

MEANINGS = {
    "E": "the smallest eigenvalue of the information",
    "D": "the logarithm of the information's determinant",
    "A": "minus the sum of the variances",
    "modified_E": "minus the condition number of the information",
}
"""What a criterion's number is, in words; G and I speak of their test drive."""

EFFICIENCIES = {
    "E": "λ_min/λ_min,best (the worst-determined combination of the parameters)",
    "D": "(det F/det F_best)^(1/p), p = {size} (the volume of the confidence ellipsoid)",
    "A": "tr F_best⁻¹/tr F⁻¹ (the mean variance of the parameters)",
    "G": "the best drive's largest variance of what is predicted for the test drive over this one's",
    "I": "the best drive's mean variance of what is predicted for the test drive over this one's",
}
"""What an efficiency by a criterion is; the information F is the drive's, F_best the best drive's."""


@dataclass(frozen=True)
class Aim:
    """A criterion that was searched for.

    Attributes:
        kind: of the criterion.
        label: its kind, and in what else it differs from the study's.
        size: number of parameters that it judges.
    """

    kind: str
    label: str
    size: int

    def efficiency(self, value: float, best: float) -> float | None:
        """Share of the best design that a design is worth; None for criteria that know no such share."""
        return KINDS[self.kind].efficiency(value, best, self.size)

    def change(self, value: float, best: float) -> float:
        """How much more `value` is than `best` [%]: in efficiency, or else of the number itself."""
        share = self.efficiency(value, best)
        return 100.0 * (share - 1.0 if share is not None else (value - best) / (abs(best) or 1.0))

    @property
    def number(self) -> str:
        """What its objectives are: `D (log det F)`."""
        return f"{self.label} ({NUMBERS[self.kind]})" if self.kind in NUMBERS else self.label


def study_aim(record: Record) -> Aim:
    """The study's own criterion."""
    kind = record.data["study"]["criterion"]["kind"]
    return Aim(kind, words(kind), len(judged(record)))


def aim_of(record: Record, entry: Entry) -> Aim:
    """What a search searched for: the study's criterion unless it was given its own."""
    own, kind = study_aim(record), entry.get("criterion")
    if kind is None:
        return own
    given = solver_options(record, entry).get("criterion") or {"kind": kind}
    study = record.data["study"]["criterion"]
    subset = given.get("subset")
    notes = [words(kind)]
    if subset != study.get("subset"):
        notes.append(f"of {listing([words(name) for name in subset]) if subset else 'all parameters'}")
    scaling = given.get("scaling", study["scaling"])
    if scaling != study["scaling"] and kind != "D":  # whose optimum no scaling changes
        notes.append(f"with the parameters {scaling_text(scaling)}")
    if kind == own.kind and given.get("test_drive") != study.get("test_drive"):
        notes.append("of another test drive")
    return Aim(kind, " ".join(notes), len(subset or record.data["parameters"]))


def by_aim(record: Record, searches: Sequence[Entry]) -> list[tuple[Aim, list[Entry]]]:
    """Searches by what they searched for, in their order: only within a group do objectives compare."""
    groups: dict[str, tuple[Aim, list[Entry]]] = {}
    for entry in searches:
        aim = aim_of(record, entry)
        groups.setdefault(aim.label, (aim, []))[1].append(entry)
    return list(groups.values())


def judged(record: Record) -> list[Mapping[str, Any]]:
    """The parameters that the study's criterion judges."""
    return [parameter for parameter in record.data["parameters"] if parameter.get("judged", True)]


def singular(entry: Entry) -> bool:
    """Whether a drive leaves some combination of the parameters undetermined, to rounding."""
    said = entry.get("singular")
    return rounded(entry) if said is None or entry["lambda_min"] is None else bool(said)


def useless(entry: Entry) -> bool:
    """Whether a drive leaves undetermined what the study's criterion asks about."""
    said = entry.get("identifiable")
    return rounded(entry) if said is None or entry["lambda_min"] is None else not said


def rounded(entry: Entry) -> bool:
    """Whether a result's numbers are rounding, by a record of before results said so themselves."""
    smallest, largest = entry["lambda_min"], entry["lambda_max"]
    return entry.get("singular") is None and smallest is not None and smallest <= SINGULAR * (largest or 0.0)


def objective_of(entry: Entry) -> float | None:
    """A result's objective; minus infinity where a drive tells too little for JSON to hold its number."""
    if entry["drive"] is None:
        return None
    return -math.inf if entry["objective"] is None else float(entry["objective"])


def repeatable(record: Record) -> bool:
    """Whether k drives tell k times as much as one: not by every criterion, and never with a prior."""
    aim = study_aim(record)
    shares = (aim.efficiency(value, value) for value in (1.0, -1.0))
    return any(share is not None for share in shares) and not record.data["study"].get("prior")


def scaling_text(scaling: Any) -> str:
    """In what units a criterion sees the parameters."""
    known = {"relative": "relative to their nominal values", "none": "in SI units"}
    return known[scaling] if isinstance(scaling, str) else "in units of the scales given"


def meaning(record: Record) -> str:
    """The study's criterion: its name, and in other than the founding paper's case, what it is."""
    criterion = record.data["study"]["criterion"]
    kind, scaling = str(criterion["kind"]), criterion["scaling"]
    if kind in ("G", "I"):
        of = "largest" if kind == "G" else "mean"
        legs = count(len(criterion["test_drive"]), "leg")
        return f"{kind}, minus the {of} variance of the {criterion['quantity']} predicted after {legs} driven"
    if kind == "E" and scaling == "none" and is_regression(record):
        return kind
    return f"{words(kind)}, {MEANINGS[kind]}, the parameters taken {scaling_text(scaling)}"


def precision(record: Record, entry: Entry) -> list[str]:
    """What a result's numbers say of its precision, in words: its worst direction, and its criterion's."""
    if singular(entry) or not entry["lambda_min"]:
        untold = "some combination of the parameters cannot be told"
        return [untold] if useless(entry) else [untold, *_by_criterion(record, entry)]
    scaling = record.data["study"]["criterion"]["scaling"]
    worst = entry["lambda_min"] ** -0.5
    size = f"{quantity(100 * worst, '%')} of nominal" if scaling == "relative" else quantity(worst, "")
    names = [words(parameter["name"]) for parameter in judged(record)]
    what = names[0] if len(names) == 1 else "the worst-determined combination of the parameters"
    told = f"{what} has a standard deviation of {size}"
    if scaling != "relative":
        told += f", {scaling_text(scaling)}"
    return [told, *_by_criterion(record, entry)]


def _by_criterion(record: Record, entry: Entry) -> list[str]:
    criterion, objective = record.data["study"]["criterion"], objective_of(entry)
    kind, size = criterion["kind"], len(judged(record))
    if objective is None or not math.isfinite(objective):
        return []
    if kind in ("G", "I"):
        unit = {"position": "m", "heading": "rad"}[criterion["quantity"]]
        of = "largest" if kind == "G" else "root mean square of the"
        deviation = deviation_text(math.sqrt(-objective), unit)
        return [f"the {of} standard deviation of a predicted {criterion['quantity']} is {deviation}"]
    if criterion["scaling"] != "relative" or kind not in ("D", "A") or size == 1:
        return []
    if kind == "D":
        name, mean = "geometric mean of those along the ellipsoid's axes", math.exp(-objective / 2 / size)
    else:
        name, mean = "root mean square of those of the parameters", math.sqrt(-objective / size)
    return [f"the {name} is {quantity(100 * mean, '%')}"]

"""What the criteria's numbers mean to a reader: efficiencies, and what each drive was searched for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from oed.foundation.text import listing, quantity, words
from oed.kernel.criteria import CRITERIA, Criterion, E
from oed.kernel.measurement.information import scaling_text
from oed.records.record import Record
from oed.report.parts.reading import Entry, is_regression, solver_of

SINGULAR = 1e-9
"""Share of the largest eigenvalue below which the smallest one counts as 0, in records that do not say so."""


@dataclass(frozen=True)
class Aim:
    """A criterion that was searched for.

    Attributes:
        criterion: itself.
        label: its kind, and in what else it differs from the study's.
        size: number of parameters that it judges.
    """

    criterion: Criterion
    label: str
    size: int

    def efficiency(self, value: float, best: float) -> float | None:
        """Share of the best design that a design is worth; None for criteria that know no such share."""
        return self.criterion.efficiency(value, best, self.size)

    def change(self, value: float, best: float) -> float:
        """How much more `value` is than `best` [%]: in efficiency, or else of the number itself."""
        share = self.efficiency(value, best)
        return 100.0 * (share - 1.0 if share is not None else (value - best) / (abs(best) or 1.0))

    @property
    def number(self) -> str:
        """What its objectives are: `D (log det F)`."""
        short = self.criterion.number
        return f"{self.label} ({short})" if short else self.label

    @property
    def share(self) -> str:
        """What its efficiency is, in words."""
        return self.criterion.share.format(size=self.size)


def study_aim(record: Record) -> Aim:
    """The study's own criterion."""
    return plain_aim(record, record.study.criterion.kind)


def plain_aim(record: Record, kind: str) -> Aim:
    """The study's parameters judged by a kind of criterion, for what does not depend on its options."""
    own = record.study.criterion
    kinds = {str(one.model_fields["kind"].default): one for one in CRITERIA}
    criterion = own if own.kind == kind else kinds[kind].model_construct(kind=kind, scaling=own.scaling)
    return Aim(criterion, words(kind), len(judged(record)))


def aim_of(record: Record, entry: Entry) -> Aim:
    """What a search searched for: the study's criterion unless it was given its own."""
    own, kind = study_aim(record), entry.get("criterion")
    if kind is None:
        return own
    study = own.criterion
    given = getattr(solver_of(record, entry), "criterion", None) or plain_aim(record, kind).criterion
    subset, notes = given.subset, [words(kind)]
    if subset != study.subset:
        notes.append(f"of {listing([words(name) for name in subset]) if subset else 'all parameters'}")
    if given.scaling != study.scaling and given.conceded != "determinant":  # whose optimum no scaling changes
        notes.append(f"with the parameters {scaling_text(given.scaling)}")
    if kind == study.kind and getattr(given, "test_drive", None) != getattr(study, "test_drive", None):
        notes.append("of another test drive")
    return Aim(given, " ".join(notes), len(subset or record.data["parameters"]))


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


def meaning(record: Record) -> str:
    """The study's criterion: its name, and in other than the founding paper's case, what it is."""
    criterion = record.study.criterion
    if isinstance(criterion, E) and criterion.scaling == "none" and is_regression(record):
        return criterion.kind
    return f"{words(criterion.kind)}, {criterion.meaning}"


def precision(record: Record, entry: Entry) -> list[str]:
    """What a result's numbers say of its precision, in words: its worst direction, and its criterion's."""
    if singular(entry) or not entry["lambda_min"]:
        untold = "some combination of the parameters cannot be told"
        return [untold] if useless(entry) else [untold, *_by_criterion(record, entry)]
    scaling = record.study.criterion.scaling
    worst = entry["lambda_min"] ** -0.5
    size = f"{quantity(100 * worst, '%')} of nominal" if scaling == "relative" else quantity(worst, "")
    names = [words(parameter["name"]) for parameter in judged(record)]
    what = names[0] if len(names) == 1 else "the worst-determined combination of the parameters"
    told = f"{what} has a standard deviation of {size}"
    if scaling != "relative":
        told += f", {scaling_text(scaling)}"
    return [told, *_by_criterion(record, entry)]


def _by_criterion(record: Record, entry: Entry) -> list[str]:
    objective = objective_of(entry)
    if objective is None or not math.isfinite(objective):
        return []
    told = record.study.criterion.deviation(objective, len(judged(record)))
    return [told] if told else []

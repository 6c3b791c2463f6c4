"""What the criteria's numbers mean to a reader: efficiencies, and what each drive was searched for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from oed.foundation.text import listing, words
from oed.kernel.criteria import CRITERIA, Criterion, E
from oed.kernel.measurement.information import scaling_text
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.records.stored.study_record import StoredParameter
from oed.report.parts.prose import Prose
from oed.report.parts.reading import regression_of, solver_of

SAY = Prose("judging")


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
        return 100.0 * self.criterion.change(value, best, self.size)

    @property
    def number(self) -> str:
        """What its objectives are: `D (log det F)`."""
        short = self.criterion.number
        return f"{self.label} ({short})" if short else self.label

    @property
    def named(self) -> str:
        """`the criterion D`."""
        return f"the criterion {self.label}"

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


def aim_of(record: Record, result: Result) -> Aim:
    """What a search searched for: the study's criterion unless it was given its own, or left drift out."""
    aim = _by_criterion(record, result)
    if not getattr(solver_of(record, result), "without_drift", False):
        return aim
    return replace(aim, label=f"{aim.label} without drift")


def _by_criterion(record: Record, result: Result) -> Aim:
    own, kind = study_aim(record), result.criterion
    if kind is None:
        return own
    study = own.criterion
    given = getattr(solver_of(record, result), "criterion", None) or plain_aim(record, kind).criterion
    subset, notes = given.subset, [words(kind)]
    if subset != study.subset:
        notes.append(f"of {listing([words(name) for name in subset]) if subset else 'all parameters'}")
    if given.scaling != study.scaling and given.conceded != "determinant":  # whose optimum no scaling changes
        notes.append(f"with the parameters {scaling_text(given.scaling)}")
    if kind == study.kind and any(
        getattr(given, key, None) != getattr(study, key, None) for key in ("test_drive", "task")
    ):
        notes.append("of another test drive")
    return Aim(given, " ".join(notes), len(subset or record.parameters))


def by_aim(record: Record, searches: Sequence[Result]) -> list[tuple[Aim, list[Result]]]:
    """Searches by what they searched for, in their order: only within a group do objectives compare."""
    groups: dict[str, tuple[Aim, list[Result]]] = {}
    for one in searches:
        aim = aim_of(record, one)
        groups.setdefault(aim.label, (aim, []))[1].append(one)
    return list(groups.values())


def judged(record: Record) -> list[StoredParameter]:
    """The parameters that the study's criterion judges."""
    return [one for one in record.parameters if one.judged]


def repeatable(record: Record) -> bool:
    """Whether k drives have k times the information of one: not by every criterion, never with a prior."""
    aim = study_aim(record)
    shares = (aim.efficiency(value, value) for value in (1.0, -1.0))
    return record.study.prior is None and any(share is not None for share in shares)


def repetitions_of(record: Record, result: Result) -> float | None:
    """How many drives of a result are worth one best drive, by the study's criterion.

    Information adds up over repetitions, so this is the inverse of an efficiency; None where that is not so.
    """
    best, objective = record.best, result.worth
    if best is None or best.objective is None or objective is None or not repeatable(record):
        return None
    # An objective within rounding of 0 is one: no number of repetitions makes identifiable what is not.
    if result.useless:
        return math.inf
    share = study_aim(record).efficiency(objective, best.objective)
    return None if share is None else 1.0 / share if share > 0 else math.inf


def identifies(result: Result, parameter: StoredParameter) -> bool:
    """Whether a drive identifies a parameter: with a standard error below its size, where it has one."""
    error = result.standard_deviations.get(parameter.name)
    return error is not None and not 0 < abs(parameter.nominal) < error


def meaning(record: Record) -> str:
    """The study's criterion: its name, and in other than the founding paper's case, what it is."""
    criterion = record.study.criterion
    if isinstance(criterion, E) and criterion.scaling == "none" and regression_of(record) is not None:
        return criterion.kind
    return f"{words(criterion.kind)}, {criterion.meaning}"


def precision(record: Record, result: Result) -> list[str]:
    """What a result's numbers say of its precision, in words: its worst direction, and its criterion's."""
    said = [SAY("worst", record.study.criterion, result, [one.name for one in judged(record)])]
    objective = None if result.useless else result.worth
    if objective is not None and math.isfinite(objective):
        said.append(record.study.criterion.deviation(objective, len(judged(record))))
    return list(filter(None, said))

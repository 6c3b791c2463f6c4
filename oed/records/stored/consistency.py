"""What has to fit together between a record and its own study."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from oed.foundation.errors import FileIssue, RecordError
from oed.kernel.criteria import CRITERIA
from oed.kernel.measurement.prior import Prior
from oed.records.stored.result import Result
from oed.records.stored.study_record import Record

KINDS = tuple(str(criterion.model_fields["kind"].default) for criterion in CRITERIA)
LARGEST_LOGARITHM = 300.0
"""Of a determinant, per parameter."""


def require_one_study(found: Record, path: Path) -> None:
    """Refuse a record whose numbers cannot be its study's.

    Raises:
        RecordError: names the file and the keys.
    """
    issues = [*_unknown(found), *_strangers(found)] or [*_impossible(found)]
    if issues:
        raise RecordError([FileIssue(str(path), 0, 0, key, message) for key, message in issues])


def _unknown(found: Record) -> Iterator[tuple[str, str]]:
    # Names of parameters that the record says nothing of.
    known = [one.name for one in found.parameters]
    prior = found.study.prior
    for name in prior.names if isinstance(prior, Prior) else ():
        if name not in known:
            yield "parameters", f"expected {name}, of which the study's prior speaks"
    if not any(one.judged for one in found.parameters):
        yield "parameters", "expected one that the criterion judges"


def _strangers(found: Record) -> Iterator[tuple[str, str]]:
    # Criteria that neither this package has nor the study names.
    given = (found.study.criterion, *(solver.criterion for solver in found.study.solvers))
    known = tuple(dict.fromkeys((*KINDS, *(one.kind for one in given if one is not None))))
    for place, one in enumerate(found.results):
        kinds = {"criterion": [one.criterion or KINDS[0]], "criteria": list(one.criteria)}
        for key, names in kinds.items():
            for name in names:
                if name not in known:
                    yield f"results.{place}.{key}", f"expected one of {', '.join(known)}, got {name!r}"


def _impossible(found: Record) -> Iterator[tuple[str, str]]:
    # Objectives that no drive has by the criterion that they are of.
    own, size = found.study.criterion.kind, len(found.parameters)
    for place, one in enumerate(found.results):
        for key, kind, value in _values(one, own):
            if value is not None and not possible(kind, value, size):
                yield f"results.{place}.{key}", f"expected a value of the criterion {kind}, got {value:g}"


def _values(one: Result, own: str) -> Iterator[tuple[str, str, float | None]]:
    # Everything of a result that is a criterion's value: key, criterion, value.
    kind = one.criterion or own
    yield "objective", own, one.objective
    yield from ((f"criteria.{name}", name, value) for name, value in one.criteria.items())
    yield from ((f"stages.{name}", kind, value) for name, value in one.stages.items())
    yield from ((f"starts.{place}.objective", kind, step.objective) for place, step in enumerate(one.starts))
    yield from ((f"levels.{place}.objective", kind, step.objective) for place, step in enumerate(one.levels))
    yield from (
        (f"history.{place}.objective", kind, step.objective) for place, step in enumerate(one.history)
    )


def possible(kind: str, value: float, size: int) -> bool:
    """Whether a criterion of `size` parameters can have a value: variances are negative, logarithms small.

    Args:
        kind: of the criterion.
        value: of it.
        size: parameters judged.
    """
    if kind == "D":
        return abs(value) <= LARGEST_LOGARITHM * size
    return value <= 0 or kind not in ("A", "G", "I", "modified_E")

"""What has to fit together between a record and its own study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from oed.foundation.errors import RecordError
from oed.kernel.criteria import CRITERIA
from oed.records.stored.door import flaws_of

KINDS = tuple(str(criterion.model_fields["kind"].default) for criterion in CRITERIA)
LARGEST_LOGARITHM = 300.0
"""Of a determinant, per parameter."""
Data = Mapping[str, Any]


def require_one_study(data: Data, path: Path) -> None:
    """Refuse a record whose numbers cannot be its study's.

    Raises:
        RecordError: names the file and the keys.
    """
    flaws = flaws_of(path, [*_unknown(data), *_strangers(data)]) or flaws_of(path, _impossible(data))
    if flaws:
        raise RecordError(flaws)


def _unknown(data: Data) -> Iterator[tuple[str, str]]:
    # Names of parameters that the record says nothing of.
    known = [one["name"] for one in data["parameters"]]
    prior = data["study"].get("prior") or {}
    for name in (*prior.get("parameters", ()), *prior.get("standard_deviations", {})):
        if name not in known:
            yield "parameters", f"expected {name}, of which the study's prior speaks"
    if not any(one["judged"] for one in data["parameters"]):
        yield "parameters", "expected one that the criterion judges"


def _strangers(data: Data) -> Iterator[tuple[str, str]]:
    # Criteria that neither this package has nor the study names.
    study = data["study"]
    given = (study["criterion"], *(solver.get("criterion") for solver in study["solvers"]))
    known = tuple(dict.fromkeys((*KINDS, *(_kind(one) for one in given if one))))
    for place, one in enumerate(data["results"]):
        kinds = {"criterion": [one["criterion"] or KINDS[0]], "criteria": one["criteria"]}
        for key, names in kinds.items():
            for name in names:
                if name not in known:
                    yield f"results.{place}.{key}", f"expected one of {', '.join(known)}, got {name!r}"


def _kind(criterion: Data) -> str:
    # One of the user's own has the name that it gave itself.
    return str((criterion.get("described") or {}).get("kind") or criterion["kind"])


def _impossible(data: Data) -> Iterator[tuple[str, str]]:
    # Objectives that no drive has by the criterion that they are of.
    own, size = _kind(data["study"]["criterion"]), len(data["parameters"])
    for place, one in enumerate(data["results"]):
        for key, kind, value in _values(one, own):
            if value is not None and not possible(kind, value, size):
                yield f"results.{place}.{key}", f"expected a value of the criterion {kind}, got {value:g}"


def _values(one: Data, own: str) -> Iterator[tuple[str, str, float | None]]:
    # Everything of a result that is a criterion's value: key, criterion, value.
    kind = one["criterion"] or own
    yield "objective", own, one["objective"]
    yield from ((f"criteria.{name}", name, value) for name, value in one["criteria"].items())
    yield from ((f"stages.{name}", kind, value) for name, value in one["stages"].items())
    for key in ("starts", "history"):
        for number, step in enumerate(one[key]):
            yield f"{key}.{number}.objective", kind, step["objective"]


def possible(kind: str, value: float, size: int) -> bool:
    """Whether a criterion of `size` parameters can have a value: variances are negative, logarithms small."""
    if kind == "D":
        return abs(value) <= LARGEST_LOGARITHM * size
    return value <= 0 or kind not in ("A", "G", "I", "modified_E")

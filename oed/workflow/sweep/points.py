"""The points of a sweep: every combination of values as a study of its own, all checked before any is run."""

from __future__ import annotations

import copy
import hashlib
import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from oed.foundation.errors import FileError, FileIssue, ProblemError, StudyError, UserMistake
from oed.simulation.trial import require_ready
from oed.study.study import Study
from oed.study.yaml_source import YamlSource, read_yaml
from oed.workflow.studies import own_paths, parse_study
from oed.workflow.sweep.axes import Axis

LONG = 80
"""Bytes of a folder's name beyond which it is cut."""


@dataclass(frozen=True)
class Point:
    """One combination.

    Attributes:
        texts: the value of each key, as it is read.
        numbers: the same in the unit of its axis; None where it is no number.
        label: all of them for a reader, "wheel_speed 5 rad/s, starts 2".
        folder: name of the folder of its record.
        study: with these values.
    """

    texts: Mapping[str, str]
    numbers: Mapping[str, float | None]
    label: str
    folder: str
    study: Study


def grid(file: str, axes: Sequence[Axis]) -> list[Point]:
    """The points of a sweep of the study in `file`, the last axis changing fastest.

    Raises:
        UserMistake: a key given twice, or one that is not in a study.
        StudyError: every mistake of every combination, each with a combination it is of.
    """
    keys = [axis.key for axis in axes]
    twice = [key for index, key in enumerate(keys) if key in keys[:index]]
    if twice:
        raise UserMistake(f"{twice[0]} is swept twice: give all its values in one --over")
    source = read_yaml(file)
    points: list[Point] = []
    issues: list[tuple[str, FileIssue]] = []
    combinations = list(itertools.product(*(range(len(axis.texts)) for axis in axes)))
    for chosen in combinations:
        label = _label(axes, chosen)
        try:
            study = _study(source, axes, chosen, label)
            _require_runnable(study)
            points.append(_point(axes, chosen, label, study))
        except (FileError, ProblemError) as error:
            issues += [(label, issue) for issue in _issues(error, source)]
    if issues:
        given = [axis.key for axis in axes if not axis.studies]
        raise StudyError(_together(issues, len(combinations), source, given))
    return points


def _label(axes: Sequence[Axis], chosen: Sequence[int]) -> str:
    names = short_names([axis.key for axis in axes])
    return ", ".join(
        f"{name} {axis.texts[index]}" for name, axis, index in zip(names, axes, chosen, strict=True)
    )


def short_names(keys: Sequence[str]) -> list[str]:
    """The last parts of keys that are names, but of kinds; the whole keys where those are the same."""
    lasts = [_last(key) for key in keys]
    return lasts if len(set(lasts)) == len(lasts) else list(keys)


def _last(key: str) -> str:
    # `criterion` says more than `kind`, `points.2` more than `2`, and `position_noise` more than `position`.
    parts = key.removesuffix(".kind").split(".")
    if parts[-2:-1] == ["noise"]:
        return f"{parts[-1]}_noise"
    return key if parts[-1].isdecimal() else parts[-1]


def _study(source: YamlSource, axes: Sequence[Axis], chosen: Sequence[int], label: str) -> Study:
    data = copy.deepcopy(source.data)
    for axis, index in zip(axes, chosen, strict=True):
        if axis.studies:
            data.update(axis.studies[index])
        else:
            _put(data, axis, axis.values[index])
    if isinstance(data, dict) and isinstance(data.get("name"), str) and "name" not in (a.key for a in axes):
        data["name"] = f"{data['name']} ({label})"
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)
    return parse_study(text, source.file)


def _put(data: Any, axis: Axis, value: Any) -> None:
    *parents, last = axis.path
    for part in parents:
        if isinstance(data, dict) and data.get(str(part)) is None:
            data[str(part)] = {}
        data = _inside(data, part, axis)
    _inside(data, last, axis, put=True)
    if isinstance(data, dict):
        data[str(last)] = value
    else:
        data[last] = value


def _inside(data: Any, part: str | int, axis: Axis, put: bool = False) -> Any:
    if isinstance(data, dict):
        return None if put else data[str(part)]
    if isinstance(data, list):
        if isinstance(part, int) and part < len(data):
            return data[part]
        text = f"expected an index from 0 to {len(data) - 1} of the list there, got {part!r}"
        raise UserMistake(f"--over {axis.key}: {text}")
    raise UserMistake(
        f"--over {axis.key}: there is nothing to put {part!r} into, the study has {data!r} there"
    )


def _require_runnable(study: Study) -> None:
    # What a run would find out only when it comes to it.
    study.require_designed()
    study.require_identifiable()
    own_paths(study)
    if study.physics is not None:
        require_ready(study.problem, study.physics)


def _point(axes: Sequence[Axis], chosen: Sequence[int], label: str, study: Study) -> Point:
    pairs = list(zip(axes, chosen, strict=True))
    return Point(
        {axis.key: axis.texts[index] for axis, index in pairs},
        {axis.key: None if axis.numbers is None else axis.numbers[index] for axis, index in pairs},
        label,
        _folder(label),
        study,
    )


def _folder(label: str) -> str:
    # The values make the name, so that a sweep with more of them finds its earlier points again.
    name = re.sub(r"[^\w.+-]+", "_", label).strip("_.")
    digest = hashlib.sha256(label.encode()).hexdigest()[:8]
    short = name.encode()[:LONG].decode(errors="ignore")
    plain = re.fullmatch(r"[\w.+\- ,/]+", label) and short == name
    return name if plain else f"{short}_{digest}"


def _issues(error: FileError | ProblemError, source: YamlSource) -> Iterable[FileIssue]:
    if isinstance(error, FileError):
        return error.issues
    return [source.issue(issue.key, issue.message) for issue in error.issues]


def _together(
    issues: Sequence[tuple[str, FileIssue]], count: int, source: YamlSource, given: Sequence[str]
) -> list[FileIssue]:
    # Lines are those of the file, not of the combination's own text; what is wrong with all is said once.
    # Of keys `given` by the option the file is not to blame, where it has none, or another value.
    labels: dict[tuple[str, str, str], list[str]] = {}
    for label, issue in issues:
        labels.setdefault((issue.file, issue.key, issue.message), []).append(label)
    found = []
    for (file, key, message), of in labels.items():
        line, column = 0, 0
        if file == source.file:
            path = [int(part) if part.isdecimal() else part for part in key.split(".")]
            known, line, column = source.place(path)
            swept = any(f"{key}.".startswith(f"{one}.") for one in given)
            if swept and (len(known) < len(path) or len(of) == count):
                file, line, column = "--over", 0, 0
        more = f" and {len(of) - 1} more" if len(of) > 1 else ""
        prefix = "" if len(of) == count else f"with {of[0]}{more}: "
        found.append(FileIssue(file, line, column, key, f"{prefix}{message}"))
    return found

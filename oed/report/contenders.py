"""Several designs side by side: which is the most precise, in words, as dots and in a table; their paths."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from oed.foundation.text import Unit, error_text, own_unit, significant, unit_text, words
from oed.foundation.vocabulary import Vocabulary
from oed.records.record import Record
from oed.records.stored.study_record import StoredParameter
from oed.report.figures import paths as path_figures
from oed.report.figures.driven import path_of, room_of
from oed.report.figures.ranking import Scale, ranking
from oed.report.parts.prose import Prose
from oed.report.parts.section import Column, Link, Picture, Section

SAY = Prose("contenders")
EQUAL = 0.05
"""Share by which standard errors may differ and count as equal."""
MOST_DOTS, MOST_SCALES = 16, 4
"""Designs, and parameters, that are drawn side by side."""
RUNS = ("run", "runs")
"""Words that mean parts of a design elsewhere."""
PATHS = 12
"""Paths that are drawn."""


@dataclass(frozen=True)
class Contender:
    """The best design of a record, among others.

    Attributes:
        name: by which it is told from the others.
        record: that has it.
        page: address of its report; "" where none is written.
    """

    name: str
    record: Record
    page: str = ""

    @property
    def link(self) -> Link | str:
        """Its name, which leads to its report where there is one."""
        return Link(self.name, self.page) if self.page else self.name

    @cached_property
    def shares(self) -> dict[str, float | None]:
        """Standard errors as shares of the nominal values [%]; {} without any."""
        return relative_deviations(self.record)

    @property
    def worst(self) -> tuple[float, str]:
        """The largest of these shares [%], and whose it is; infinite where one is not identifiable."""
        return max(
            ((size, name) for name, size in self.shares.items() if size is not None), default=(0.0, "")
        )

    def error(self, parameter: StoredParameter) -> float | None:
        """Standard error of a parameter [SI]; infinite where it is not identifiable, None without any."""
        best = self.record.best
        known = {} if best is None else best.standard_deviations
        size = known.get(parameter.name, -1.0)
        return math.inf if size is None else None if size < 0 else size


def relative_deviations(record: Record) -> dict[str, float | None]:
    """Predicted standard errors of the best drive, shares of the nominal values [%]; {} without any."""
    best = record.best
    known = {} if best is None else best.standard_deviations
    nominal = {one.name: one.nominal for one in record.parameters}
    return {name: _share(deviation, nominal[name]) for name, deviation in known.items()}


def _share(deviation: float | None, nominal: float) -> float | None:
    # A parameter that is not identifiable has an infinite deviation, one that is nominally 0 no share.
    if deviation is None:
        return math.inf
    return 100.0 * deviation / abs(nominal) if nominal else None


def parameters_of(some: Iterable[Contender]) -> list[StoredParameter]:
    """Every parameter that one of them has a standard error of, by name."""
    found = {one.name: one for each in some for one in each.record.parameters if each.error(one) is not None}
    return list(found.values())


def finding(some: Sequence[Contender], leader: Contender | None = None) -> tuple[str, str]:
    """Which is the most precise, as a title, and by how much, as a sentence.

    That is the one whose largest relative standard error is the smallest, or the `leader` that is known to be
    best; where they do not estimate the same parameters, or nothing is predicted, no one is named.
    """
    known = [one for one in some if one.worst[1]]
    if not _comparable(known) or len(some) < 2:
        return SAY("undecided", len(some)), SAY("different") if len(known) > 1 else ""
    order = sorted(known, key=lambda one: one.worst[0])
    first = order[0] if leader is None or leader not in known else leader
    rest = [one for one in order if one is not first]
    if not rest or math.isinf(first.worst[0]):
        return SAY("single", first.name), SAY("own", _worst(first))
    if order[-1].worst[0] <= (1 + EQUAL) * order[0].worst[0]:
        return SAY("equal", len(known)), SAY("all", _worst(order[0]), EQUAL)
    if first is not order[0]:
        return SAY("best", first.name), SAY("by_criterion", _worst(first), _worst(order[0]))
    next_best, last = _worst(rest[0]), _worst(rest[-1])
    said = SAY("ahead", _worst(first), next_best, last if last[1:] != next_best[1:] else None)
    return SAY("single", first.name), said


def _comparable(known: Sequence[Contender]) -> bool:
    # Whether one of them can be the most precise: all are about the same parameters.
    return len({frozenset(one.shares) for one in known}) == 1


def _worst(one: Contender) -> tuple[str, str, str]:
    size, parameter = one.worst
    text = SAY("open") if math.isinf(size) else f"{significant(2)(size)} %"
    return one.name, words(parameter), text


def error_columns(some: Sequence[Contender], of: Callable[[Any], Contender]) -> Iterator[Column]:
    """A column for each parameter's standard error, in the parameter's unit.

    Args:
        some: designs that the table is about.
        of: the contender that a row's item is about.
    """
    return (_error_column(one, some, of) for one in parameters_of(some))


def shared_unit(parameter: StoredParameter, some: Iterable[Contender]) -> Unit:
    """The unit, and its factor from SI, in which a parameter of several designs is shown."""
    units = (one.record.study.shown_units.get(parameter.name) for one in some)
    return next(filter(None, units), own_unit(parameter.unit))


def _error_column(
    parameter: StoredParameter, some: Sequence[Contender], of: Callable[[Any], Contender]
) -> Column:
    unit, factor = shared_unit(parameter, some)

    def error(item: object) -> float | None:
        size = of(item).error(parameter)
        return None if size is None else size * factor

    return Column(words(parameter.name), unit_text(unit), _written, error)


def _written(size: float) -> str:
    return SAY("open") if math.isinf(size) else error_text(size)


def dots(some: Sequence[Contender], first: Contender | None = None) -> Picture | None:
    """A dot for each standard error, the most precise design on top; None where nothing is predicted."""
    every = parameters_of(some)
    parameters = every[:MOST_SCALES]
    shown = sorted((one for one in some if one.worst[1]), key=lambda one: (one is not first, one.worst))
    if not parameters or len(shown) < 2:
        return None
    shown, named = shown[:MOST_DOTS], _comparable(shown)
    scales = [_scale(one, shown) for one in parameters]
    figure = ranking([one.name for one in shown], [named and one is shown[0] for one in shown], scales)
    prior = any(one.record.study.prior is not None for one in shown)
    numbers = (len(shown), len(some), len(parameters), len(every))
    return Picture("precision", SAY("alt"), SAY("caption", named, prior, *numbers), figure)


def _scale(parameter: StoredParameter, shown: Sequence[Contender]) -> Scale:
    unit, factor = shared_unit(parameter, shown)
    sizes = [one.error(parameter) for one in shown]
    values = tuple(None if size is None or math.isinf(size) else factor * size for size in sizes)
    texts = tuple("" if size is None else _written(size * factor) for size in sizes)
    return Scale("standard error", unit, values, texts, words(parameter.name))


def vocabulary_of(some: Sequence[Contender]) -> Vocabulary:
    """The words in which several designs are compared: of their domain, where they have one in common."""
    own = [one.record.study.vocabulary for one in some]
    kept = tuple(dict.fromkeys(name for one in own for name in one.kept))
    if not own or any(one.words != own[0].words for one in own):
        return Vocabulary()
    # What are compared here are runs of studies.
    return Vocabulary({word: said for word, said in own[0].words.items() if word not in RUNS}, kept)


def of_robots(some: Iterable[Contender]) -> bool:
    """Whether any of the designs is of a robot."""
    return any(one.record.study.domain == "robots" for one in some)


def best_paths(some: Sequence[Contender]) -> Section | None:
    """The paths of the designs, those in one room in one figure and on its scale; None without any."""
    robots = (one for one in some if one.record.study.domain == "robots")
    best = [one for one in robots if one.record.best is not None]
    rooms: dict[str, tuple[Any, list[Any]]] = {}
    for one in best[:PATHS]:
        room, result = room_of(one.record), one.record.best
        if result is not None:
            path = replace(path_of(one.record, result), title=one.name.replace(", ", "\n"))
            rooms.setdefault(repr(room), (room, []))[1].append(path)
    pictures = [
        Picture(
            f"paths_{number}",
            SAY("room", len(paths)),
            SAY("paths", len(paths)),
            path_figures.paths(paths, room),
        )
        for number, (room, paths) in enumerate(rooms.values(), start=1)
    ]
    return Section.of("What they drive", SAY("drawn", PATHS, len(best)), *pictures) if best else None

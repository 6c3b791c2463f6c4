"""The keys that studies of every domain have, and what a domain's own keys have to give."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field

from oed.foundation.component import Component, OneOf, Seed
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.own.part import OwnPart
from oed.foundation.text import Unit
from oed.foundation.vocabulary import Vocabulary
from oed.kernel.criteria import CRITERION_CHOICES, Criterion, E
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.limit import Limit
from oed.kernel.measurement.measurement import Measurement
from oed.kernel.measurement.prior import Prior
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.problem import Problem
from oed.kernel.selection import Selection
from oed.optimize import SOLVERS, Ipopt, Solver
from oed.robots.own_parts import components, measurement_issues
from oed.study.parts import AnyBaseline, AnySystemPrior, ValidationOptions
from oed.uncertainty.robust import Robust
from oed.uncertainty.uncertainty import Uncertainty

LEADING = ("format", "name", "robot", "system", "trajectory", "experiment")
"""Keys that come first where a study is written."""


class StudyFile(Component, ABC):
    """The keys of a study file."""

    domain: ClassVar[str]
    """What it is about; pages have its words."""
    format: Literal[1]
    name: Annotated[str, Field(min_length=1)]
    measurement: Measurement | Sensor
    estimate: tuple[str, ...] | None = None
    prior: AnySystemPrior | None = None
    uncertainty: Uncertainty | None = None
    robust: Robust | None = None
    criterion: Annotated[Criterion, OneOf(CRITERION_CHOICES)] = E()
    solvers: tuple[Annotated[Solver, OneOf(SOLVERS)], ...] = (Ipopt(),)
    baselines: tuple[AnyBaseline, ...] = ()
    bound: bool = False
    weights: Selection | None = None
    validation: ValidationOptions | None = None
    seed: Seed = 0

    def __repr__(self) -> str:
        """Its name, its system and the keys that were given."""
        return f"StudyFile({self.name!r}, {self.called}; keys: {', '.join(sorted(self.model_fields_set))})"

    __str__ = __repr__

    @property
    def vocabulary(self) -> Vocabulary:
        """The words in which pages and terminals speak of it: those of robots by default."""
        return Vocabulary()

    @property
    def shown_units(self) -> Mapping[str, Unit]:
        """Units, and their factors from SI, in which the study gives its quantities, by their names."""
        return {}

    @property
    def limit_units(self) -> Mapping[str, Unit]:
        """Alike those in which it gives its limits, by the limits' names."""
        return {}

    @property
    def known_starts(self) -> frozenset[str]:
        """States that begin at values which are known exactly, as far as the study says so by their names."""
        return frozenset()

    @classmethod
    def completed(cls, data: Mapping[str, Any]) -> dict[str, Any]:
        """A study's keys with what stands for further ones filled in; as they are by default.

        Raises:
            ProblemError: one that stands for nothing.
        """
        return dict(data)

    @property
    @abstractmethod
    def model(self) -> System:
        """What responds."""

    @property
    @abstractmethod
    def called(self) -> str:
        """What its system is called."""

    @property
    @abstractmethod
    def space(self) -> Space:
        """What may be chosen; anything where nothing is designed."""

    @property
    @abstractmethod
    def every_limit(self) -> tuple[Limit, ...]:
        """What a design must keep to."""

    @property
    def designs(self) -> bool:
        """Whether anything is designed."""
        return True

    @abstractmethod
    def issues(self) -> list[Issue]:
        """Why its keys do not go together; [] where they do."""

    @abstractmethod
    def problem_issues(self, problem: Problem) -> list[Issue]:
        """What of its keys the problem made of them has no place for.

        Raises:
            ProblemError: the same, of parts that are tried.
        """

    def problem(self) -> Problem:
        """What to design for.

        Raises:
            ProblemError: the parts do not fit together; every reason is listed.
        """
        issues = measurement_issues(self)
        if issues:
            raise ProblemError(issues)
        return self.problem_of(self.space)

    def problem_of(self, space: Space) -> Problem:
        """The problem with another space than the study's.

        Raises:
            ProblemError: the parts do not fit together; every reason is listed.
        """
        assert self.prior is None or isinstance(self.prior, Prior)
        return Problem(
            model=self.model,
            design=space,
            measurement=self.measurement,
            limits=self.every_limit,
            criterion=self.criterion,
            name=self.name,
            estimate=self.estimate,
            prior=self.prior,
            uncertainty=self.uncertainty,
            robust=self.robust,
            selection=self.weights,
            designed=self.designs,
        )

    def echo(self) -> dict[str, Any]:
        """The study as plain data, defaults filled in, SI numbers; itself a valid study."""
        plain: dict[str, Any] = self.model_dump(mode="json", exclude_none=True)
        first = [name for name in LEADING if name in plain]
        return {name: plain[name] for name in (*first, *(one for one in plain if one not in first))}

    def in_numbers(self, folder: Path) -> Self:
        """The study with numbers where it names other files, but records, or what they follow from.

        Args:
            folder: from which files are found.

        Raises:
            ProblemError: files that cannot be read, or from which no numbers follow.
        """
        return self

    def named_code(self) -> Iterator[tuple[str, OwnPart]]:
        """Every part of somebody's own that a study read as data names, with its key."""
        for key, part in components(self, ("study",)):
            if isinstance(part, OwnPart):
                yield ".".join(map(str, key)), part

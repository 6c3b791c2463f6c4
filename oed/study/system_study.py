"""The keys of a study of any system: its equations, what may be chosen, and what is read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from operator import is_
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import BeforeValidator, PrivateAttr

from oed.equations.candidates import Candidates
from oed.equations.continuous import PythonSystem
from oed.equations.dimensions import unit_of
from oed.equations.experiment import Experiment
from oed.equations.expression_limits import LIMITS as EXPRESSION_LIMITS
from oed.equations.expression_limits import Always, ExpressionLimit
from oed.equations.keys import EquationKeys
from oed.equations.limits import input_dimensions
from oed.equations.output_system import OutputSystem, SystemKeys
from oed.equations.outputs import SENSORS, OutputSensor, SeveralOutputs, replaced_starts
from oed.foundation.component import OneOf
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.text import Unit, listing, words
from oed.foundation.vocabulary import Vocabulary
from oed.kernel.dynamics.held import HeldSpace
from oed.kernel.dynamics.space import Space
from oed.kernel.limit import Limit
from oed.kernel.measurement.measurement import Measurement, sensors_of
from oed.kernel.measurement.prior import Prior
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.problem import Problem
from oed.kernel.scorer import score
from oed.robots.own_parts import PythonSensor
from oed.study.cross_checks import file_issues
from oed.study.parts import AnySystemPrior, PathFile, PriorReadings
from oed.study.robot_study import sensor_list
from oed.study.study_file import StudyFile
from oed.uncertainty.uncertainty import spread_of

MEASUREMENTS: tuple[type[Measurement | Sensor], ...] = (*SENSORS, SeveralOutputs, PythonSensor)
"""What a study's `measurement` may be."""
WORDS = {
    "a drive": "an experiment",
    "drive": "experiment",
    "drives": "experiments",
    "driven": "carried out",
    "a robot": "a system",
    "robot": "system",
    "robots": "systems",
    "run": "trial",
    "runs": "trials",
    "path": "course",
    "paths": "courses",
    "satisfied with room": "satisfied with a margin",
}
"""What systems are spoken of with, by the words of robots."""


class SystemStudyFile(StudyFile):
    """The keys of a study file of any system."""

    domain: ClassVar[str] = "systems"
    system: Annotated[SystemKeys, OneOf((EquationKeys, PythonSystem))]
    experiment: Experiment
    measurement: Annotated[Sensor | Measurement, OneOf(MEASUREMENTS), BeforeValidator(sensor_list)]
    limits: tuple[Annotated[ExpressionLimit, OneOf(EXPRESSION_LIMITS)], ...] = ()
    prior: AnySystemPrior | None = None
    baselines: tuple[PathFile, ...] = ()
    _space: tuple[tuple[Experiment, SystemKeys], Space] | None = PrivateAttr(None)

    @property
    def model(self) -> OutputSystem:
        """The system.

        Raises:
            ProblemError: equations that are none, by key and column.
        """
        return self.system.system

    @property
    def called(self) -> str:
        """By its kind."""
        return self.system.kind

    @property
    def space(self) -> Space:
        """What may be chosen; of a system of code that was not run its times alone."""
        if isinstance(self.system, PythonSystem):
            return self.experiment.times
        # Copies of a study share what was made of the same keys: a table of candidates takes long to read.
        made_of = self.experiment, self.system
        if self._space is None or not all(map(is_, self._space[0], made_of)):
            self._space = made_of, self.experiment.space(self.model, self.system.initial_values)
        return self._space[1]

    def in_numbers(self, folder: Path) -> Self:
        """The study with candidates where a file has them, and what earlier readings say as a covariance."""
        found = self
        if self.experiment.candidates is not None:
            read = self.experiment.candidates.read(folder, self.model.input_names)
            experiment = self.experiment.model_copy(update={"candidates": read})
            found = found.model_copy(update={"experiment": experiment})
        if isinstance(self.prior, PriorReadings):
            found = found.model_copy(update={"prior": self._read_before(self.prior)})
        return found

    def _read_before(self, given: PriorReadings) -> Prior:
        # By the study's own measurement, as if these readings were the experiment.
        model = self.model
        if model.states:
            text = "are settings of a system without states: give a record, or a covariance"
            raise ProblemError.about(("prior", "readings"), text)
        try:
            settings = Candidates(rows=given.readings).table(input_dimensions(model))
        except ProblemError as error:
            issues = [Issue(("prior", "readings", *issue.key[3:]), issue.message) for issue in error.issues]
            raise ProblemError(issues) from None
        alone = HeldSpace.of(settings, np.zeros((1, 0)), duration=float(len(settings)))
        earlier = self.model_copy(update={"prior": None, "weights": None, "robust": None})
        with earlier._own_keys():
            problem = earlier.problem_of(alone)
        assert alone.only is not None
        found = score(problem, alone.only)
        (covariance,), (names,) = found.covariances.values(), found.parameters.values()
        if not np.all(np.isfinite(covariance)):
            text = f"these do not identify {', '.join(names)} by themselves: add some"
            raise ProblemError.about(("prior", "readings"), text)
        return Prior(parameters=names, covariance=tuple(map(tuple, covariance.tolist())))

    @property
    def vocabulary(self) -> Vocabulary:
        """Of experiments with systems; names that the study gives stay as they are."""
        if isinstance(self.system, PythonSystem):
            # Of code that was not run nothing is known.
            return Vocabulary(WORDS, (self.name,))
        model = self.model
        parameters = [one.name for one in model.parameters]
        names = [*model.states, *model.input_names, *parameters, *model.output_dimensions]
        return Vocabulary(WORDS, (self.name, *names, *map(words, names)))

    @property
    def shown_units(self) -> Mapping[str, Unit]:
        """Of parameters, initial values, inputs and outputs that are read, as they are written."""
        given: dict[str, object] = {}
        for one in sensors_of(self.measurement):
            given |= dict(one.noise) if isinstance(one, OutputSensor) else {}
        candidates = self.experiment.candidates
        given |= {} if candidates is None else candidates.largest
        given |= {name: one.range[1] for name, one in self.experiment.inputs.items()}
        given |= self.system.quantities
        return {name: unit_of(text) for name, text in given.items() if isinstance(text, str)}

    @property
    def limit_units(self) -> Mapping[str, Unit]:
        """Units in which the larger sides of the limits are written."""
        sides = {limit.name: limit.sides for limit in (*self.experiment.limits, *self.limits)}
        return {name: unit_of(larger) for name, (_, larger) in sides.items() if isinstance(larger, str)}

    @property
    def known_starts(self) -> frozenset[str]:
        """Those that are fixed or chosen; nothing is known of code that was not run."""
        initial_values = {} if isinstance(self.system, PythonSystem) else self.system.initial_values
        return frozenset(name for name, one in initial_values.items() if not one.unknown)

    @property
    def every_limit(self) -> tuple[Limit, ...]:
        """What inputs may do, then what expressions may be."""
        return (*self.experiment.limits, *self.limits)

    def issues(self) -> list[Issue]:
        """Why its keys do not go together; [] where they do."""
        return file_issues(self)

    def problem(self) -> Problem:
        """What to design for.

        Raises:
            ProblemError: the parts do not fit together; every reason is listed.
        """
        model = self.model
        issues = self.experiment.issues(model)
        if issues:
            raise ProblemError(issues)
        with self._own_keys():
            return super().problem()

    def problem_issues(self, problem: Problem) -> list[Issue]:
        """Limits that are to be tightened by states alone, and are of uncertain parameters as well."""
        spread = None if self.robust is None else spread_of(problem.uncertain_system)
        if self.robust is None or spread is None or self.robust.kind == "scenarios":
            return []
        issues = []
        for place, limit in enumerate(self.limits):
            if not isinstance(limit, Always):
                continue
            names = sorted(limit.depends_on(problem.model) & set(spread.names))
            text = f"depends on {listing(names)}, which may differ: take `robust: {{kind: scenarios}}`"
            issues += [Issue(("limits", place, "of"), text)] if names else []
        return issues

    def problem_of(self, space: Space) -> Problem:
        """The problem with another space than the study's, its sensors with what is known of starts.

        Raises:
            ProblemError: the parts do not fit together; every reason is listed.
        """
        initial_values = self.system.initial_values
        if not any(one.unknown for one in initial_values.values()):
            return super().problem_of(space)
        known = tuple((name, one.spread) for name, one in initial_values.items())
        informed = replaced_starts(self.measurement, known)
        return super(SystemStudyFile, self.model_copy(update={"measurement": informed})).problem_of(space)

    @contextmanager
    def _own_keys(self) -> Iterator[None]:
        # What is wrong with limits and spaces is said of the keys that they are given by.
        try:
            yield
        except ProblemError as error:
            issues = [Issue(self._own_key(issue.key), issue.message) for issue in error.issues]
            raise ProblemError(issues) from None

    def _own_key(self, key: tuple[str | int, ...]) -> tuple[str | int, ...]:
        if key[:2] == ("trajectory", "signals"):
            names = [self.model.input_names[one] for one in key[2:] if isinstance(one, int)]
            return ("experiment", "inputs", *(part for name in names for part in (name, "signal")))
        if key[:1] == ("trajectory",):
            return ("experiment", *key[1:])
        if key[:1] == ("limits",):
            return self._limit_key(str(key[1]) if len(key) > 1 else "", key[2:])
        return key

    def _limit_key(self, name: str, rest: tuple[str | int, ...]) -> tuple[str | int, ...]:
        for place, one in enumerate(self.limits):
            if one.name == name:
                return ("limits", place, *rest)
        found = [(name, "range"), (name.removeprefix("rate_of_"), "rate")]
        return next(
            (("experiment", "inputs", own, what) for own, what in found if own in self.experiment.inputs),
            ("experiment", "inputs"),
        )

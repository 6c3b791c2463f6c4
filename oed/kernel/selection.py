"""Which readings are taken, and how often: weights of readings within a budget."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from oed.foundation.component import Component
from oed.foundation.errors import Issue, UserMistake
from oed.foundation.quantities import parse_quantity
from oed.kernel.margin import Margin
from oed.kernel.measurement.measurement import process_noise_of
from oed.kernel.parts import Budget, Parts, budgets_of, laid_out

if TYPE_CHECKING:
    from oed.kernel.dynamics.trajectory import Trajectory
    from oed.kernel.problem import Problem


def _amount(value: Any) -> float:
    # Seconds of what is read all the time, or a number.
    return parse_quantity(value, "s" if isinstance(value, str) and not _plain(value) else "")


def _plain(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _amounts(value: Any) -> Any:
    return (
        {name: _amount(one) for name, one in value.items()} if isinstance(value, Mapping) else _amount(value)
    )


Totals = Annotated[float | dict[str, float], BeforeValidator(_amounts)]
Counts = int | dict[str, int]


class Selection(Component):
    """Weights of readings, from 0 to `most` each, within a budget.

    Attributes:
        total: of all weights, or by sensor; of what is read all the time how long it may be read [s].
        readings: instead, how many whole readings, or trials, are taken, in all or by sensor.
        most: weight of one; more than 1 where a reading, or a trial, may be repeated.
        of: what has a weight of its own: every reading, or every trial as a whole.
        pieces: into how many parts each trial's readings of a sensor are divided, each with one weight.
    """

    total: Totals | None = None
    readings: Annotated[Counts, Field(union_mode="left_to_right")] | None = None
    most: Annotated[float, Field(gt=0)] = 1.0
    of: Literal["readings", "trials"] = "readings"
    pieces: Annotated[int, Field(ge=1)] | None = None

    @model_validator(mode="after")
    def _one_budget(self) -> Selection:
        if (self.total is None) == (self.readings is None):
            raise ValueError("expected either total (of weights) or readings (how many whole ones)")
        if self.of == "trials" and self.pieces is not None:
            raise ValueError("pieces are parts of trials; with `of: trials` there are none")
        return self

    @property
    def whole(self) -> bool:
        """Whether whole readings are taken."""
        return self.readings is not None

    def parts(self, parts: Parts) -> Parts:
        """What has weights, of all readings' parts.

        Raises:
            UserMistake: pieces of unequal length.
        """
        if self.of == "trials":
            return parts.by_run()
        return parts if self.pieces is None else parts.divided(self.pieces)

    def budgets(self, parts: Parts) -> tuple[Budget, ...]:
        """The budgets of what has weights.

        Raises:
            UserMistake: totals that no weights have.
        """
        given = self.total if self.readings is None else self.readings
        assert given is not None
        totals = (
            {name: float(one) for name, one in given.items()} if isinstance(given, dict) else float(given)
        )
        return budgets_of(parts, totals, self.most)

    def laid_out(self, problem: Problem) -> Parts:
        """The readings of a problem's designs, before anything is known of what they say."""
        sensors, space = problem.measurement.joint_sensors, problem.design
        return laid_out(sensors, problem.system, space.samples, space.runs, space.period)

    def issues(self, problem: Problem) -> list[Issue]:
        """Why a problem's readings cannot be weighted so; [] if they can."""
        sensors = problem.measurement.joint_sensors
        if not sensors or any(one.joint_whitening is not None for one in sensors):
            text = "weights need sensors whose readings are independent of each other"
            return [Issue(("weights",), f"{text}; {problem.measurement.kind} are not")]
        noise = process_noise_of(sensors)
        if noise is not None:
            text = (
                "under drift what a reading says depends on the others, and weights would have to add it up"
            )
            text = "weights of trials do not go with drift" if self.of == "trials" else text
            return [Issue(("weights",), f"{text}: leave out `{noise.key}`, or `weights`")]
        if not problem.criterion.concave:
            text = f"need a concave criterion, which {problem.criterion.kind} is not: use E, D, A, G or I"
            return [Issue(("weights",), text)]
        if reason := self._cost_issue(problem):
            return [Issue(("weights",), reason)]
        if problem.robust is not None:
            return [Issue(("weights",), "cannot be chosen for several systems at once: leave out `robust`")]
        try:
            self._require_whole(self.budgets(self.parts(self.laid_out(problem))))
        except UserMistake as error:
            return [Issue(("weights",), str(error))]
        return []

    def _cost_issue(self, problem: Problem) -> str:
        # Why limits on all trials together are not known of these weights; "" where they are.
        counted = ", ".join(limit.name for limit in problem.limits if limit.counts_trials)
        if not counted:
            return ""
        if self.whole:
            return f"whole numbers are chosen without the budget of {counted}: give `total`, or leave one out"
        by_reading = self.of == "readings"
        if by_reading and problem.model.states and problem.design.only is not None:
            return f"the budget of {counted} is of trials, not of readings: give `of: trials`"
        if by_reading and not problem.model.states and len(problem.measurement.joint_sensors) > 1:
            return f"the budget of {counted} needs one weight for each setting: give one sensor all outputs"
        return ""

    def _require_whole(self, budgets: tuple[Budget, ...]) -> None:
        if self.whole and any(one.whole is None for one in budgets):
            raise UserMistake("whole readings are of one size and repeated whole times: change `most`")

    def margins(self, problem: Problem, trajectory: Trajectory) -> list[Margin]:
        """How much of the budget a trajectory leaves, and of the weights' bounds.

        Readings without weights are taken in full.
        """
        sensors, samples = problem.measurement.joint_sensors, trajectory.samples // trajectory.runs
        single = laid_out(sensors, problem.system, samples, trajectory.runs, trajectory.period)
        given = np.ones(len(single.readings)) if trajectory.weights is None else trajectory.weights
        parts = self.parts(single)
        weights = np.array([given[list(places)].mean() for places in parts.members])
        spare = [(one.total - one.spent(weights), one.total) for one in self.budgets(parts)]
        least, size = min(spare, key=lambda pair: pair[0] / pair[1])
        beyond = max(float(weights.max()) - self.most, -float(weights.min()))
        return [Margin("weights", least, size, ""), Margin("weight of a reading", -beyond, self.most, "")]

"""Words, cards and tables of problems, drives and their scores; `oed.foundation.views` finds them here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from oed.foundation.errors import UserMistake
from oed.foundation.presenting import (
    PARAMETER_COLUMNS,
    Card,
    Fact,
    Row,
    dataframe,
    given,
    number,
    parameter_rows,
)
from oed.foundation.text import Unit, count, given_text, quantity, significant, size_text, words
from oed.foundation.views import makes
from oed.kernel.dynamics.system import label_of
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.results import Evaluation, Margin, Steps
from oed.kernel.solution import Explored, Solution
from oed.kernel.statement import Statement


@makes("card", Statement)
def problem_card(problem: Statement) -> Card:
    """Return the card of a problem."""
    return Card(f"Problem {problem.name}".strip(), problem_facts(problem))


def problem_facts(problem: Statement) -> tuple[Fact, ...]:
    """Return the facts about a problem that readers are shown, by name."""
    space = problem.design
    names = dict.fromkeys(name for part in problem.any_estimations for name in part.parameters)
    runs = "" if space.runs == 1 else f"{space.runs} runs, "
    drive = f"{runs}{given_text(space.whole_duration, 's')}, {space.samples} samples"
    return given(
        (problem.model.noun, words(label_of(problem.model))),
        ("estimates", ", ".join(map(words, names))),
        ("drive", drive if problem.designed else ""),
        (
            "measured",
            problem.measurement.brief(space.samples) if problem.designed else problem.measurement.kind,
        ),
        ("limits", ", ".join(words(limit.name) for limit in problem.limits)),
        ("criterion", problem.criterion.kind),
        ("robust", "" if problem.robust is None else "yes"),
    )


@makes("card", Trajectory)
def trajectory_card(drive: Trajectory) -> Card:
    """Return the card of a trajectory."""
    runs = "" if drive.runs == 1 else f"{drive.runs} runs, "
    width, coefficients = drive.coefficients.shape[1], len(drive.coefficients)
    starts = "; ".join(", ".join(f"{value:.4g}" for value in start) for start in drive.starts[:3])
    facts = given(
        ("samples", f"{runs}{drive.samples} of {given_text(drive.period, 's')}"),
        ("inputs", f"{width}, splines of degree {drive.degree}, {coefficients} coefficients each"),
        ("start (SI)", starts + ("; ..." if drive.runs > 3 else "")),
    )
    return Card(f"Trajectory: {given_text(drive.duration, 's')}", facts)


@makes("table", Trajectory)
def trajectory_table(drive: Trajectory, names: Sequence[str]) -> Any:
    """Return a DataFrame with a row per period of a trajectory.

    Args:
        drive: the trajectory.
        names: names of the inputs; () for "input_1", ...

    Raises:
        ValueError: another number of names.
        UserMistake: pandas is not installed.
    """
    width = drive.coefficients.shape[1]
    columns = tuple(names) or tuple(f"input_{place + 1}" for place in range(width))
    if len(columns) != width:
        raise ValueError(f"names: expected {width}, one of each input, got {len(columns)}")
    times = drive.period * np.arange(drive.samples)
    return dataframe({"t": times, **dict(zip(columns, drive.inputs.T, strict=True))}, {"t": "s"})


@makes("card", Evaluation)
def evaluation_card(evaluation: Evaluation) -> Card:
    """Return the card of an evaluation."""
    title = f"Evaluation: {'feasible' if evaluation.feasible else 'infeasible'}"
    return Card(title, _score_facts(evaluation), PARAMETER_COLUMNS, _precision(evaluation, {}), leads=True)


@makes("table", Evaluation)
def evaluation_table(evaluation: Evaluation) -> Any:
    """Return a DataFrame with a row per estimated parameter of an evaluation, SI.

    Raises:
        UserMistake: pandas is not installed.
    """
    errors = evaluation.standard_deviations
    return dataframe(
        {
            "name": list(errors),
            "nominal": [evaluation.nominal.get(name) for name in errors],
            "standard_error": list(errors.values()),
            "unit": [evaluation.units.get(name, "") for name in errors],
        }
    )


def _score_facts(evaluation: Evaluation) -> tuple[Fact, ...]:
    return given(
        ("limits", limits_text(evaluation)),
        ("path length", size_text(evaluation.path_length, "m")),
        ("objective", number(evaluation.objective)),
        ("condition number", number(evaluation.condition_number)),
        ("integration", steps_text(evaluation.steps)),
        (
            "not identifiable",
            "" if evaluation.identifiable else "a combination that the criterion asks about",
        ),
    )


def _precision(evaluation: Evaluation, shown: Mapping[str, Unit]) -> tuple[Row, ...]:
    # Nominal values and predicted standard errors, in the units that `shown` has for some parameters.
    errors = evaluation.standard_deviations
    return parameter_rows(tuple(errors), evaluation.nominal, errors, evaluation.units, shown)


def limits_text(evaluation: Evaluation) -> str:
    """Return the state of the limits in words: `satisfied`, `duration exceeded by 0.50 s`."""
    broken = [margin for margin in evaluation.margins if not margin.satisfied]
    phrases = [f"{words(margin.name)} exceeded by {_violation_text(margin)}" for margin in broken]
    return "; ".join(phrases) or "satisfied"


def _violation_text(margin: Margin) -> str:
    # Rates stay in radians, as they are mostly given; angles are in degrees.
    text = quantity if margin.unit.startswith("rad/") else size_text
    return text(margin.violation, margin.unit, 2)


def steps_text(steps: Steps | None) -> str:
    """Return a warning about coarse integration steps; "" where the study's steps are fine enough."""
    if steps is None or (steps.enough == 1 and steps.settled):
        return ""
    change = f"by {significant(2)(100 * steps.change)} %" if np.isfinite(steps.change) else "without bound"
    coarse = f"The integration steps of the study are coarse: results change {change} with finer steps"
    if steps.settled:
        return f"{coarse}. All results are those of steps {steps.times} times finer."
    return f"{coarse}, and still change with steps {steps.times} times finer: take more samples."


def explored_text(explored: Explored) -> str:
    """Return solves, iterations and budget of a search in words."""
    solves = f"{explored.solves} solves on {explored.samples} samples a run"
    share = f"{explored.spent:.0f} of a budget of {explored.budget} on 200 samples"
    return f"{solves} took {explored.iterations} of Ipopt's iterations ({share})."


@makes("card", Solution)
def solution_card(solution: Solution) -> Card:
    """Return the card of a solution."""
    evaluation, model = solution.evaluation, None if solution.problem is None else solution.problem.model
    search = count(len(solution.starts), "start") if solution.starts else ""
    spent = quantity(solution.wall_seconds, "s", 2) if solution.wall_seconds else ""
    # What does not move through space has no path.
    moves = model is None or bool(model.velocity_signal)
    facts = () if evaluation is None else _score_facts(evaluation)
    facts = (
        *(fact for fact in facts if moves or fact[0] != "path length"),
        *given(("search", ", ".join(filter(None, [search, spent]))), ("message", solution.message)),
    )
    rows = () if evaluation is None else _precision(evaluation, {} if model is None else model.shown_units)
    title = f"Solution {solution.name}: {solution.status.value.replace('_', ' ')}"
    return Card(title, facts, PARAMETER_COLUMNS, rows, leads=True)


@makes("table", Solution)
def solution_table(solution: Solution) -> Any:
    """Return the DataFrame of a solution's evaluation.

    Raises:
        UserMistake: there is no design, or pandas is not installed.
    """
    if solution.evaluation is None:
        raise UserMistake(f"there is no design to make a table of: {solution.message}")
    return evaluation_table(solution.evaluation)

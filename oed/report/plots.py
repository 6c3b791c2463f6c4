"""The figures of objects in a console or a notebook: those of the reports, drawn for one object alone.

`oed.foundation.views` finds them here: objects themselves know of no figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from oed.foundation.errors import UserMistake
from oed.foundation.text import did_you_mean, listing, words
from oed.foundation.views import makes
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status
from oed.records.record import EstimateRecord, Record
from oed.report.estimate import estimate_sections
from oed.report.figures import chart, paths, spec
from oed.report.figures.driven import Path, Room, Run
from oed.report.page import sections_of
from oed.report.parts.inputs import groups_among, series_among
from oed.report.parts.reading import NOWHERE
from oed.report.parts.section import Section
from oed.robots.limits.workspace import Obstacles, workspace_of
from oed.robots.models.arcs import Integration, goes_sideways, signed_speeds
from oed.robots.sensors.mapped import points_seen

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRIVEN = ("path", "inputs")
"""Figures of a solution; of a record the names of those of its best drive."""
BEST_PATH = "best_path"


def picture(plot: spec.Plot) -> Figure:
    """A figure as notebooks show it."""
    # The drawing library is loaded when there is something to draw.
    from oed.report.figures.draw import shown_figure

    return shown_figure(plot)


@makes("figure", Record)
def record_figure(record: Record, what: str | None = None) -> Figure:
    """A figure of a record's report by its name, the first for None.

    Raises:
        UserMistake: there is none of that name.
    """
    inputs = [f"{one.quantity}s" for one in record.inputs[:1]]
    own = dict(zip(DRIVEN, [BEST_PATH, *inputs], strict=False))
    return _named(sections_of(record), own.get(what or "", what))


@makes("figure", EstimateRecord)
def estimate_figure(record: EstimateRecord, what: str | None = None) -> Figure:
    """A figure of an estimate's page by its name, the first for None.

    Raises:
        UserMistake: there is none of that name.
    """
    return _named(estimate_sections(record), what)


def _named(sections: Sequence[Section], what: str | None) -> Figure:
    table = {one.name: one.figure for section in sections for one in section.figures}
    if not table:
        raise UserMistake("there is nothing to draw: no result has a drive")
    name = next(iter(table)) if what is None else what
    if name not in table:
        raise _no_figure(name, list(table))
    return picture(table[name])


def _no_figure(what: str, known: Sequence[str]) -> UserMistake:
    hint = did_you_mean(what, known)
    return UserMistake(f"expected one of {listing(known)}; there is no figure {what!r}{hint}")


@makes("figure", Solution)
def solution_figure(solution: Solution, what: str = "path") -> Figure:
    """The path of a design in its room, or its inputs over time.

    Raises:
        UserMistake: there is no design, or no such figure.
    """
    named = dict(zip((BEST_PATH, *_inputs_names(solution)), DRIVEN, strict=False))
    what = named.get(what, what)
    if what not in DRIVEN:
        raise _no_figure(what, DRIVEN)
    if solution.trajectory is None or solution.evaluation is None:
        raise UserMistake(f"there is no design to draw: {solution.message}")
    if what == "inputs":
        return picture(_inputs(solution))
    room = Room() if solution.problem is None else _room(solution.problem)
    return picture(paths.paths([_path(solution)], room))


def _inputs_names(solution: Solution) -> list[str]:
    # As a report names the figure of the first ones.
    inputs = () if solution.problem is None else solution.problem.model.inputs
    return [f"{one.quantity}s" for one in inputs[:1]]


def _path(solution: Solution) -> Path:
    drive, evaluation, problem = solution.trajectory, solution.evaluation, solution.problem
    assert drive is not None
    assert evaluation is not None
    each = np.split(evaluation.states, drive.runs)
    sideways = any(goes_sideways(states, NOWHERE) for states in each)
    integration: Integration = "arc" if problem is None else getattr(problem.design, "integration", "arc")
    runs = []
    for states in each:
        x, y, angle = states[:, :3].T
        speeds = signed_speeds(states, drive.period, integration, sideways)
        runs.append(Run(x, y, angle, speeds, np.zeros(0, dtype=np.int64)))
    return Path(_title(solution), tuple(runs), evaluation.feasible, sideways)


def _title(solution: Solution) -> str:
    found, given = solution.evaluation, solution.status is Status.SCORED
    title = words(solution.name) if given else "Designed drive"
    return title if found is None or found.feasible else f"{title}: violates limits"


def _room(problem: Problem) -> Room:
    obstacles = next((one for one in problem.limits if isinstance(one, Obstacles)), None)
    beacons = points_seen(problem.sensors)
    shapes = () if obstacles is None else obstacles.shapes
    return Room(workspace_of(problem.limits), shapes, beacons, getattr(problem.model, "body_radius", 0.0))


def _inputs(solution: Solution) -> spec.Plot:
    problem = solution.problem
    assert solution.trajectory is not None
    width = solution.trajectory.coefficients.shape[1]
    group = groups_among(problem.model.inputs if problem is not None else (), width)[0][0]
    drive = series_among(solution.trajectory, group, _title(solution))
    return chart.series([drive], group, group.short_names, None)

"""Whether the parts of a problem fit together: every reason why they do not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from oed.foundation.arguments import kind_issue
from oed.foundation.errors import Issue, PartError, ProblemError, UserMistake
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean, listing
from oed.kernel.criteria import CRITERIA, Criterion
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.limit import Limit
from oed.kernel.measurement.blocks import Block
from oed.kernel.measurement.information import scaling_issues
from oed.kernel.measurement.joint import process_issues
from oed.kernel.measurement.measurement import Measurement, Sensor, joined, process_noise_of
from oed.kernel.measurement.prior import Prior
from oed.kernel.measurement.readings import labelled_nuisances
from oed.kernel.selection import Selection
from oed.kernel.statement import Statement

KINDS: dict[str, type] = {
    "model": System,
    "design": Space,
    "measurement": Measurement,
    "criterion": Criterion,
}
"""What parts of a problem are to be."""


def parts_of(problem: Statement) -> dict[str, Any]:
    """The parts of a problem as they are to be: lists and names replaced by what they stand for.

    Raises:
        ProblemError: parts that are something else than they are to be; every one is named.
    """
    issues: list[Issue] = []
    found = {
        "model": problem.model,
        "design": problem.design,
        "measurement": _measurement(problem.measurement, issues),
        "criterion": _criterion(problem.criterion, issues),
    }
    broken = {issue.key[0] for issue in issues}
    reasons = {name: kind_issue(one, KINDS[name]) for name, one in found.items() if name not in broken}
    if problem.prior is not None:
        reasons["prior"] = kind_issue(problem.prior, Prior)
    issues += [Issue((name,), reason) for name, reason in reasons.items() if reason]
    estimate = (problem.estimate,) if isinstance(problem.estimate, str) else problem.estimate
    if estimate is not None and not _are_names(estimate):
        issues.append(Issue(("estimate",), f"expected names of parameters, got {written(estimate)}"))
    limits, others = _limits(problem.limits)
    issues += others
    if issues:
        raise ProblemError(issues)
    return {**found, "limits": limits, "estimate": None if estimate is None else tuple(estimate)}


def _are_names(given: Any) -> bool:
    return isinstance(given, list | tuple) and all(isinstance(name, str) for name in given)


def _limits(given: Any) -> tuple[tuple[Limit, ...], list[Issue]]:
    if isinstance(given, Limit):
        return (given,), []
    if not isinstance(given, list | tuple):
        return (), [Issue(("limits",), f"expected a list of limits, got {written(given)}")]
    reasons = ((place, kind_issue(one, Limit)) for place, one in enumerate(given))
    return tuple(given), [Issue(("limits", place), reason) for place, reason in reasons if reason]


def _measurement(given: Any, issues: list[Issue]) -> Any:
    if not isinstance(given, list | tuple):
        return given
    reasons = ((place, kind_issue(one, Sensor)) for place, one in enumerate(given))
    found = [Issue(("measurement", place), reason) for place, reason in reasons if reason]
    if not given:
        found = [Issue(("measurement",), "expected at least one sensor")]
    issues += found
    return given if found else joined(given)


def _criterion(given: Any, issues: list[Issue]) -> Any:
    if not isinstance(given, str):
        return given
    kinds = {one.model_fields["kind"].default: one for one in CRITERIA}
    if given not in kinds:
        issues.append(
            Issue(
                ("criterion",),
                f"expected one of {', '.join(kinds)}, got {written(given)}{did_you_mean(given, kinds)}",
            )
        )
        return given
    try:
        return kinds[given](kind=given)
    except PartError as error:
        needs = listing([str(one.key[-1]) for one in error.issues])
        issues.append(Issue(("criterion",), f"{given} needs {needs} as well: give the criterion itself"))
        return given


def problem_issues(problem: Statement) -> list[Issue]:
    """Why a problem's parts do not fit together, by key; [] where they do."""
    model, space = problem.model, problem.design
    issues = model.issues()
    if issues:
        # Of such a system nothing else can be said.
        return issues
    issues += _signal_issues(problem) if space.own_signals else _spline_issues(space)
    issues += _start_issues(problem)
    for limit in problem.limits:
        issues += limit.issues(model, space)
    names = [limit.name for limit in problem.limits]
    for name in sorted({name for name in names if names.count(name) > 1}):
        issues.append(Issue(("limits", name), "given twice; a limit is known by its name"))
    issues += unbounded(problem) if problem.designed else []
    issues += problem.measurement.issues(model, space.samples)
    issues += process_issues(problem.measurement.joint_sensors, model)
    issues += _name_issues(problem)
    # What widens a problem by a tolerance is nobody's mistake.
    issues += [] if problem.excess else model.doubts(problem)
    # Blocks exist only for a measurement that fits the system.
    issues += [] if issues or problem.selection is None else _selection_issues(problem, problem.selection)
    return issues or _estimation_issues(problem) or _uncertainty_issues(problem)


def _spline_issues(space: Space) -> list[Issue]:
    needed = space.spline.degree + (3 if space.rest_to_rest else 1)
    if space.spline.count >= needed:
        return []
    text = (
        f"a degree-{space.spline.degree} spline{' at rest at both ends' if space.rest_to_rest else ''} "
        f"needs at least {needed} coefficients, got {space.spline.count}"
    )
    return [Issue(("trajectory", "spline", "coefficients"), text)]


def _signal_issues(problem: Statement) -> list[Issue]:
    space, names = problem.design, problem.model.input_names
    if len(space.own_signals) != len(names):
        text = f"expected one for each input ({', '.join(names)}), got {len(space.own_signals)}"
        return [Issue(("trajectory", "signals"), text)]
    ranges = problem.input_bounds
    found = [
        Issue(("trajectory", "signals", place), f"{names[place]}: {doubt}")
        for place, one in enumerate(space.own_signals)
        if (doubt := one.doubts(space.duration, space.samples) or one.misfit(*ranges[place]))
    ]
    if space.rest_to_rest:
        found.append(
            Issue(("trajectory", "rest_to_rest"), "each of `signals` says it for itself; leave it out")
        )
    return found


def _start_issues(problem: Statement) -> list[Issue]:
    space, states = problem.design, problem.model.states
    given = (
        {"start": space.fixed_starts}
        if space.start_ranges is None
        else {"start_bounds": space.start_ranges.T}
    )
    known = ", ".join(states) or "there are none"
    return [
        Issue(("trajectory", key), f"expected at most one for each state ({known}), got {table.shape[1]}")
        for key, table in given.items()
        if table is not None and table.shape[1] > len(states)
    ]


def unbounded(problem: Statement) -> list[Issue]:
    """Inputs that no limit bounds, with the limits that would; of those that are given none."""
    if problem.design.only is not None:
        return []
    names = [limit.name for limit in problem.limits]
    found = zip(problem.model.inputs, problem.input_bounds, strict=True)
    return [
        Issue(
            ("limits",),
            f"nothing bounds {one.name}; {problem.model.remedy(one, names)}, without which no design is best",
        )
        for one, pair in found
        if not np.isfinite(pair).all()
    ]


def _name_issues(problem: Statement) -> list[Issue]:
    # Parameters that the system has by none of the sorts it is known by, or of several at once.
    wanted, known = problem.estimated_of_system, problem.model.estimable
    if wanted is None or problem.estimate is None:
        return []
    if not problem.estimate:
        return [Issue(("estimate",), "expected at least one parameter")]
    labels = [problem.constants[name].name for name in problem.constants]
    if len(set(wanted)) < len(wanted) or len(set(labels)) < len(problem.estimate) - len(wanted):
        return [Issue(("estimate",), "a parameter is listed twice")]
    if any(set(wanted) <= set(names) for names in known.values()):
        return []
    choices = " or ".join(f"{sort} ({', '.join(names)})" for sort, names in known.items())
    constants = [one.name for one in labelled_nuisances(problem.measurement.joint_sensors)]
    choices += f", and constants of sensors ({', '.join(constants)})" if constants else ""
    text = f"expected some of the {problem.model.noun}'s {choices}, got {', '.join(wanted)}"
    every = [name for names in known.values() for name in names]
    text += next((did_you_mean(name, every) for name in wanted if name not in every), "")
    return [Issue(("estimate",), text)]


def _selection_issues(problem: Statement, selection: Selection) -> list[Issue]:
    return [Issue(("weights",), reason)] if (reason := _selection_reason(problem, selection)) else []


def _selection_reason(problem: Statement, selection: Selection) -> str:
    """Return why a problem's readings cannot be weighted so; "" if they can."""
    sensors = problem.measurement.joint_sensors
    if not sensors or any(sensor.joint_whitening is not None for sensor in sensors):
        text = "weights need sensors whose readings are independent of each other"
        return f"{text}; {problem.measurement.kind} are not"
    noise = process_noise_of(sensors)
    if noise is not None:
        text = "under drift what a reading says depends on the others, and weights would have to add it up"
        text = "weights of trials do not go with drift" if selection.of == "trials" else text
        return f"{text}: leave out `{noise.key}`, or `weights`"
    if not problem.criterion.concave:
        return f"need a concave criterion, which {problem.criterion.kind} is not: use E, D, A, G or I"
    if reason := _cost_reason(problem, selection):
        return reason
    if problem.robust is not None:
        return "cannot be chosen for several systems at once: leave out `robust`"
    try:
        parts = selection.parts_of(sensors, problem.system, problem.design)
        selection.require_whole(selection.budgets(parts))
    except UserMistake as error:
        return str(error)
    return ""


def _cost_reason(problem: Statement, selection: Selection) -> str:
    """Return why limits on all trials together are not known of these weights; "" where they are."""
    counted = ", ".join(limit.name for limit in problem.limits if limit.counts_trials)
    if not counted:
        return ""
    if selection.whole:
        return f"whole numbers are chosen without the budget of {counted}: give `total`, or leave one out"
    by_reading = selection.of == "readings"
    if by_reading and problem.model.states and problem.design.only is not None:
        return f"the budget of {counted} is of trials, not of readings: give `of: trials`"
    if by_reading and not problem.model.states and len(problem.measurement.joint_sensors) > 1:
        return f"the budget of {counted} needs one weight for each setting: give one sensor all outputs"
    return ""


def _uncertainty_issues(problem: Statement) -> list[Issue]:
    issues = problem.uncertainty.issues(problem.uncertain_system) if problem.uncertainty is not None else []
    return issues or (problem.robust.issues(problem.uncertain_system) if problem.robust is not None else [])


def _estimation_issues(problem: Statement) -> list[Issue]:
    said = [name for name, one in problem.constants.items() if one.deviation is not None]
    if said:
        text = f"what is known of {', '.join(said)} beforehand is to be given as `prior`, not as a deviation"
        return [Issue(("estimate",), text)]
    blocks = problem.any_blocks
    known = [name for block in blocks for name in block.parameters]
    strangers = [name for name in problem.estimate or () if name not in known]
    if strangers:
        text = (
            f"{', '.join(strangers)} cannot be estimated from {problem.measurement.kind}, "
            f"which identify {', '.join(known)}"
        )
        return [Issue(("estimate",), text)]
    estimated = problem.estimate or known
    unknown = [name for name in problem.criterion.subset or () if name not in estimated]
    if unknown or problem.criterion.subset == ():
        text = f"expected some of the estimated {', '.join(estimated)}, got {', '.join(unknown) or 'none'}"
        return [Issue(("criterion", "subset"), text)]
    judged = [problem.judged(block) for block in blocks]
    issues = scaling_issues(
        [block for block, names in zip(blocks, judged, strict=True) if names],
        problem.criterion.scaling,
        [names for names in judged if names],
    )
    issues += _prior_issues(problem, blocks, list(estimated))
    return issues or problem.criterion.issues(problem.subject)


def _prior_issues(problem: Statement, blocks: Sequence[Block], estimated: list[str]) -> list[Issue]:
    if problem.prior is None:
        return []
    if problem.criterion.scaling == "none" and any(block.raw for block in blocks):
        text = "a prior cannot be added to W'W, which leaves the noise out; use scaling: relative"
        return [Issue(("prior",), text)]
    table = {
        name: (value, unit)
        for block in blocks
        for name, value, unit in zip(block.parameters, block.nominal, block.units, strict=True)
    }
    values = np.array([table[name][0] for name in estimated])
    return problem.prior.issues(estimated, values, [table[name][1] for name in estimated])

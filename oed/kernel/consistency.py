"""Checks of the parts of a problem: what they must be, and whether they fit together."""

from __future__ import annotations

from collections.abc import Iterator
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
from oed.kernel.measurement.information import scaling_issues
from oed.kernel.measurement.measurement import Measurement, measurement_of
from oed.kernel.measurement.prior import Prior
from oed.kernel.measurement.readings import labelled_nuisances
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.statement import Statement

CRITERIA_BY_NAME = {criterion.model_fields["kind"].default: criterion for criterion in CRITERIA}
"""Criteria by the names that stand for them where they need no options."""


def parts_of(problem: Any) -> dict[str, Any]:
    """Return the parts of a problem with lists and names replaced by what they stand for.

    Before that the parts may be anything, and the problem is no `Statement` yet.

    Raises:
        ProblemError: parts of a wrong kind; every one is named.
    """
    issues = list(_kind_issues(problem))
    if issues:
        raise ProblemError(issues)
    limits, measurement, criterion = problem.limits, problem.measurement, problem.criterion
    return {
        "measurement": measurement_of(measurement),
        "criterion": CRITERIA_BY_NAME[criterion](kind=criterion) if isinstance(criterion, str) else criterion,
        "limits": (limits,) if isinstance(limits, Limit) else tuple(limits),
        "estimate": _names(problem.estimate),
    }


def _names(estimate: Any) -> Any:
    if isinstance(estimate, str):
        return (estimate,)
    return tuple(estimate) if isinstance(estimate, list | tuple) else estimate


def _kind_issues(problem: Any) -> Iterator[Issue]:
    yield from _kind_issue("model", problem.model, System)
    yield from _kind_issue("design", problem.design, Space)
    if isinstance(problem.measurement, list | tuple):
        yield from _list_issues("measurement", problem.measurement, Sensor)
        if not problem.measurement:
            yield Issue(("measurement",), "expected at least one sensor")
    elif not isinstance(problem.measurement, Sensor):
        yield from _kind_issue("measurement", problem.measurement, Measurement)
    if isinstance(problem.criterion, str):
        yield from _criterion_name_issues(problem.criterion)
    else:
        yield from _kind_issue("criterion", problem.criterion, Criterion)
    if problem.prior is not None:
        yield from _kind_issue("prior", problem.prior, Prior)
    names = _names(problem.estimate)
    if names is not None and not (isinstance(names, tuple) and all(isinstance(name, str) for name in names)):
        yield Issue(("estimate",), f"expected names of parameters, got {written(problem.estimate)}")
    if isinstance(problem.limits, list | tuple):
        yield from _list_issues("limits", problem.limits, Limit)
    elif not isinstance(problem.limits, Limit):
        yield Issue(("limits",), f"expected a list of limits, got {written(problem.limits)}")


def _kind_issue(name: str, part: Any, kind: type) -> Iterator[Issue]:
    if reason := kind_issue(part, kind):
        yield Issue((name,), reason)


def _list_issues(name: str, parts: Any, kind: type) -> Iterator[Issue]:
    for place, part in enumerate(parts):
        if reason := kind_issue(part, kind):
            yield Issue((name, place), reason)


def _criterion_name_issues(name: str) -> Iterator[Issue]:
    if name not in CRITERIA_BY_NAME:
        hint = did_you_mean(name, CRITERIA_BY_NAME)
        yield Issue(
            ("criterion",), f"expected one of {', '.join(CRITERIA_BY_NAME)}, got {written(name)}{hint}"
        )
        return
    try:
        CRITERIA_BY_NAME[name](kind=name)
    except PartError as error:
        needs = listing([str(issue.key[-1]) for issue in error.issues])
        yield Issue(("criterion",), f"{name} needs {needs} as well: give the criterion itself")


def problem_issues(problem: Statement) -> list[Issue]:
    """Return why a problem's parts do not fit together, by key; [] where they do.

    Each check relies on what those before it have made sure of.
    """
    for check in (
        _system_issues,
        _part_issues,
        _selection_issues,
        _constant_issues,
        _estimate_issues,
        _subset_issues,
        _scale_issues,
        _criterion_issues,
        _uncertainty_issues,
        _robust_issues,
    ):
        issues = list(check(problem))
        if issues:
            return issues
    return []


def _system_issues(problem: Statement) -> Iterator[Issue]:
    yield from problem.model.issues()


def _part_issues(problem: Statement) -> Iterator[Issue]:
    model, space = problem.model, problem.design
    yield from _input_issues(problem)
    yield from _start_issues(problem)
    for limit in problem.limits:
        yield from limit.issues(model, space)
    names = [limit.name for limit in problem.limits]
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield Issue(("limits", name), "given twice; a limit is known by its name")
    if problem.designed:
        yield from unbounded(problem)
    yield from problem.measurement.issues(model, space.samples)
    yield from _name_issues(problem)
    if not problem.excess:
        # What widens a problem by a tolerance is nobody's mistake.
        yield from model.doubts(problem)


def _input_issues(problem: Statement) -> Iterator[Issue]:
    space, names = problem.design, problem.model.input_names
    if not space.stores_steps:
        if shortage := space.spline.signal(rest_to_rest=space.rest_to_rest).shortage:
            yield Issue(("trajectory", "spline", "coefficients"), shortage)
        return
    signals = space.signals_of(len(names))
    if len(signals) != len(names):
        text = f"expected one for each input ({', '.join(names)}), got {len(signals)}"
        yield Issue(("trajectory", "signals"), text)
        return
    for place, (signal, bounds) in enumerate(zip(signals, problem.input_bounds, strict=True)):
        if doubt := signal.doubts(space.duration, space.samples, *bounds):
            yield Issue(("trajectory", "signals", place), f"{names[place]}: {doubt}")
    if space.rest_to_rest:
        yield Issue(("trajectory", "rest_to_rest"), "each of `signals` says it for itself; leave it out")


def _start_issues(problem: Statement) -> Iterator[Issue]:
    space, states = problem.design, problem.model.states
    if space.start_ranges is None:
        key, table = "start", space.fixed_starts
    else:
        key, table = "start_bounds", space.start_ranges.T
    if table is not None and table.shape[1] > len(states):
        names = ", ".join(states) or "there are none"
        yield Issue(
            ("trajectory", key), f"expected at most one for each state ({names}), got {table.shape[1]}"
        )


def unbounded(problem: Statement) -> Iterator[Issue]:
    """Yield an issue for every input that no limit bounds, with the limits that would bound it."""
    if problem.design.only is not None:
        return
    names = [limit.name for limit in problem.limits]
    for channel, bounds in zip(problem.model.inputs, problem.input_bounds, strict=True):
        if not np.isfinite(bounds).all():
            remedy = problem.model.remedy(channel, names)
            text = f"nothing bounds {channel.name}; {remedy}, without which no design is best"
            yield Issue(("limits",), text)


def _name_issues(problem: Statement) -> Iterator[Issue]:
    # Parameters must all be of one of the sets by which the system can be described.
    wanted, estimable = problem.estimated_of_system, problem.model.estimable
    if wanted is None or problem.estimate is None:
        return
    labels = {constant.name for constant in problem.constants.values()}
    if not problem.estimate:
        yield Issue(("estimate",), "expected at least one parameter")
    elif len(set(wanted)) < len(wanted) or len(labels) < len(problem.estimate) - len(wanted):
        yield Issue(("estimate",), "a parameter is listed twice")
    elif not any(set(wanted) <= set(names) for names in estimable.values()):
        choices = " or ".join(f"{sort} ({', '.join(names)})" for sort, names in estimable.items())
        constants = [nuisance.name for nuisance in labelled_nuisances(problem.sensors)]
        choices += f", and constants of sensors ({', '.join(constants)})" if constants else ""
        text = f"expected some of the {problem.model.noun}'s {choices}, got {', '.join(wanted)}"
        every = [name for names in estimable.values() for name in names]
        text += next((did_you_mean(name, every) for name in wanted if name not in every), "")
        yield Issue(("estimate",), text)


def _selection_issues(problem: Statement) -> Iterator[Issue]:
    if reason := _selection_reason(problem):
        yield Issue(("weights",), reason)


def _selection_reason(problem: Statement) -> str:
    # Why the readings cannot be weighted; "" if they can, or need not.
    selection, sensors = problem.selection, problem.sensors
    if selection is None:
        return ""
    if not sensors or any(sensor.joint_whitening is not None for sensor in sensors):
        text = "weights need sensors whose readings are independent of each other"
        return f"{text}; {problem.measurement.kind} are not"
    noise = problem.process_noise
    if noise is not None:
        text = "under drift what a reading says depends on the others, and weights would have to add it up"
        text = "weights of trials do not go with drift" if selection.of == "trials" else text
        return f"{text}: leave out `{noise.key}`, or `weights`"
    if not problem.criterion.concave:
        return f"need a concave criterion, which {problem.criterion.kind} is not: use E, D, A, G or I"
    counted = ", ".join(limit.name for limit in problem.limits if limit.counts_trials)
    if counted and selection.whole:
        return f"whole numbers are chosen without the budget of {counted}: give `total`, or leave one out"
    by_reading, states = selection.of == "readings", problem.model.states
    candidates = problem.design.only is not None and problem.model.inputs
    if counted and by_reading and states and candidates:
        return f"the budget of {counted} is of trials, not of readings: give `of: trials`"
    if counted and by_reading and not states and len(sensors) > 1:
        return f"the budget of {counted} needs one weight for each setting: give one sensor all outputs"
    if problem.robust is not None:
        return "cannot be chosen for several systems at once: leave out `robust`"
    try:
        parts = selection.parts_of(sensors, problem.system, problem.design)
        selection.require_whole(selection.budgets(parts))
    except UserMistake as error:
        return str(error)
    return ""


def _constant_issues(problem: Statement) -> Iterator[Issue]:
    names = [name for name, constant in problem.constants.items() if constant.deviation is not None]
    if names:
        text = f"what is known of {', '.join(names)} beforehand is to be given as `prior`, not as a deviation"
        yield Issue(("estimate",), text)


def _estimable(problem: Statement) -> list[str]:
    return [name for block in problem.any_blocks for name in block.parameters]


def _estimate_issues(problem: Statement) -> Iterator[Issue]:
    names = _estimable(problem)
    strangers = [name for name in problem.estimate or () if name not in names]
    if strangers:
        text = (
            f"{', '.join(strangers)} cannot be estimated from {problem.measurement.kind}, "
            f"which identify {', '.join(names)}"
        )
        yield Issue(("estimate",), text)


def _subset_issues(problem: Statement) -> Iterator[Issue]:
    estimated, subset = problem.estimate or _estimable(problem), problem.criterion.subset
    strangers = [name for name in subset or () if name not in estimated]
    if strangers or subset == ():
        text = f"expected some of the estimated {', '.join(estimated)}, got {', '.join(strangers) or 'none'}"
        yield Issue(("criterion", "subset"), text)


def _scale_issues(problem: Statement) -> Iterator[Issue]:
    judged = [(block, names) for block in problem.any_blocks if (names := problem.judged(block))]
    yield from scaling_issues(judged, problem.criterion.scaling)
    yield from _prior_issues(problem)


def _prior_issues(problem: Statement) -> Iterator[Issue]:
    if problem.prior is None:
        return
    blocks, estimated = problem.any_blocks, list(problem.estimate or _estimable(problem))
    if problem.criterion.scaling == "none" and any(block.raw for block in blocks):
        text = "a prior cannot be added to W'W, which leaves the noise out; use scaling: relative"
        yield Issue(("prior",), text)
        return
    table = {
        name: (value, unit)
        for block in blocks
        for name, value, unit in zip(block.parameters, block.nominal, block.units, strict=True)
    }
    values, units = zip(*(table[name] for name in estimated), strict=True)
    yield from problem.prior.issues(estimated, np.array(values), list(units))


def _criterion_issues(problem: Statement) -> Iterator[Issue]:
    yield from problem.criterion.issues(problem.subject)


def _uncertainty_issues(problem: Statement) -> Iterator[Issue]:
    if problem.uncertainty is not None:
        yield from problem.uncertainty.issues(problem.uncertain_system)


def _robust_issues(problem: Statement) -> Iterator[Issue]:
    if problem.robust is not None:
        yield from problem.robust.issues(problem.uncertain_system)

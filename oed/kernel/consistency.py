"""Whether the parts of a problem fit together: every reason why they do not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from oed.foundation.arguments import kind_flaw
from oed.foundation.errors import Flaw, PartError, ProblemError
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean, listing
from oed.kernel.criteria import CRITERIA, Criterion
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.limit import Limit
from oed.kernel.measurement.information import scaling_flaws
from oed.kernel.measurement.measurement import Block, Measurement
from oed.kernel.measurement.prior import Prior
from oed.kernel.measurement.process_noise import process_flaws
from oed.kernel.measurement.sensor import Sensor, joined, labelled_nuisances

if TYPE_CHECKING:
    from oed.kernel.problem import Problem


KINDS: dict[str, type] = {
    "model": System,
    "design": Space,
    "measurement": Measurement,
    "criterion": Criterion,
}
"""What parts of a problem are to be."""


def parts_of(problem: Problem) -> dict[str, Any]:
    """The parts of a problem as they are to be: lists and names replaced by what they stand for.

    Raises:
        ProblemError: parts that are something else than they are to be; every one is named.
    """
    flaws: list[Flaw] = []
    found = {
        "model": problem.model,
        "design": problem.design,
        "measurement": _measurement(problem.measurement, flaws),
        "criterion": _criterion(problem.criterion, flaws),
    }
    broken = {flaw.key[0] for flaw in flaws}
    reasons = {name: kind_flaw(one, KINDS[name]) for name, one in found.items() if name not in broken}
    if problem.prior is not None:
        reasons["prior"] = kind_flaw(problem.prior, Prior)
    flaws += [Flaw((name,), reason) for name, reason in reasons.items() if reason]
    estimate = (problem.estimate,) if isinstance(problem.estimate, str) else problem.estimate
    limits, others = _limits(problem.limits)
    flaws += others
    if flaws:
        raise ProblemError(flaws)
    return {**found, "limits": limits, "estimate": None if estimate is None else tuple(estimate)}


def _kind_flaws(found: Mapping[str, object], kinds: Mapping[str, type]) -> list[Flaw]:
    reasons = {name: kind_flaw(one, kinds[name]) for name, one in found.items()}
    return [Flaw((name,), reason) for name, reason in reasons.items() if reason]


def _limits(given: Any) -> tuple[tuple[Limit, ...], list[Flaw]]:
    if isinstance(given, Limit):
        return (given,), []
    if not isinstance(given, list | tuple):
        return (), [Flaw(("limits",), f"expected a list of limits, got {written(given)}")]
    reasons = ((place, kind_flaw(one, Limit)) for place, one in enumerate(given))
    return tuple(given), [Flaw(("limits", place), reason) for place, reason in reasons if reason]


def _measurement(given: Any, flaws: list[Flaw]) -> Any:
    if not isinstance(given, list | tuple):
        return given
    reasons = ((place, kind_flaw(one, Sensor)) for place, one in enumerate(given))
    found = [Flaw(("measurement", place), reason) for place, reason in reasons if reason]
    if not given:
        found = [Flaw(("measurement",), "expected at least one sensor")]
    flaws += found
    return given if found else joined(given)


def _criterion(given: Any, flaws: list[Flaw]) -> Any:
    if not isinstance(given, str):
        return given
    kinds = {one.model_fields["kind"].default: one for one in CRITERIA}
    if given not in kinds:
        flaws.append(
            Flaw(
                ("criterion",),
                f"expected one of {', '.join(kinds)}, got {written(given)}{did_you_mean(given, kinds)}",
            )
        )
        return given
    try:
        return kinds[given](kind=given)
    except PartError as error:
        needs = listing([str(one.key[-1]) for one in error.flaws])
        flaws.append(Flaw(("criterion",), f"{given} needs {needs} as well: give the criterion itself"))
        return given


def problem_flaws(problem: Problem) -> list[Flaw]:
    """Why a problem's parts do not fit together, by key; [] where they do."""
    model, space = problem.model, problem.design
    flaws = model.flaws()
    if flaws:
        # Of such a system nothing else can be said.
        return flaws
    flaws += _signal_flaws(problem) if space.own_signals else _spline_flaws(space)
    flaws += _start_flaws(problem)
    for limit in problem.limits:
        flaws += limit.flaws(model, space)
    names = [limit.name for limit in problem.limits]
    for name in sorted({name for name in names if names.count(name) > 1}):
        flaws.append(Flaw(("limits", name), "given twice; a limit is known by its name"))
    flaws += unbounded(problem) if problem.designed else []
    flaws += problem.measurement.flaws(model, space.samples)
    flaws += process_flaws(problem.measurement.joint_sensors, model)
    flaws += _name_flaws(problem)
    # What widens a problem by a tolerance is nobody's mistake.
    flaws += [] if problem.excess else model.doubts(problem)
    # Blocks exist only for a measurement that fits the system.
    chosen = problem.selection.flaws(problem) if problem.selection is not None and not flaws else []
    return flaws or chosen or _estimation_flaws(problem) or _uncertainty_flaws(problem)


def _spline_flaws(space: Space) -> list[Flaw]:
    needed = space.spline.degree + (3 if space.rest_to_rest else 1)
    if space.spline.count >= needed:
        return []
    text = (
        f"a degree-{space.spline.degree} spline{' at rest at both ends' if space.rest_to_rest else ''} "
        f"needs at least {needed} coefficients, got {space.spline.count}"
    )
    return [Flaw(("trajectory", "spline", "coefficients"), text)]


def _signal_flaws(problem: Problem) -> list[Flaw]:
    space, names = problem.design, problem.model.input_names
    if len(space.own_signals) != len(names):
        text = f"expected one for each input ({', '.join(names)}), got {len(space.own_signals)}"
        return [Flaw(("trajectory", "signals"), text)]
    ranges = problem.input_bounds
    found = [
        Flaw(("trajectory", "signals", place), f"{names[place]}: {doubt}")
        for place, one in enumerate(space.own_signals)
        if (doubt := one.doubts(space.duration, space.samples) or one.misfit(*ranges[place]))
    ]
    if space.rest_to_rest:
        found.append(
            Flaw(("trajectory", "rest_to_rest"), "each of `signals` says it for itself; leave it out")
        )
    return found


def _start_flaws(problem: Problem) -> list[Flaw]:
    space, states = problem.design, problem.model.states
    given = (
        {"start": space.fixed_starts}
        if space.start_ranges is None
        else {"start_bounds": space.start_ranges.T}
    )
    known = ", ".join(states) or "there are none"
    return [
        Flaw(("trajectory", key), f"expected at most one for each state ({known}), got {table.shape[1]}")
        for key, table in given.items()
        if table is not None and table.shape[1] > len(states)
    ]


def unbounded(problem: Problem) -> list[Flaw]:
    """Inputs that no limit bounds, with the limits that would; of those that are given none."""
    if problem.design.only is not None:
        return []
    names = [limit.name for limit in problem.limits]
    found = zip(problem.model.inputs, problem.input_bounds, strict=True)
    return [
        Flaw(
            ("limits",),
            f"nothing bounds {one.name}; {problem.model.remedy(one, names)}, without which no design is best",
        )
        for one, pair in found
        if not np.isfinite(pair).all()
    ]


def _name_flaws(problem: Problem) -> list[Flaw]:
    # Parameters that the system has by none of the sorts it is known by, or of several at once.
    wanted, known = problem.estimated_of_system, problem.model.estimable
    if wanted is None or problem.estimate is None:
        return []
    if not problem.estimate:
        return [Flaw(("estimate",), "expected at least one parameter")]
    labels = [problem.constants[name].name for name in problem.constants]
    if len(set(wanted)) < len(wanted) or len(set(labels)) < len(problem.estimate) - len(wanted):
        return [Flaw(("estimate",), "a parameter is listed twice")]
    if any(set(wanted) <= set(names) for names in known.values()):
        return []
    choices = " or ".join(f"{sort} ({', '.join(names)})" for sort, names in known.items())
    constants = [one.name for one in labelled_nuisances(problem.measurement.joint_sensors)]
    choices += f", and constants of sensors ({', '.join(constants)})" if constants else ""
    text = f"expected some of the {problem.model.noun}'s {choices}, got {', '.join(wanted)}"
    every = [name for names in known.values() for name in names]
    text += next((did_you_mean(name, every) for name in wanted if name not in every), "")
    return [Flaw(("estimate",), text)]


def _uncertainty_flaws(problem: Problem) -> list[Flaw]:
    flaws = problem.uncertainty.flaws(problem.uncertain_system) if problem.uncertainty is not None else []
    return flaws or (problem.robust.flaws(problem.uncertain_system) if problem.robust is not None else [])


def _estimation_flaws(problem: Problem) -> list[Flaw]:
    said = [name for name, one in problem.constants.items() if one.deviation is not None]
    if said:
        text = f"what is known of {', '.join(said)} beforehand is to be given as `prior`, not as a deviation"
        return [Flaw(("estimate",), text)]
    blocks = problem.any_blocks
    known = [name for block in blocks for name in block.parameters]
    strangers = [name for name in problem.estimate or () if name not in known]
    if strangers:
        text = (
            f"{', '.join(strangers)} cannot be estimated from {problem.measurement.kind}, "
            f"which identify {', '.join(known)}"
        )
        return [Flaw(("estimate",), text)]
    estimated = problem.estimate or known
    unknown = [name for name in problem.criterion.subset or () if name not in estimated]
    if unknown or problem.criterion.subset == ():
        text = f"expected some of the estimated {', '.join(estimated)}, got {', '.join(unknown) or 'none'}"
        return [Flaw(("criterion", "subset"), text)]
    judged = [problem.judged(block) for block in blocks]
    flaws = scaling_flaws(
        [block for block, names in zip(blocks, judged, strict=True) if names],
        problem.criterion.scaling,
        [names for names in judged if names],
    )
    flaws += _prior_flaws(problem, blocks, list(estimated))
    return flaws or problem.criterion.flaws(problem.subject)


def _prior_flaws(problem: Problem, blocks: Sequence[Block], estimated: list[str]) -> list[Flaw]:
    if problem.prior is None:
        return []
    if problem.criterion.scaling == "none" and any(block.raw for block in blocks):
        text = "a prior cannot be added to W'W, which leaves the noise out; use scaling: relative"
        return [Flaw(("prior",), text)]
    table = {
        name: (value, unit)
        for block in blocks
        for name, value, unit in zip(block.parameters, block.nominal, block.units, strict=True)
    }
    values = np.array([table[name][0] for name in estimated])
    return problem.prior.flaws(estimated, values, [table[name][1] for name in estimated])

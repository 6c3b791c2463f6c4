"""Whether the parts of a problem fit together: every reason why they do not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from oed.foundation.errors import Flaw
from oed.kernel.measurement.information import scaling_flaws
from oed.kernel.measurement.measurement import Block

if TYPE_CHECKING:
    from oed.kernel.problem import Problem


def problem_flaws(problem: Problem) -> list[Flaw]:
    """Why a problem's parts do not fit together, by key; [] where they do."""
    model, space = problem.model, problem.design
    flaws = model.flaws()
    if flaws:
        # Of such a system nothing else can be said.
        return flaws
    needed = space.spline.degree + (3 if space.rest_to_rest else 1)
    if space.spline.coefficients < needed:
        text = (
            f"a degree-{space.spline.degree} spline{' at rest at both ends' if space.rest_to_rest else ''} "
            f"needs at least {needed} coefficients, got {space.spline.coefficients}"
        )
        flaws.append(Flaw(("trajectory", "spline", "coefficients"), text))
    for limit in problem.limits:
        flaws += limit.flaws(model, space)
    names = [limit.name for limit in problem.limits]
    for name in sorted({name for name in names if names.count(name) > 1}):
        flaws.append(Flaw(("limits", name), "given twice; a limit is known by its name"))
    flaws += _unbounded(problem)
    flaws += problem.measurement.flaws(model, space.samples)
    flaws += _name_flaws(problem)
    # Blocks exist only for a measurement that fits the system.
    return flaws or _estimation_flaws(problem) or _uncertainty_flaws(problem)


def _unbounded(problem: Problem) -> list[Flaw]:
    # Inputs that no limit bounds, with the limits that would.
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
    wanted, known = problem.estimate, problem.model.estimable
    if wanted is None:
        return []
    if not wanted:
        return [Flaw(("estimate",), "expected at least one parameter")]
    if len(set(wanted)) < len(wanted):
        return [Flaw(("estimate",), "a parameter is listed twice")]
    if any(set(wanted) <= set(names) for names in known.values()):
        return []
    choices = " or ".join(f"{sort} ({', '.join(names)})" for sort, names in known.items())
    text = f"expected some of the {problem.model.noun}'s {choices}, got {', '.join(wanted)}"
    return [Flaw(("estimate",), text)]


def _uncertainty_flaws(problem: Problem) -> list[Flaw]:
    flaws = problem.uncertainty.flaws(problem.uncertain_system) if problem.uncertainty is not None else []
    return flaws or (problem.robust.flaws(problem.uncertain_system) if problem.robust is not None else [])


def _estimation_flaws(problem: Problem) -> list[Flaw]:
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

"""Information matrices: how much a measurement says about its parameters, in the scaling chosen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue
from oed.foundation.quantities import Size, parse_size
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.blocks import Block
from oed.kernel.measurement.matrices import eliminate
from oed.kernel.measurement.square_root import SquareRoot, project_out, rounding_of

Scaling = Literal["relative", "none"] | Mapping[str, Size]
"""Sizes of parameters are in SI, with a unit, or shares of the nominal values."""
SCALINGS = {"relative": "relative to their nominal values", "none": "in SI units"}


FAINT = 2e-15
"""Share of the largest change of the readings that is rounding of it."""
CANCELLED = 1e-13
"""Share of the sum of their magnitudes to which thousands of numbers that cancel are known."""


def scaling_text(scaling: Scaling) -> str:
    """Return the units in which a criterion sees the parameters, in words."""
    return SCALINGS[scaling] if isinstance(scaling, str) else "in units of the scales given"


def information(
    block: Block,
    scaling: Scaling,
    *,
    parameters: Sequence[str] | None = None,
    unwanted: Sequence[str] = (),
    prior: Array | None = None,
) -> Expression:
    """D F D (p, p), with D the parameters' scales and F the information, nuisances eliminated.

    `relative` scales by the nominal values (a parameter that is nominally 0 by a size of its own), so that
    lambda_min^(-1/2) is the worst relative standard deviation; a mapping gives a scale per parameter; `none`
    leaves the parameters in SI units, and for the paper's regressions (`block.raw`) the noise out as well:
    W'W.

    Args:
        block: the readings.
        scaling: scaling of the parameters.
        parameters: parameters of interest; all of the block's by default. Others are taken as known.
        unwanted: further parameters that are unknown but not of interest: eliminated as nuisances are.
        prior: information on (parameters, unwanted) had beforehand, SI.
    """
    chosen = tuple(block.parameters if parameters is None else parameters)
    nuisances = len(block.nuisances)
    matrix = block.information(_columns(block, (*chosen, *unwanted))) * _precision(block, scaling) ** 2
    if prior is not None:
        matrix = matrix + ca.diagcat(ca.DM(prior), ca.DM(nuisances, nuisances))
    scales = ca.diag(ca.DM(scale_factors(block, scaling, chosen)))
    return scales @ eliminate(matrix, len(chosen)) @ scales


def square_root(
    block: Block,
    jacobian: Array,
    parameters: Sequence[str],
    unwanted: Sequence[str] = (),
    prior: Array | None = None,
    summed: Array | None = None,
) -> SquareRoot:
    """F of a drive in numbers, SI, in units of the block's noise: by its square root, nothing is squared.

    Args:
        block: the readings.
        jacobian: the drive's values of `block.jacobian`.
        parameters: parameters of interest.
        unwanted: further parameters that are unknown but not of interest.
        prior: information on (parameters, unwanted) had beforehand, SI.
        summed: the drive's values of `block.magnitudes`, (p,).
    """
    width = len(parameters)
    scaled_jacobian = np.array(jacobian)
    scaled_jacobian[:, _rounding_alone(block, jacobian, summed)] = 0.0
    rows = block.rows(scaled_jacobian[:, _columns(block, (*parameters, *unwanted))])
    rows = np.vstack([rows, (block.noise or 1.0) * _known_rows(block, rows.shape[1], prior)])
    sizes = np.linalg.norm(rows[:, :width], axis=0)
    remaining, rounding = project_out(rows, width, rounding_of(jacobian))
    return SquareRoot.of_rows(remaining, sizes, rounding)


def _rounding_alone(block: Block, jacobian: Array, summed: Array | None) -> list[int]:
    # Columns of parameters that, changed by as much as they are, change the readings by less than the largest
    # change of another is rounded by, whether that is to be estimated or known: motions that cancel, as of a
    # system that goes sideways, leave that much. And columns whose entries are sums that cancel themselves.
    sizes = scale_factors(block, "relative")
    lengths = np.linalg.norm(jacobian[:, : len(sizes)], axis=0)
    lost = (lengths * sizes <= FAINT * (lengths * sizes).max(initial=0.0)) & (sizes > 0)
    if summed is not None:
        lost |= (lengths <= CANCELLED * summed) & (summed > 0)
    return np.flatnonzero(lost).tolist()


def weights_of(block: Block, scaling: Scaling, parameters: Sequence[str]) -> Array:
    """Return the factors (p,) that bring the parameters' columns of that square root to a scaling.

    Args:
        block: block with the parameters.
        scaling: scaling of the parameters.
        parameters: names, p of them.
    """
    return _precision(block, scaling) * scale_factors(block, scaling, parameters)


def _columns(block: Block, names: Sequence[str]) -> list[int]:
    # Of these parameters, then of all nuisances.
    first = len(block.parameters)
    places = [block.parameters.index(name) for name in names]
    return [*places, *range(first, first + len(block.nuisances))]


def _known_rows(block: Block, width: int, prior: Array | None) -> Array:
    # Priors as further rows: of the parameters, and of nuisances with a deviation.
    first = width - len(block.nuisances)
    deviations = [(first + index, nuisance.deviation) for index, nuisance in enumerate(block.nuisances)]
    nuisance_rows = [
        np.eye(width)[place] / deviation for place, deviation in deviations if deviation is not None
    ]
    nuisances = np.reshape(nuisance_rows, (-1, width))
    if prior is None:
        return nuisances
    return np.vstack([np.pad(SquareRoot.of_matrix(prior).rows, ((0, 0), (0, width - first))), nuisances])


def _precision(block: Block, scaling: Scaling) -> float:
    # A block without noise is refused when the problem is made; see `scaling_issues`.
    divided = block.noise is not None and not (block.raw and scaling == "none")
    return 1.0 / float(block.noise or 1.0) if divided else 1.0


def scale_factors(block: Block, scaling: Scaling, parameters: Sequence[str] | None = None) -> Array:
    """Scale (p,) of each parameter of interest, SI.

    Args:
        block: block with the parameters.
        scaling: scaling of the parameters.
        parameters: names, p of them.
    """
    names = block.parameters if parameters is None else tuple(parameters)
    if scaling == "none":
        return np.ones(len(names))
    if scaling == "relative":
        return np.array([block.scales[block.parameters.index(name)] for name in names])
    return np.array([_size(block, scaling, name) for name in names])


def _size(block: Block, scaling: Mapping[str, Size], name: str) -> float:
    place = block.parameters.index(name)
    return parse_size(scaling[name], float(block.nominal[place]), block.units[place], "scale")


def scaling_issues(
    blocks: Sequence[Block], scaling: Scaling, parameters: Sequence[Sequence[str]] | None = None
) -> Iterator[Issue]:
    """Yield what keeps `scaling` from being applied to these blocks' parameters of interest.

    Args:
        blocks: blocks of readings.
        scaling: scaling of the parameters.
        parameters: names of each block's parameters of interest.
    """
    if scaling == "none":
        return
    chosen = [block.parameters for block in blocks] if parameters is None else parameters
    for block, names in zip(blocks, chosen, strict=True):
        if block.noise is None:
            text = f"the {block.name} noise is needed to weight the information (or use scaling: none)"
            yield Issue(("measurement", "noise"), text)
        zero = [name for name in names if block.scales[block.parameters.index(name)] == 0]
        if scaling == "relative" and zero:
            sizes = ", ".join(f"{name}: ..." for name in names)
            text = (
                f"{', '.join(zero)} is nominally 0 and has no relative precision; give the `criterion` "
                f"sizes, scaling: {{{sizes}}}, or scaling: none"
            )
            yield Issue(("criterion", "scaling"), text)
    if isinstance(scaling, Mapping):
        owners = {name: block for block, names in zip(blocks, chosen, strict=True) for name in names}
        yield from _scale_issues(owners, scaling)


def _scale_issues(owners: Mapping[str, Block], scaling: Mapping[str, Size]) -> Iterator[Issue]:
    # Of every parameter a scale, and no others; `owners` are the parameters' blocks.
    for name in owners:
        if name not in scaling:
            yield Issue(("criterion", "scaling"), f"the scale of {name} is missing")
    for name in scaling:
        if name not in owners:
            text = f"{name} is not judged here; the parameters are {', '.join(owners)}"
            yield Issue(("criterion", "scaling", name), text)
            continue
        try:
            _size(owners[name], scaling, name)
        except ValueError as error:
            yield Issue(("criterion", "scaling", name), str(error))

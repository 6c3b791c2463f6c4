"""Information in a block of readings: an expression for searches, its square root in numbers for scores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
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


@dataclass(frozen=True)
class Estimation:
    """Information in one block of a drive's readings.

    Attributes:
        block: the readings.
        parameters: estimated parameters, those of the criterion's interest first; others are known.
        judged: the latter alone.
        scaling: scaling of the criterion: `relative` by the nominal values (a parameter that is nominally 0
            by a size of its own), so that lambda_min^(-1/2) is the worst relative standard deviation; a
            mapping gives a scale per parameter; `none` leaves the parameters in SI units, and for the paper's
            regressions (`block.raw`) the noise out as well: W'W.
        prior: information on all estimated parameters had beforehand, SI, or None.
    """

    block: Block
    parameters: tuple[str, ...]
    judged: tuple[str, ...]
    scaling: Scaling
    prior: Array | None

    @property
    def scales(self) -> Array:
        """Scale factors of the judged parameters, SI."""
        if self.scaling == "none":
            return np.ones(len(self.judged))
        if self.scaling == "relative":
            return self.block.scales[self._places[: len(self.judged)]]
        return np.array([_size(self.block, self.scaling, name) for name in self.judged])

    @property
    def _root_weight(self) -> float:
        # A block without noise is refused when the problem is made; see `scaling_issues`.
        divided = self.block.noise is not None and not (self.block.raw and self.scaling == "none")
        return 1.0 / float(self.block.noise or 1.0) if divided else 1.0

    @cached_property
    def matrix(self) -> Expression:
        """Information on the judged parameters, scaled, all else eliminated: what the criterion sees."""
        return self.matrix_of(self.block.information)

    def matrix_of(self, information: Callable[[Sequence[int]], Expression]) -> Expression:
        """Return `matrix` of other information than the block's.

        Args:
            information: function of places of unknowns that returns the information on these.
        """
        matrix = information(self.block.places(self.parameters)) * self._root_weight**2
        if self.prior is not None:
            nuisances = len(self.block.nuisances)
            matrix = matrix + ca.diagcat(ca.DM(self.prior), ca.DM(nuisances, nuisances))
        scales = ca.diag(ca.DM(self.scales))
        return scales @ eliminate(matrix, len(self.judged)) @ scales

    def square_roots(self, jacobian: Array, summed: Array) -> tuple[SquareRoot, SquareRoot]:
        """Return the information of a drive in numbers: what `matrix` is of it, and F on all estimated
        parameters, SI (per unit of noise where that is not known).

        Args:
            jacobian: the drive's values of `block.jacobian`.
            summed: the drive's values of `block.magnitudes`, (p,).
        """
        block, width = self.block, len(self.parameters)
        read = np.array(jacobian)
        read[:, _rounding_alone(block, jacobian, summed)] = 0.0
        places, noise = block.places(self.parameters), block.noise or 1.0
        rows = [block.rows(read[:, places]), noise * np.diag(np.sqrt(block.precisions[places]))]
        if self.prior is not None:
            known = SquareRoot.of_matrix(self.prior).rows
            rows.append(noise * np.pad(known, ((0, 0), (0, len(places) - width))))
        every = np.vstack(rows)

        def leading(count: int) -> SquareRoot:
            # Of all rows at once: a column of which elimination leaves rounding is no column like any other.
            remaining, rounding = project_out(every, count, rounding_of(jacobian))
            return SquareRoot.of_rows(remaining, np.linalg.norm(every[:, :count], axis=0), rounding)

        judged, full = leading(len(self.judged)), leading(width)
        return judged.scaled(self._root_weight * self.scales), full.scaled(1.0 / noise)

    @property
    def _places(self) -> list[int]:
        return [self.block.parameters.index(name) for name in self.parameters]

    @property
    def nominal(self) -> Array:
        """Nominal values of the estimated parameters, SI."""
        return self.block.nominal[self._places]

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the estimated parameters."""
        return tuple(self.block.units[place] for place in self._places)


def _rounding_alone(block: Block, jacobian: Array, summed: Array) -> list[int]:
    # Columns of parameters that, changed by as much as they are, change the readings by less than the largest
    # change of another is rounded by, whether that is to be estimated or known: motions that cancel, as of a
    # system that goes sideways, leave that much. And columns whose entries are sums that cancel themselves.
    sizes = block.scales
    lengths = np.linalg.norm(jacobian[:, : len(sizes)], axis=0)
    lost = (lengths * sizes <= FAINT * (lengths * sizes).max(initial=0.0)) & (sizes > 0)
    lost |= (lengths <= CANCELLED * summed) & (summed > 0)
    return np.flatnonzero(lost).tolist()


def _size(block: Block, scaling: Mapping[str, Size], name: str) -> float:
    place = block.parameters.index(name)
    return parse_size(scaling[name], float(block.nominal[place]), block.units[place], "scale")


def scaling_issues(judged: Sequence[tuple[Block, Sequence[str]]], scaling: Scaling) -> Iterator[Issue]:
    """Yield what keeps a scaling from being applied.

    Args:
        judged: blocks, each with the names of its parameters of interest.
        scaling: scaling of the parameters.
    """
    if scaling == "none":
        return
    for block, names in judged:
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
        yield from _scale_issues({name: block for block, names in judged for name in names}, scaling)


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

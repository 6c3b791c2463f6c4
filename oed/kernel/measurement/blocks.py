"""Blocks of readings that are estimated together, and constants eliminated from their information."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.presenting import Brief
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.matrices import harmonic
from oed.kernel.measurement.square_root import reduced


@dataclass(frozen=True)
class Nuisance:
    """A constant that the readings depend on and the study does not ask for; it is eliminated.

    Attributes:
        name: "start.x", "gyroscope.bias", ...
        nominal: value designed for, SI.
        unit: SI unit.
        deviation: standard deviation of its prior, SI; None where there is none.
    """

    name: str
    nominal: float
    unit: str
    deviation: float | None = None


@dataclass(frozen=True, repr=False)
class Block(Brief):
    """Readings estimated together: their information on the parameters, and on nuisances after them.

    Attributes:
        name: "position", "joint", ...
        parameters: the parameters' names.
        nominal: nominal values of the parameters, (p,), SI.
        units: SI units of the parameters ("" for a ratio).
        scales: sizes that relative precisions refer to, (p,), SI; 0 where there are none.
        response: noise-free readings y (rows,).
        jacobian: derivatives by parameters and then nuisances, (rows, p + nuisances), in units of the noise
            where it is not `noise`; its square and the nuisances' prior are the information.
        noise: standard deviation that the information is still to be divided by, None if unknown.
        nuisances: the nuisance parameters.
        design_matrix: W = dy/dp (rows, p) of a regression; None for sensors.
        summed: sums of magnitudes of every parameter's column, (1, p), beside which the column may be
            rounding; 0 where none are stated.
        shared: B where the rows' noise is B'e, e white, and estimation is by ordinary least squares all the
            same; None where the jacobian's rows are independent.
    """

    name: str
    parameters: tuple[str, ...]
    nominal: Array
    units: tuple[str, ...]
    scales: Array
    response: Expression
    jacobian: Expression
    noise: float | None
    nuisances: tuple[Nuisance, ...] = ()
    design_matrix: Expression | None = None
    summed: Expression | None = None
    shared: ca.DM | None = None

    @property
    def raw(self) -> bool:
        """True for regressions, whose noise a criterion without scaling leaves out, as the paper does."""
        return self.design_matrix is not None

    @property
    def magnitudes(self) -> Expression:
        """Sums of magnitudes, (1, p); see `summed`."""
        return ca.DM.zeros(1, len(self.parameters)) if self.summed is None else self.summed

    @property
    def precisions(self) -> Array:
        """Information that priors have on each unknown, (p + nuisances,), SI; 0 for the parameters."""
        deviations = [nuisance.deviation or np.inf for nuisance in self.nuisances]
        return np.array([0.0] * len(self.parameters) + [deviation**-2 for deviation in deviations])

    def places(self, names: Sequence[str]) -> list[int]:
        """Return the columns of these parameters, then of all nuisances."""
        first = len(self.parameters)
        return [*map(self.parameters.index, names), *range(first, first + len(self.nuisances))]

    def information(self, places: Sequence[int]) -> Expression:
        """Return information on the unknowns of some columns, all others known, times the noise squared."""
        columns = self.jacobian[:, list(places)]
        square = columns.T @ columns
        if self.shared is not None:
            spread = self.shared @ columns
            return harmonic(square, spread.T @ spread)
        return square + ca.diag(ca.DM(self.precisions[list(places)])) if self.nuisances else square

    def rows(self, jacobian: Array) -> Array:
        """Return R (k, n) with R'R the information of some columns (rows, n) of the jacobian."""
        if self.shared is None:
            return reduced(jacobian)
        # With W = Q U, and T the triangular factor of B Q, the estimates' covariance
        # (W'W)^-1 (BW)'BW (W'W)^-1 is (T U^-T)'(T U^-T).
        orthonormal, upper = np.linalg.qr(jacobian)
        spread = np.asarray(np.linalg.qr(np.array(self.shared @ orthonormal), mode="r"))
        return np.asarray(np.linalg.solve(spread.T, upper))

    def asking(self, names: Mapping[str, str]) -> Block:
        """Return the block of sensors with some nuisances among its parameters.

        Args:
            names: names of the nuisances, by the names of the parameters that they become.
        """
        labels, count = [nuisance.name for nuisance in self.nuisances], len(self.parameters)
        chosen = [labels.index(label) for label in names.values()]
        rest = [place for place in range(len(labels)) if place not in chosen]
        constants = [self.nuisances[place] for place in chosen]
        nominal = np.array([nuisance.nominal for nuisance in constants])
        return replace(
            self,
            parameters=(*self.parameters, *names),
            nominal=np.concatenate([self.nominal, nominal]),
            units=(*self.units, *(nuisance.unit for nuisance in constants)),
            scales=np.concatenate([self.scales, np.abs(nominal)]),
            jacobian=self.jacobian[:, [*range(count), *(count + place for place in (*chosen, *rest))]],
            nuisances=tuple(self.nuisances[place] for place in rest),
        )


@typed
def regression(
    name: str,
    design_matrix: Expression,
    parameters: Sequence[str],
    nominal: Array,
    *,
    units: Sequence[str],
    noise: float | None,
    jacobian: Expression | None = None,
    summed: Expression | None = None,
    sizes: Array | None = None,
    shared: ca.DM | None = None,
) -> Block:
    """Return the block of a linear regression y = W c + noise; `scaling: none` leaves its noise out.

    Rows are independent and the information is W'W, unless there is another `jacobian` for it, or `shared`.

    Args:
        name: name of the block.
        design_matrix: W, (rows, p).
        parameters: names, p of them.
        nominal: nominal values of the parameters, (p,), SI.
        units: SI units of the parameters.
        noise: standard deviation of a row; None where it is not known.
        jacobian: rows whose square is the information, if that is not W.
        summed: sums of magnitudes of W's columns, (1, p).
        sizes: reference sizes of relative precisions, (p,), SI; the nominal values' magnitudes by default.
        shared: B where the noise is B'e, e white.
    """
    values = np.asarray(nominal, dtype=float)
    return Block(
        name=name,
        parameters=tuple(parameters),
        nominal=values,
        units=tuple(units),
        scales=np.abs(values) if sizes is None else sizes,
        response=design_matrix @ ca.DM(values),
        jacobian=design_matrix if jacobian is None else jacobian,
        noise=noise,
        design_matrix=design_matrix,
        summed=summed,
        shared=shared,
    )

"""Optimality criteria: information matrices to one number, larger is better.

A criterion says two things: its value for given matrices, and how an optimiser maximises it with smooth
constraints. The value alone is ever reported.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.information import Scaling, scaling_text
from oed.kernel.measurement.square_root import SquareRoot


@dataclass(frozen=True)
class Epigraph:
    """A criterion as smooth optimisation: maximise `objective` over `variables` with `equalities` = 0 and
    `floors` >= 0.

    Attributes:
        objective: scalar expression to maximise; equals the criterion's value where it is maximal.
        variables: auxiliary unknowns, (k,).
        equalities: expressions that must vanish, (e,).
        initial: values (k,) of the auxiliary unknowns for given numeric matrices.
        floors: expressions that must not be negative, (f,).
    """

    objective: Expression
    variables: Expression
    equalities: Expression
    initial: Callable[[Sequence[Array]], Array]
    floors: Expression = field(default_factory=lambda: ca.SX(0, 1))


@dataclass(frozen=True)
class Subject:
    """Subject of the matrices that a criterion judges.

    Attributes:
        system: system with the estimated parameters.
        parameters: names of each matrix's rows.
        scales: scales of the parameters, SI, one array for each matrix.
        start: state in which an experiment begins, (states,), SI; all 0 if None.
        period: sample period of the experiment [s]: the longest step of the system.
    """

    system: System
    parameters: tuple[tuple[str, ...], ...]
    scales: tuple[Array, ...]
    start: Array | None = None
    period: float = np.inf


def multipliers_of(dual: Array | None) -> Array | None:
    """Z >= 0 (p, p) of a search's multipliers, which are it but for sign and rounding; None where they say
    nothing.

    Args:
        dual: the multipliers, symmetric, (p, p); None without.
    """
    if dual is None or not np.any(dual) or not np.all(np.isfinite(dual)):
        return None
    values, vectors = np.linalg.eigh(dual)
    values = np.clip(values if values.sum() > 0 else -values, 0.0, None)
    return np.asarray((vectors * values) @ vectors.T)


class Criterion(Component, ABC):
    """A number for how informative a drive is; larger is better.

    Attributes:
        scaling: scaling of the parameters: "relative" to nominal values, "none", or a size for each:
            SI, "1 mm" or "2 %" of the nominal value.
        subset: the parameters of interest; the others are unknown all the same. All of them if None.
    """

    number: ClassVar[str] = ""
    """Short name of the criterion's value; "" where there is none."""
    definition: ClassVar[str] = ""
    """Name of the criterion's value in words."""
    share: ClassVar[str] = ""
    """Meaning of the efficiency, `{size}` the number of parameters; "" where there is none."""
    asks_about: ClassVar[str] = ""
    """Part of the parameters that the criterion looks at, where that is not all of them."""
    conceded: ClassVar[str] = "objective"
    """Quantity of which `concede` takes a share."""
    proportional: ClassVar[bool] = False
    """True if k repetitions of a design give k times its value, and 0 stands for what is not identifiable."""
    conjugate: ClassVar[str] = ""
    """Shape of `trace_bound` as a function of Z: "linear" where a sum of Z bounds no better than one of them,
    "smooth" where it does, with `trace_slope`; "" without a finite bound."""

    typical_error: ClassVar[str] = ""
    """Standard error that is inversely proportional to the root of the efficiency, of several parameters."""

    kind: str
    scaling: Scaling = "relative"
    subset: tuple[str, ...] | None = None

    @abstractmethod
    def value(self, matrices: Sequence[Array]) -> Array:
        """The criterion (...,) of information matrices (..., p, p), one matrix per block."""

    def judge(self, information: Sequence[SquareRoot]) -> Array:
        """The criterion (...,) of information by its square roots, which know what is identifiable."""
        return self.value([root.matrix for root in information])

    def identifiable(self, information: Sequence[SquareRoot]) -> Array:
        """Return where all that the criterion asks about is identifiable, (...): by default every combination
        of parameters.
        """
        return np.asarray(np.all([root.complete for root in information], axis=0))

    @abstractmethod
    def epigraph(self, matrices: Sequence[Expression]) -> Epigraph:
        """The criterion of symbolic matrices in a form an interior-point solver can maximise."""

    @property
    def concave(self) -> bool:
        """True if the criterion of one block is known to be concave: it has a supergradient."""
        return type(self).supergradient is not Criterion.supergradient

    def supergradient(self, matrix: Array, dual: Array | None = None) -> Array | None:
        """G (p, p) with phi(F') <= phi(F) + tr(G (F' - F)) for all information F' on the same parameters, for
        the only block of a concave criterion; None of others [Pukelsheim, Optimal Design of Experiments].

        Args:
            matrix: F, positive definite, (p, p).
            dual: symmetric, (p, p), up to its sign and size: what a search's multipliers say, for criteria
                that have many supergradients where eigenvalues meet.
        """
        return None

    def homogeneous_bound(self, matrix: Array, root: Array, most: float) -> float:
        """The most that the criterion can be where tr(G F') is at most `most`: never more than what the
        supergradient's plane says.

        Args:
            matrix: F, (p, p).
            root: S, (p, p), with S S' = G its supergradient.
            most: upper bound on tr(G F') over all F'.
        """
        return float(self.value([matrix])) + most - float(np.trace(root.T @ matrix @ root))

    def trace_bound(self, multiplier: Array, most: float) -> float:
        """The most that the criterion can be of any F with tr(Z F) at most `most`, by its concave conjugate:
        the same for every multiple of both; infinite where nothing is known.

        Args:
            multiplier: Z >= 0, (p, p).
            most: upper bound on tr(Z F).
        """
        return np.inf

    def trace_slope(self, multiplier: Array, most: float) -> Array | None:
        """The derivative (p, p) of `trace_bound` by Z > 0; None where nothing is known.

        Args:
            multiplier: Z, positive definite, (p, p).
            most: upper bound on tr(Z F), positive.
        """
        return None

    def about(self, subject: Subject) -> Criterion:
        """The criterion for these parameters; itself unless it needs to know them."""
        return self

    def issues(self, subject: Subject) -> list[Issue]:
        """Return what makes this criterion impossible for these parameters; [] if nothing."""
        return []

    @property
    def meaning(self) -> str:
        """Meaning of the value in words."""
        taken = f"the parameters taken {scaling_text(self.scaling)}"
        return f"{self.definition}, {taken}" if self.definition else taken

    def deviation(self, value: float, size: int) -> str:
        """The standard deviation that a design's finite value stands for, of `size` parameters judged, in
        words; "" where it stands for none.
        """
        return ""

    def standard_error(self, names: Sequence[str]) -> str:
        """Return, in words, the standard error that is inversely proportional to the root of the efficiency
        of a design that judges parameters of these names; "" where none is.
        """
        single = f"the standard error of {names[0]}" if len(names) == 1 else ""
        return (single or self.typical_error) if self.typical_error else ""

    def concede(self, value: float, share: float) -> float:
        """The value that remains when only `share` of `value` is asked for."""
        return value - (1.0 - share) * abs(value)

    def scaled(self, value: float, share: float, size: int) -> float:
        """Return the value of information that is larger by a share in every direction.

        Args:
            value: the criterion of the information as it is.
            share: share by which the information is larger.
            size: number of parameters judged.
        """
        return value + share * abs(value)

    def efficiency(self, value: float, best: float, size: int) -> float | None:
        """Return the number of repetitions of the best design that inform as one of this does; `size`
        parameters in all.

        None where repeating a design does not change the criterion.

        Args:
            value: the criterion of a design.
            best: the criterion of the best design.
            size: number of parameters judged.
        """
        return value / best if best > 0 else None

    def change(self, value: float, best: float, size: int) -> float:
        """Return the share by which a value is more than `best`: in efficiency, or else of the number itself.

        Args:
            value: the criterion of a design.
            best: the criterion of another design.
            size: number of parameters judged.
        """
        share = self.efficiency(value, best, size)
        return share - 1.0 if share is not None else (value - best) / (abs(best) or 1.0)


class RootCriterion(Criterion):
    """A criterion that asks what is identifiable, and so looks at square roots of information."""

    def value(self, matrices: Sequence[Array]) -> Array:
        """The criterion (...,) of information matrices (..., p, p), one matrix per block."""
        return self.judge([SquareRoot.of_matrix(np.asarray(matrix)) for matrix in matrices])

    @abstractmethod
    def judge(self, information: Sequence[SquareRoot]) -> Array:
        """The criterion (...,) of information by its square roots, one per block."""


class Factor:
    """A lower triangular unknown L with M = L L', which keeps a matrix M positive semidefinite."""

    def __init__(self, name: str, size: int) -> None:
        """Make the unknowns."""
        self.size = size
        self.matrix = ca.SX.sym(name, ca.Sparsity.lower(size))

    @property
    def variables(self) -> Expression:
        """The entries, column by column."""
        return ca.vertcat(*self.matrix.nonzeros())

    def residuals(self, matrix: Expression) -> Expression:
        """M - L L', the lower half."""
        return ca.vertcat(*ca.tril(matrix - self.matrix @ self.matrix.T).nonzeros())

    def inverse(self, right: Expression) -> Expression:
        """L^-1 B."""
        return ca.solve(self.matrix, right)

    def initial(self, matrix: Array) -> Array:
        """Entries of L for a numeric M; a little is added to one that has no factor."""
        columns, rows = np.triu_indices(self.size)  # column by column, as CasADi stores it
        return np.asarray(np.linalg.cholesky(lifted(matrix))[rows, columns])


def lifted(matrix: Array) -> Array:
    """M, or where it has no factor a little more."""
    shift = 1e-6 * (1.0 + abs(np.trace(matrix)) / len(matrix))
    smallest = np.linalg.eigvalsh(matrix)[0]
    return np.asarray(matrix + max(0.0, shift - smallest) * np.eye(len(matrix)))


def factored(matrices: Sequence[Expression], objective: Callable[[Sequence[Factor]], Expression]) -> Epigraph:
    """Maximise a function of the factors of F_b = L_b L_b'."""
    factors = [Factor("L", matrix.shape[0]) for matrix in matrices]
    residuals = [factor.residuals(matrix) for factor, matrix in zip(factors, matrices, strict=True)]
    variables = ca.vertcat(*(factor.variables for factor in factors))

    def initial(numeric: Sequence[Array]) -> Array:
        return np.concatenate(
            [factor.initial(matrix) for factor, matrix in zip(factors, numeric, strict=True)]
        )

    return Epigraph(objective(factors), variables, ca.vertcat(*residuals), initial)

"""Prior knowledge of unknowns, and what it adds to what readings say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oed.kernel.measurement.square_root import SquareRoot

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Knowledge:
    """A prior of the unknowns: information (q, q) about `centre` (q,), SI."""

    information: Array
    centre: Array

    @classmethod
    def nothing(cls, size: int) -> Knowledge:
        """Of as many unknowns."""
        return cls(np.zeros((size, size)), np.zeros(size))

    def on(self, columns: Indices) -> Knowledge:
        """That of some of the unknowns, the others held where they are known to be."""
        return Knowledge(self.information[np.ix_(columns, columns)], self.centre[columns])

    def score(self, values: Array) -> Array:
        """Half the slope of what it adds to the misfit, downhill, (q,)."""
        return np.asarray(self.information @ (self.centre - values))

    def misfit(self, values: Array) -> float:
        """What it adds to the sum of squares."""
        off = self.centre - values
        return float(off @ self.information @ off)


def inverse_of_identifiable(matrix: Array) -> Array:
    """The inverse of information (..., q, q) on what is identifiable; 0 in other directions."""
    factor = SquareRoot.of_matrix(matrix).factor
    return np.asarray(factor @ np.swapaxes(factor, -1, -2))


def inverse_of_sum(information: Array, known: Array) -> Array:
    """(F + K)^-1 of information F and knowledge from before K, both (q, q).

    In units of K nothing is too small to be inverted, however much larger F is on the rest.
    """
    try:
        root = np.linalg.inv(np.linalg.cholesky(known))
    except np.linalg.LinAlgError:
        return inverse_of_identifiable(information + known)
    eigenvalues, vectors = np.linalg.eigh(root @ information @ root.T)
    back = root.T @ vectors
    return np.asarray(back / (1 + np.clip(eigenvalues, 0.0, None)) @ back.T)

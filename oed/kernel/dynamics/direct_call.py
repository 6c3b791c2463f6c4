"""Calls of CasADi's functions on NumPy's own memory."""

from __future__ import annotations

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array


class DirectCall:
    """A function of dense arguments that gives its results as one flat array each.

    CasADi's numbers stand column by column: here columns are rows. They are read and written where they are,
    for handing them over one by one takes longer than most functions themselves.
    """

    def __init__(self, function: ca.Function) -> None:
        """Of a function whose results are dense."""
        self._function = function
        self._buffer, self._evaluate = function.buffer()
        self._given = [function.nnz_in(place) for place in range(function.n_in())]
        self._found = [function.nnz_out(place) for place in range(function.n_out())]
        assert self._found == [function.numel_out(place) for place in range(function.n_out())]

    def __reduce__(self) -> tuple[type[DirectCall], tuple[ca.Function]]:
        """As it is made: its memory is its own."""
        return DirectCall, (self._function,)

    def __call__(self, *arguments: Array) -> list[Array]:
        """The results at these arguments."""
        given = [np.ascontiguousarray(one, dtype=float).ravel() for one in arguments]
        assert [one.size for one in given] == self._given
        found = [np.empty(size) for size in self._found]
        for place, one in enumerate(given):
            self._buffer.set_arg(place, one.data)
        for place, one in enumerate(found):
            self._buffer.set_res(place, one.data)
        self._evaluate()
        return found


def direct_call(function: ca.Function, *arguments: Array) -> list[Array]:
    """A function's results, one flat array each, of dense arguments whose rows are CasADi's columns."""
    return DirectCall(function)(*arguments)

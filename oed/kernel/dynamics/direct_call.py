"""Calls of CasADi's functions on NumPy's own memory."""

from __future__ import annotations

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array


def direct_call(function: ca.Function, *arguments: Array) -> list[Array]:
    """A function's results, one flat array each, of dense arguments whose rows are CasADi's columns.

    CasADi's numbers stand column by column: here columns are rows. They are read and written where they are,
    for handing them over one by one takes longer than most functions themselves.
    """
    buffer, call = function.buffer()
    given = [np.ascontiguousarray(one, dtype=float).ravel() for one in arguments]
    found = [np.empty(function.nnz_out(index)) for index in range(function.n_out())]
    for index, one in enumerate(given):
        assert len(one) == function.nnz_in(index)
        buffer.set_arg(index, one.data)
    for index, one in enumerate(found):
        assert len(one) == function.numel_out(index)
        buffer.set_res(index, one.data)
    call()
    return found

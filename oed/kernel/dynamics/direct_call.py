"""Calls of CasADi's functions on NumPy's own memory."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.compiled import Compilation, is_compiled
from oed.kernel.dynamics.expression import Expression

PAYS = 0.3
"""Time [s] that calls of a function have taken by which a compiler is let at it: what was called for so long
is called on.
"""
MOST = 30_000
"""Operations of a function that is compiled: for longer ones a compiler takes longer than they spare."""


class DirectCall:
    """A function of dense arguments that gives its results as one flat array each; in machine code, which
    changes no number, as soon as it has been called for long and a compiler has made that.

    CasADi's numbers stand column by column: here columns are rows. They are read and written where they are,
    for handing them over one by one takes longer than most functions themselves.
    """

    def __init__(self, function: ca.Function, *, lasting: bool = True) -> None:
        """Wrap a function whose results are dense; one that is called once only is not `lasting`."""
        self._function = function
        self._spent = 0.0 if lasting else -np.inf
        self._compilation: Compilation | None = None
        self._take(function)

    def _take(self, function: ca.Function) -> None:
        self._buffer, self._evaluate = function.buffer()
        self._given = [function.nnz_in(place) for place in range(function.n_in())]
        self._found = [function.nnz_out(place) for place in range(function.n_out())]
        assert self._found == [function.numel_out(place) for place in range(function.n_out())]

    def __reduce__(self) -> tuple[Callable[[str], DirectCall], tuple[str]]:
        """Pickle the function alone: each process has one call with memory of its own, called for long."""
        return _shared, (self._function.serialize(),)

    def __call__(self, *arguments: Array) -> list[Array]:
        """The results at these arguments."""
        buffers = [np.ascontiguousarray(argument, dtype=float).ravel() for argument in arguments]
        assert [buffer.size for buffer in buffers] == self._given
        results = [np.empty(size) for size in self._found]
        for place, buffer in enumerate(buffers):
            self._buffer.set_arg(place, buffer.data)
        for place, buffer in enumerate(results):
            self._buffer.set_res(place, buffer.data)
        began = time.perf_counter()
        self._evaluate()
        self._spent += time.perf_counter() - began
        if self._spent > PAYS:
            self._compile()
        return results

    def _compile(self) -> None:
        # Begins it, and takes what has come of it.
        if self._compilation is None and _worth(self._function):
            self._compilation = Compilation(self._function)
        function = None if self._compilation is None else self._compilation.function()
        if function is not None:
            self._take(function)
        if self._compilation is None or self._compilation.ended:
            self._spent = -np.inf


@lru_cache(maxsize=64)
def _shared(serialized: str) -> DirectCall:
    return DirectCall(ca.Function.deserialize(serialized))


def _worth(function: ca.Function) -> bool:
    # Whether compiling it pays: of few operations, counted once wherever it calls them, none compiled before.
    every = [function, *function.find_functions()]
    if function.is_a("Map") and len(every) == 1:
        # Before CasADi 3.8.1 a map finds none of the functions in it.
        inner = function.info()["f"]
        every += [inner, *inner.find_functions()]
    plain = [inner for inner in every if inner.is_a("SXFunction") or inner.is_a("MXFunction")]
    return not any(map(is_compiled, every)) and sum(inner.n_instructions() for inner in plain) <= MOST


@lru_cache(maxsize=64)
def mapped(function: ca.Function, count: int, *common: int) -> DirectCall:
    """A function of many arguments side by side, but for those at the places `common`, which all share.

    Args:
        function: function with dense results.
        count: number of arguments side by side.
        common: places of arguments.
    """
    # A map of one function that is zero everywhere is not dense.
    return DirectCall(function if count == 1 else function.map("mapped", "serial", count, list(common), []))


def direct_call(function: ca.Function, *arguments: Array) -> list[Array]:
    """A function's results, one flat array each, of dense arguments whose rows are CasADi's columns."""
    # Called once, it is not worth a compiler.
    return DirectCall(function, lasting=False)(*arguments)


class GroupedFunction:
    """A function whose outputs come in groups."""

    def __init__(
        self, name: str, arguments: Sequence[Expression], groups: Sequence[Sequence[Expression]]
    ) -> None:
        """Make it.

        Args:
            name: name of the function.
            arguments: symbols of the arguments.
            groups: groups of output expressions.
        """
        self._edges = np.cumsum([0, *map(len, groups)])
        outputs = [ca.densify(output) for group in groups for output in group]
        self._function = ca.Function(name, list(arguments), outputs)

    def values(self, *arguments: Array) -> list[list[Array]]:
        """Return the groups of outputs at arguments whose rows are the function's columns."""
        results = direct_call(self._function, *arguments)
        arrays = [
            result.reshape(self._function.size_out(place), order="F") for place, result in enumerate(results)
        ]
        return [arrays[first:last] for first, last in pairwise(self._edges)]

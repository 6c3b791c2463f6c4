"""Functions of arrays as CasADi's, for programs that are written with both."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array


class ArrayFunction(ca.Callback):  # type: ignore[misc]
    """A function of dense columns whose results are given by their entries, column by column.

    It has no derivatives. Whoever uses it in expressions has to keep it.
    """

    def __init__(
        self,
        name: str,
        sizes: Sequence[int],
        patterns: Sequence[ca.Sparsity],
        function: Callable[..., Sequence[Array]],
    ) -> None:
        """Make it.

        Args:
            name: of the function.
            sizes: of its arguments.
            patterns: of its results.
            function: from arrays (size,) to entries of every result.
        """
        ca.Callback.__init__(self)
        self._sizes, self._patterns, self._function = list(sizes), list(patterns), function
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Return the number of arguments."""
        return len(self._sizes)

    def get_n_out(self) -> int:
        """Return the number of results."""
        return len(self._patterns)

    def get_sparsity_in(self, place: int) -> ca.Sparsity:
        """Return the pattern of an argument."""
        return ca.Sparsity.dense(self._sizes[place], 1)

    def get_sparsity_out(self, place: int) -> ca.Sparsity:
        """Return the pattern of a result."""
        return self._patterns[place]

    def has_eval_buffer(self) -> bool:
        """Return that arguments and results are handed over as memory."""
        return True

    def eval_buffer(
        self, arguments: Sequence[memoryview | None], results: Sequence[memoryview | None]
    ) -> int:
        """Evaluate the function; an absent argument is zero, an absent result is not asked for.

        Args:
            arguments: memory of every argument.
            results: memory for every result.
        """
        values = [
            np.zeros(size) if memory is None else np.frombuffer(memory, float)
            for memory, size in zip(arguments, self._sizes, strict=True)
        ]
        for memory, entries in zip(results, self._function(*values), strict=True):
            if memory is not None:
                np.frombuffer(memory, float)[:] = entries
        return 0

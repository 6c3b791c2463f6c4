"""Terms that are written as expressions: their functions, in machine code where it pays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.compiled import Making, is_compiled, taken
from oed.kernel.dynamics.direct_call import direct_call
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.base import Functions, Terms
from oed.optimize.terms.begun import Begun, Weighted

COMPILING = 2e-4
"""Time [s] that a compiler takes for one operation written out."""
DIFFERENTIATED = 12
"""How many times as long it takes with first and second derivatives."""
LARGEST = 10_000
"""Operations from which neither is begun: the source of 50,000 has 110 MB, takes 10 s to be written, and a
compiler 7 GB of memory.
"""
LEAST = 1.0
"""Time [s] to be spared from which it is worth finding out what the source is."""
FUNCTIONS = ("terms", "slopes", "curvature")


LOOKING = 1e-4
"""Time [s] per operation written out; only a search that may spare more looks for code compiled earlier.

Such code is known by its source, and to write that takes a tenth of this time.
"""


class Swept(ABC):
    """The terms at z as expressions (MX).

    Attributes:
        z: the unknowns.
        entries: of the matrices (their upper halves, stacked).
        rows: of limits, (rows,).
        entry_slopes: derivatives of the entries by z, dense.
        row_slopes: those of the rows, sparse.
    """

    z: Expression

    @property
    @abstractmethod
    def entries(self) -> Expression:
        """The matrices' entries."""

    @property
    @abstractmethod
    def rows(self) -> Expression:
        """The limits' rows."""

    @property
    @abstractmethod
    def entry_slopes(self) -> Expression:
        """Derivatives of the entries by z."""

    @property
    @abstractmethod
    def row_slopes(self) -> Expression:
        """Derivatives of the rows by z."""

    @abstractmethod
    def begun(self, samples: Expression) -> Begun:
        """What is known at the begins of some samples (1, K), counted through all runs."""

    @abstractmethod
    def curvature(self, entries: Expression, rows: Expression, begun: Sequence[Weighted]) -> Expression:
        """Second derivatives (size, size) by z of the weighted sum of entries, rows and what has begun."""


def _functions_of(terms: WrittenTerms, count: int) -> Functions:
    sweep, slots = terms.sweep(), terms.slots(count)
    given, rows, slopes = [sweep.z], sweep.rows, sweep.row_slopes
    weights = [ca.MX.sym("entries", terms.entry_count), ca.MX.sym("rows", rows.shape[0] + count)]
    fixed, own = ca.vertsplit(weights[1], [0, rows.shape[0], weights[1].shape[0]])
    weighted, more = list[Weighted](), ca.MX(terms.size, terms.size)
    if count:
        numbers = ca.MX.sym("numbers", slots.width)
        begun = sweep.begun(slots.split(numbers)[0])
        around = slots.around(sweep.z, begun, numbers, terms.size)
        given.append(numbers)
        rows, slopes = ca.vertcat(rows, around.values), ca.vertcat(slopes, around.slopes)
        one, more = around.curvature(own)
        weighted.append(one)
    curvature = ca.triu(sweep.curvature(weights[0], fixed, weighted) + more)
    return Functions(
        ca.Function(FUNCTIONS[0], given, [sweep.entries, rows]),
        ca.Function(FUNCTIONS[1], given, [sweep.entry_slopes, slopes]),
        ca.Function(FUNCTIONS[2], [*given, *weights], [curvature]),
    )


class WrittenTerms(Terms):
    """Terms whose functions are written out."""

    @abstractmethod
    def sweep(self) -> Swept:
        """The terms at z as expressions."""

    @property
    @abstractmethod
    def scores(self) -> ca.Function:
        """Z -> entries of the matrices, and the most by which every limit is exceeded at the points looked
        at, over its size; below 0 where it is not.
        """

    @cached_property
    def _functions(self) -> dict[int, Functions]:
        return {}

    @cached_property
    def _binaries(self) -> dict[int, Path | None]:
        return {}

    @cached_property
    def _making(self) -> dict[int, Making]:
        return {}

    def functions(self, slots: int = 0) -> Functions:
        """The terms' functions, with so many slots: in machine code as soon as a compiler has made that,
        which changes none of the numbers.
        """
        if slots not in self._functions:
            self._functions[slots] = _functions_of(self, slots)
        if slots in self._making and (found := self._making[slots].functions()) is not None:
            self._functions[slots] = Functions(*found)
            # Kept in `_binaries`, for other processes.
            del self._making[slots]
        return self._functions[slots]

    def compile(self, slots: int, *, spared: float = np.inf) -> Path | None:
        """Let a compiler begin to make machine code of them, where there is one; where it will be.

        Args:
            slots: how many.
            spared: time [s] that this would spare; where compiling takes longer, only what was compiled
                before is taken.
        """
        if spared < LEAST or self.written > LARGEST:
            return None
        anew = spared >= DIFFERENTIATED * COMPILING * self.written
        functions, known = self.functions(slots), self._making.get(slots)
        # What only looked for the code of others may be begun after all.
        if not is_compiled(functions.values) and (known is None or (anew and not known.anew)):
            self._making[slots] = Making(list(vars(functions).values()), anew=anew)
            self._binaries[slots] = self._making[slots].binary
        return self._binaries.get(slots)

    @property
    def compiling(self) -> bool:
        """Whether a compiler is at work."""
        return any(not making.ended for making in self._making.values())

    def compiled(self) -> None:
        """Wait until the compiler has ended."""
        for making in self._making.values():
            making.wait()

    def take(self, slots: int, binary: Path) -> None:
        """Use what another process has compiled, if it is there already."""
        if slots not in self._functions or not is_compiled(self._functions[slots].values):
            found = taken(binary, FUNCTIONS)
            if found is not None:
                self._functions[slots] = Functions(*found)

    @cached_property
    def _scores(self) -> ca.Function:
        return self.scores

    def compile_scores(self, spared: float = np.inf) -> Path | None:
        """Let generated C score candidates, where there is a compiler; the numbers stay the same.

        Returns the library; None where there is none.

        Args:
            spared: time [s] that compiled code would spare. Where the compiler takes longer, it is given up,
                or not begun; code compiled earlier is taken if finding it takes little of that time.
        """
        anew = spared >= COMPILING * self.written
        if not anew and spared < LOOKING * self.written:
            return None
        making = Making([self.scores], anew=anew)
        making.wait(spared)
        if making.binary is None or not self.take_scores(making.binary):
            return None
        return making.binary

    def take_scores(self, binary: Path) -> bool:
        """Let compiled code score candidates; False where the file is missing.

        Args:
            binary: a file.
        """
        functions = taken(binary, [self.scores.name()])
        if functions is not None:
            (self._scores,) = functions
        return functions is not None

    def scored(self, candidates: Array, threads: int = 1) -> tuple[Array, Array]:
        """Entries of candidates, and by how much they exceed each limit.

        Args:
            candidates: unknowns, (K, size).
            threads: that share the work; their number changes no digit.
        """
        count = len(candidates)
        several = ("thread", min(threads, count)) if min(threads, count) > 1 else ()
        entries, excess = direct_call(self._scores.map(count, *several), candidates)
        return entries.reshape(count, -1), excess.reshape(count, -1)

"""How sensitivities go through a part of a drive, and how information is written by its whole run instead.

A part of a drive gathers its information on (parameters, its own start, nuisances). With sensitivities S of
that start by (parameters, the run's start) it becomes information on what the whole run is estimated from.

Under process noise a part is a filter that begins where the state is known: its start has, in the whole run,
a covariance P as well, of which the readings before have left something [Sarkka and Garcia-Fernandez,
"Temporal parallelization of Bayesian smoothers", IEEE Trans. Automatic Control 66, 2021].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.matrices import posterior
from oed.optimize.terms.matrices import symmetric, upper_half

Step = Callable[[Expression, Expression], tuple[Expression, Expression, Expression]]
"""From S and P at a part's start to both at its end, and the information that it adds."""


class Carry:
    """Sensitivities S of a part's start that are handed on along a drive, under process noise by nuisances as
    well, and then the start's covariance P; by the entries that change.

    Attributes:
        moving: those entries' places among all of S, by columns, and of P's upper half.
        begin: their values at the start of a run.
        carried: symbols for them at the part's start.
        following: the same entries at its end, as expressions of what the part gathers.
        added: entries of the information that it adds.
    """

    def __init__(
        self,
        gathered: Expression,
        *,
        states: int,
        parameters: int,
        nuisances: int,
        drifting: bool = False,
        remembered: int = 0,
        step: Step | None = None,
    ) -> None:
        """Follow S, and P, through a part.

        Args:
            gathered: sensitivities of its end by (parameters, its start), by columns, under process noise by
                nuisances too and the upper half of its end's covariance; then its information's entries.
            states: of the robot.
            parameters: how many are estimated; 0 for regressions, which carry no sensitivities.
            nuisances: the sensors' own.
            drifting: whether there is process noise.
            remembered: states besides, that a filter remembers: S and P have rows for these, and S has their
                values in a column of its own behind the others.
            step: how S and P go through it, where not as what it gathers says.
        """
        self._gathered, self._states, self._drifting = gathered, states, drifting
        self._parameters, self._nuisances = parameters, nuisances
        # Constants of sensors alone may be estimated.
        self._sensed = parameters > 0 or nuisances > 0
        more = nuisances if drifting else 0
        columns = parameters + states + more if self._sensed else 0
        begin = ca.DM(states, columns)
        if self._sensed:
            begin = ca.horzcat(ca.DM(states, parameters), ca.DM.eye(states), ca.DM(states, more))
        rows, values = states + remembered, 1 if remembered else 0
        begin = ca.vertcat(ca.horzcat(begin, ca.DM(states, values)), ca.DM(remembered, columns + values))
        spread = rows * (rows + 1) // 2 if drifting else 0
        self._start = ca.vertcat(ca.vec(ca.densify(begin)), ca.DM.zeros(spread))
        self._shape = (rows, columns + values)
        self._columns = columns
        self._step = step or self._composed
        self.moving: list[int] = []
        if self._sensed:
            self.moving = moving_entries(
                self._start, lambda whole: self._handed(*self._step(*self._parts(whole))[:2])
            )
        self.begin = self._start[self.moving]
        self.carried = ca.SX.sym("carried", len(self.moving))
        self.following, self.added = self._followed(self.carried)

    @property
    def gathered_size(self) -> int:
        """Size of the information that a part gathers."""
        return self._parameters + self._states + self._nuisances

    def whole(self, carried: Expression) -> Expression:
        """All that is handed on, S by columns and P's upper half, of the entries that change."""
        return with_entries(self._start, self.moving, carried)

    @property
    def belief(self) -> tuple[Expression, Expression]:
        """S and P of the symbols."""
        return self._parts(self.whole(self.carried))

    def entries(
        self, table: Expression, spread: Expression, added: Expression
    ) -> tuple[Expression, Expression]:
        """The entries of S and P that change, and those of information.

        Args:
            table: S.
            spread: P.
            added: information.
        """
        # None at all is a column, too.
        handed = self._handed(table, spread)[self.moving] if self.moving else ca.SX(0, 1)
        return handed, ca.densify(upper_half(ca.densify(added)))

    def at_end(self, information: Expression, carried: Expression) -> Expression:
        """Entries of information on (parameters, a run's last state, nuisances), written by the run's start.

        Args:
            information: a matrix.
            carried: the entries of S and P that change, there; what a filter remembers no longer matters.
        """
        table, spread = self._parts(self.whole(carried))
        states = slice(0, self._states)
        states_spread = spread[states, states] if self._drifting else spread
        turned, *_ = self._turned(information, table[states, : self._columns], states_spread)
        return upper_half(ca.densify(turned))

    def _parts(self, whole: Expression) -> tuple[Expression, Expression]:
        # S and P.
        count = self._shape[0] * self._shape[1]
        table = ca.reshape(whole[:count], *self._shape)
        return table, symmetric(whole[count:], self._shape[0]) if self._drifting else ca.SX(0, 0)

    def _turned(
        self, information: Expression, table: Expression, spread: Expression
    ) -> tuple[Expression, Expression, Expression]:
        # The information, and what of S and P is left when the part has been read.
        count, states = self._parameters, self._states
        lasting = table.shape[1] - (self._nuisances if self._drifting else 0)
        top = ca.horzcat(ca.SX.eye(count), ca.SX(count, table.shape[1] - count))
        if not self._drifting:
            turning = ca.diagcat(ca.sparsify(ca.vertcat(top, table)), ca.SX.eye(self._nuisances))
            return turning.T @ information @ turning, table, spread
        constants = ca.horzcat(ca.SX(self._nuisances, lasting), ca.SX.eye(self._nuisances))
        turning = ca.sparsify(ca.vertcat(top, table, constants))
        by_columns = information @ turning
        start = slice(count, count + states)
        remainder = posterior(spread, information[start, start])
        total = turning.T @ by_columns - by_columns[start, :].T @ remainder @ by_columns[start, :]
        return total, table - remainder @ by_columns[start, :], remainder

    def _followed(self, carried: Expression) -> tuple[Expression, Expression]:
        # What is handed on at the end, and what the part adds to the information.
        if not self._sensed:
            return ca.SX(0, 1), ca.densify(self._gathered)
        return self.entries(*self._step(*self._parts(self.whole(carried))))

    def _handed(self, table: Expression, spread: Expression) -> Expression:
        # All entries of S and P.
        handed = ca.vec(ca.densify(table))
        return ca.vertcat(handed, upper_half(ca.densify(spread))) if self._drifting else handed

    def _composed(self, table: Expression, spread: Expression) -> tuple[Expression, Expression, Expression]:
        # By what the part gathers.
        count, states = self._parameters, self._states
        columns = count + states + (self._nuisances if self._drifting else 0)
        split = states * columns
        ends = ca.sparsify(ca.reshape(self._gathered[:split], states, columns))
        spread_entries = states * (states + 1) // 2 if self._drifting else 0
        gathered = symmetric(self._gathered[split + spread_entries :], self.gathered_size)
        added, table, spread = self._turned(gathered, table, spread)
        onward, rest = ends[:, count : count + states], ends[:, count + states :]
        zeros = ca.SX(states, table.shape[1] - count - rest.shape[1])
        following = onward @ ca.sparsify(table) + ca.horzcat(ends[:, :count], zeros, rest)
        if self._drifting:
            spread = (
                symmetric(self._gathered[split : split + spread_entries], states) + onward @ spread @ onward.T
            )
        return following, spread, added


def with_entries(begin: ca.DM, places: Sequence[int], entries: Expression) -> Expression:
    """Return a column of constants with other entries at some places.

    Args:
        begin: constants, (n,).
        places: places of the other entries, (k,).
        entries: these entries (SX), (k,).
    """
    whole = ca.SX(begin)
    if places:
        whole[list(places)] = entries
    return whole


def moving_entries(begin: ca.DM, step: Callable[[Expression], Expression]) -> list[int]:
    """Return the places of entries that anywhere along a run differ from those where it begins.

    Args:
        begin: entries where a run begins, (n,).
        step: function from the entries at a sample's begin to those at its end (SX).
    """
    places = list[int]()
    while True:
        entries = step(with_entries(begin, places, ca.SX.sym("carried", len(places))))
        stays = [
            entry.is_constant() and float(entry) == float(begin[place])
            for place, entry in enumerate(ca.vertsplit(entries))
        ]
        moving = [place for place in range(len(stays)) if not stays[place] or place in places]
        if moving == places:
            return places
        places = moving

"""How sensitivities go through a part of a drive, and how information is written by its whole run instead.

A part of a drive gathers its information on (parameters, its own start, nuisances). With sensitivities S of
that start by (parameters, the run's start) it becomes information on what the whole run is estimated from.
"""

from __future__ import annotations

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.base import symmetric, upper_half


class Carry:
    """The sensitivities S of a part's start, by the entries of S that change along a drive.

    Attributes:
        moving: those entries' places among all of S, by columns.
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
        started: bool,
    ) -> None:
        """Follow S through a part.

        Args:
            gathered: sensitivities of its end by (parameters, its start), by columns, then its information's
                entries.
            states: of the robot.
            parameters: how many are estimated; 0 for regressions, which carry no sensitivities.
            nuisances: the sensors' own.
            started: whether the runs' starts are estimated as well.
        """
        self._gathered, self._states = gathered, states
        self._parameters, self._nuisances = parameters, nuisances
        columns = parameters + (states if started else 0) if parameters else 0
        begin = ca.horzcat(ca.DM(states, parameters), ca.DM.eye(states))[:, :columns]
        self._start = ca.vec(ca.densify(begin))
        self._shape = (states, columns)
        self.moving: list[int] = []
        if parameters:
            self._find_moving()
        self.begin = self._start[self.moving]
        self.carried = ca.SX.sym("carried", len(self.moving))
        following, added = self._step(self.table(self.carried))
        self.following, self.added = ca.vec(following)[self.moving], ca.densify(added)

    @property
    def gathered_size(self) -> int:
        """Size of the information that a part gathers."""
        return self._parameters + self._states + self._nuisances

    def table(self, carried: Expression) -> Expression:
        """S of its entries that change."""
        table = ca.SX(self._start)
        if self.moving:
            table[self.moving] = carried
        return ca.reshape(table, *self._shape)

    def turned(self, information: Expression, table: Expression) -> Expression:
        """Entries of information on (parameters, start, nuisances), written by the whole run's start."""
        count = self._parameters
        top = ca.horzcat(ca.SX.eye(count), ca.SX(count, table.shape[1] - count))
        whole = ca.diagcat(ca.sparsify(ca.vertcat(top, table)), ca.SX.eye(self._nuisances))
        return upper_half(ca.densify(whole.T @ information @ whole))

    def _step(self, table: Expression) -> tuple[Expression, Expression]:
        # S at the end, and what the part adds to the information.
        count, states = self._parameters, self._states
        if not count:
            return ca.SX(0, 1), self._gathered
        split = states * (count + states)
        ends = ca.sparsify(ca.reshape(self._gathered[:split], states, count + states))
        direct = ca.horzcat(ends[:, :count], ca.SX(states, table.shape[1] - count))
        following = ca.densify(ends[:, count:] @ ca.sparsify(table) + direct)
        gathered = symmetric(self._gathered[split:], self.gathered_size)
        return following, self.turned(gathered, table)

    def _find_moving(self) -> None:
        # Entries of S that anywhere differ from those at a run's start, found by following them.
        while True:
            following, _ = self._step(self.table(ca.SX.sym("carried", len(self.moving))))
            entries = ca.vec(following)
            found = {place for place in range(entries.numel()) if not self._stays(place, entries[place])}
            if found <= set(self.moving):
                return
            self.moving = sorted(found | set(self.moving))

    def _stays(self, place: int, entry: Expression) -> bool:
        return bool(entry.is_constant()) and float(entry) == float(self._start[place])

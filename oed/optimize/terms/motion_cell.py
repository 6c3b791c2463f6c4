"""One sample of a system's motion: its state, and sensitivities of the state; it adds no information."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System, carrier, stepper
from oed.optimize.terms.carry import moving_entries, with_entries
from oed.optimize.terms.cell import Cell


class MotionCell(Cell):
    """A sample of a system's motion; x is its state and the entries that change of its sensitivities.

    Attributes:
        entries: places of these among all sensitivities by (parameters, start of the run), column by column.
    """

    def __init__(
        self,
        system: System,
        period: float,
        scale: Array,
        *,
        columns: Sequence[int] = (),
        varied: bool = False,
    ) -> None:
        """Write the sample.

        Args:
            system: system that is driven.
            period: sample period [s].
            scale: what an input of 1 stands for, (inputs,).
            columns: columns of the sensitivities that are followed.
            varied: parameters are the constants; else they are nominal.
        """
        states, size = len(system.states), len(system.parameters)
        state, inputs = ca.SX.sym("state", states), ca.SX.sym("inputs", len(system.inputs))
        constants = ca.SX.sym("p", size if varied else 0)
        parameters = constants if varied else ca.SX(ca.DM(system.nominal))
        held = ca.DM(scale) * inputs
        begin = ca.vec(ca.densify(ca.horzcat(ca.DM(states, size), ca.DM.eye(states))))
        followed = [states * column + row for column in columns for row in range(states)]

        def step(table: Expression) -> Expression:
            before = ca.reshape(table, states, size + states)
            after = ca.vec(carrier(system)(before, state, held, parameters, period))
            return with_entries(begin, followed, after[followed])

        self._begin = begin
        self.entries = moving_entries(begin, step) if columns else []
        carried = ca.SX.sym("carried", len(self.entries))
        after = step(self.sensitivities(carried))[self.entries] if self.entries else ca.SX(0, 1)
        following = stepper(system)(state, held, parameters, period)
        super().__init__(
            [ca.vertcat(state, carried), inputs, constants],
            [ca.vertcat(following, after), ca.SX(0, 1)],
            states=states,
            begin=np.array(begin, dtype=float).ravel()[self.entries],
        )

    def sensitivities(self, carried: Expression) -> Expression:
        """Return all sensitivities, column by column, of the entries that change (SX)."""
        return with_entries(self._begin, self.entries, carried)

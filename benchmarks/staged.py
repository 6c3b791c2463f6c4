"""The program in stages as solvers take it: unrolled, or with one function mapped to all stages."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.forms import SEGMENTS
from benchmarks.plain import OPTIONS, Plain
from benchmarks.stages import STATES, Stages
from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.expression import Expression

IPOPT = {name: value for name, value in OPTIONS.items() if name != "detect_simple_bounds"}
FATROP: dict[str, Any] = {"print_time": False, "error_on_fail": False, "structure_detection": "manual"}
GIVEN: dict[str, Any] = {"no_nlp_grad": True, "calc_lam_p": False}
"""Options where derivatives are given: those by parameters, of which there are none, are not asked for."""


class Staged:
    """A program in stages, of these parts."""

    def __init__(self, stages: Stages) -> None:
        """Say where every row stands."""
        self.stages, self.layout = stages, stages.layout
        states = self.layout.states
        self.handed = STATES + self.layout.entries
        self.sides = (stages.stage.size1_out(0) - self.handed) // stages.slots
        own = [
            len(rates.lower) + self.sides * len(instants)
            for rates, instants in zip(stages.rates, stages.instants, strict=True)
        ]
        self.own = [*own, stages.criterion.equalities.shape[0]]
        self.begins = [0, *np.cumsum([states[k + 1] + own[k] for k in range(SEGMENTS)]).tolist()]
        self.count = self.begins[-1] + self.own[-1]
        self._pose = np.array(stages.problem.fixed_starts).ravel()
        table = stages.sampling.reshape(SEGMENTS, stages.samples, -1)
        self.splines = [
            np.pad(own[:, places], ((0, 0), (0, self.layout.width - len(places))))
            for own, places in zip(table, self.layout.windows, strict=True)
        ]
        self.chosen = [np.eye(stages.samples)[self._filled(own) - 1] for own in stages.instants]

    def _filled(self, instants: Places) -> Places:
        # Slots that are left over look at the last sample, and nobody asks what they see.
        return np.append(instants, np.full(self.stages.slots - len(instants), self.stages.samples))

    def _start(self, unknowns: Array) -> Array:
        # The poses and the information of the drive that the coefficients give.
        layout, free = self.layout, self.stages.problem.design.free_rows
        table = np.zeros((free[-1] + 1, 2))
        table[free] = unknowns.reshape(2, -1).T
        found, pose, entries = np.zeros(layout.size), self._pose, np.zeros(layout.entries)
        for k, window in enumerate(layout.windows):
            found[layout.window(k)] = table[window].ravel()
            if k:
                found[layout.pose(k)], found[layout.information(k)] = pose, entries
            padded = np.zeros((layout.width, 2))
            padded[: len(window)] = table[window]
            following = np.array(self.stages.stage(pose, padded.ravel(), self.splines[k], self.chosen[k]))
            pose, entries = following[:STATES, 0], entries + following[STATES : self.handed, 0]
        found[layout.pose(SEGMENTS)], found[layout.information(SEGMENTS)] = pose, entries
        size = int(self.stages.upper[0].max()) + 1
        matrix = np.zeros((size, size))
        matrix[self.stages.upper] = entries
        matrix = matrix + np.triu(matrix, 1).T
        found[-layout.auxiliary :] = self.stages.criterion.initial([matrix])
        return found

    def unrolled(self) -> dict[str, ca.SX]:
        """The program in SX, which CasADi differentiates as it stands."""
        x = ca.SX.sym("x", self.layout.size)
        following = ca.horzcat(
            *(
                self.stages.stage(self.begun(x, k), self.padded(x, k), *self._constants(k))
                for k in range(SEGMENTS)
            )
        )
        return {"x": x, "f": self.cost(x), "g": ca.densify(self.all_rows(x, following))}

    def _constants(self, k: int) -> tuple[ca.DM, ca.DM]:
        return ca.sparsify(ca.DM(self.splines[k])), ca.sparsify(ca.DM(self.chosen[k]))

    def padded(self, x: Expression, k: int) -> Expression:
        """A stage's window, and zeros in place of what a wider one has more."""
        window = x[self.layout.window(k).tolist()]
        return ca.vertcat(window, ca.DM.zeros(2 * self.layout.width - window.shape[0]))

    def begun(self, x: Expression, k: int) -> Expression:
        """The pose that a stage begins with."""
        return x[self.layout.pose(k).tolist()] if k else type(x)(ca.DM(self._pose))

    def all_rows(self, x: Expression, following: Expression) -> Expression:
        """Stage by stage what is handed on and the stage's own rows, then those of the criterion.

        Args:
            x: all unknowns.
            following: what the stages' function says, (q, P).
        """
        layout, handed, rows = self.layout, self.handed, []
        for k in range(SEGMENTS):
            window = x[layout.window(k).tolist()]
            next_begin = layout.begins[k + 1]
            found = following[:, k]
            before = x[layout.information(k).tolist()] if k else type(x)(ca.DM.zeros(layout.entries))
            given = ca.vertcat(found[:STATES], before + found[STATES:handed])
            if k + 1 < SEGMENTS:
                given = ca.vertcat(given, window[window.shape[0] - 2 * layout.carried[k + 1] :])
            rows += [x[next_begin : next_begin + layout.states[k + 1]] - given]
            rows += [ca.sparsify(ca.DM(self.stages.rates[k].slopes)) @ window]
            rows += [found[self._room(k).tolist()]]
        rows += [self._last(*self._end(x))[0]]
        return ca.vertcat(*rows)

    def cost(self, x: Expression) -> Expression:
        """What is minimised."""
        return -self._last(*self._end(x))[1]

    @cached_property
    def _last(self) -> ca.Function:
        criterion = self.stages.criterion
        found = [criterion.equalities, criterion.objective]
        return ca.Function("last", [self.stages.entries, criterion.variables], found)

    def _end(self, x: Expression) -> tuple[Expression, Expression]:
        return x[self.layout.information(SEGMENTS).tolist()], x[-self.layout.auxiliary :]

    def places(self, k: int) -> tuple[Places, Array]:
        """Rows of what follows a stage, -1 where nobody asks, and the sign it has in them."""
        rows = np.full(self.stages.stage.size1_out(0), -1)
        rows[: self.handed] = self.begins[k] + np.arange(self.handed)
        first = self.begins[k] + self.layout.states[k + 1] + len(self.stages.rates[k].lower)
        rows[self._room(k)] = first + np.arange(len(self._room(k)))
        return rows, np.where(np.arange(len(rows)) < self.handed, -1.0, 1.0)

    def _room(self, k: int) -> Places:
        # Rows of the room that are asked for, among what follows a stage.
        every = np.arange(self.sides)[:, None] * self.stages.slots + np.arange(len(self.stages.instants[k]))
        return np.asarray(self.handed + every.ravel())

    def arguments(self, unknowns: Array) -> dict[str, Array]:
        """All bounds, and where to begin: at the drive of these unknowns."""
        low, high = np.full(self.layout.size, -np.inf), np.full(self.layout.size, np.inf)
        for k in range(SEGMENTS):
            low[self.layout.window(k)], high[self.layout.window(k)] = -1.0, 1.0
        # Bounds once, where a coefficient comes in.
        for k in range(1, SEGMENTS):
            taken = self.layout.window(k)[: 2 * self.layout.carried[k]]
            low[taken], high[taken] = -np.inf, np.inf
        lower, upper = np.zeros(self.count), np.zeros(self.count)
        for k, rates in enumerate(self.stages.rates):
            begin = self.begins[k] + self.layout.states[k + 1]
            own = slice(begin, begin + len(rates.lower))
            lower[own], upper[own] = rates.lower, rates.upper
            room = slice(own.stop, begin + self.own[k])
            places = self._room(k) - self.handed
            lower[room], upper[room] = (one.ravel(order="F")[places] for one in self.stages.room_bounds)
        return {"x0": self._start(unknowns), "lbx": low, "ubx": high, "lbg": lower, "ubg": upper}

    @property
    def structure(self) -> dict[str, Any]:
        """The stages as fatrop takes them."""
        return {
            "N": SEGMENTS,
            "nx": self.layout.states,
            "nu": self.layout.controls,
            "ng": self.own,
        }

    def by_ipopt(self, program: dict[str, Any], unknowns: Array, iterations: int, **further: Any) -> Plain:
        """Solved by Ipopt with MUMPS.

        Args:
            program: these rows, however written.
            unknowns: to begin at.
            iterations: at most.
            further: options.
        """
        options = {**IPOPT, **further, "ipopt.max_iter": iterations}
        return Plain(ca.nlpsol("staged", "ipopt", program, options), self.arguments(unknowns))

    def by_fatrop(self, program: dict[str, Any], unknowns: Array, iterations: int, **further: Any) -> Plain:
        """Solved by fatrop, to as many digits.

        Args:
            program: these rows, however written.
            unknowns: to begin at.
            iterations: at most.
            further: options.
        """
        own = {"fatrop": {"max_iter": iterations, "print_level": 0, "tol": 1e-8}}
        options = {**FATROP, **self.structure, **own, **further}
        return Plain(ca.nlpsol("staged", "fatrop", program, options), self.arguments(unknowns))

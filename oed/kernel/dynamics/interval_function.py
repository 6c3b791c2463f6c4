"""Evaluation of CasADi functions on intervals: bounds of values and of derivatives, many boxes at once."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.intervals import (
    ABOVE,
    AT_LEAST_ONE,
    BELOW,
    CHOICE,
    EVERYTHING,
    OPERATIONS,
    ElementaryOperation,
)


class Step(NamedTuple):
    """An operation and the places of its operands among all values.

    Attributes:
        code: CasADi's number of the operation.
        operation: operation to carry out.
        operands: places of the operands.
    """

    code: int
    operation: ElementaryOperation
    operands: Sequence[int]


class IntervalFunction:
    """A CasADi function of SX, some of whose arguments' entries move within intervals.

    Of several outputs, which are dense, each holds derivatives of those before. CasADi's derivatives do not
    know of jumps: where an output may jump, the bounds of the next ones are all numbers.

    The function's values are the entries of all arguments one after the other, then constants and results of
    steps.

    Attributes:
        is_bounded: every operation on what moves has a rule.
    """

    def __init__(self, function: ca.Function, moving: Collection[int]) -> None:
        """Read the list of operations of a function.

        Args:
            function: function of SX.
            moving: places of the entries that move, among those of all arguments.
        """
        offsets = np.cumsum([0, *(function.nnz_in(place) for place in range(function.n_in()))]).tolist()
        codes = [function.instruction_id(line) for line in range(function.n_instructions())]
        self._values: list[Any] = [None] * offsets[-1]
        self._steps: dict[int, Step] = {}
        self._results = [[-1] * function.nnz_out(place) for place in range(function.n_out())]
        registers: dict[int, int] = {}
        for line, code in enumerate([] if ca.OP_CALL in codes else codes):
            read, written = function.instruction_input(line), function.instruction_output(line)
            if code == ca.OP_INPUT:
                registers[written[0]] = offsets[read[0]] + read[1]
            elif code == ca.OP_CONST:
                registers[written[0]] = self._append(np.float64(function.instruction_constant(line)))
            elif code == ca.OP_OUTPUT:
                self._results[written[0]][written[1]] = registers[read[0]]
            else:
                registers[written[0]] = self._read(code, [registers[register] for register in read])
        self._needed = [self._needed_by(places) for places in self._results]
        self._moving = set(moving)
        for place, step in self._steps.items():
            if self._moving.intersection(step.operands):
                self._moving.add(place)
        rules = [self._steps[place].operation.rule for place in self._moving & set().union(*self._needed)]
        self.is_bounded = ca.OP_CALL not in codes and _unknown not in rules

    def exact(self, entries: Sequence[Any]) -> list[Any]:
        """Return the first output's entries for exact entries.

        Args:
            entries: numbers, or arrays with a number for each box.
        """
        values, _ = self._evaluate(entries, self._needed[0], ())
        return [np.nan if place < 0 else values[place] for place in self._results[0]]

    def bounds(self, entries: Sequence[Any]) -> list[Array]:
        """Return the intervals of each output's entries, (entries, 2, boxes); all numbers where unknown.

        Args:
            entries: intervals of those that move; of others numbers, or arrays with a number for each box.
        """
        shape = next(entry.shape for entry in entries if np.ndim(entry) == 2)
        values, jumps = self._evaluate(entries, set().union(*self._needed), self._moving)
        outputs, is_unknown = list[Array](), np.zeros(shape[1], dtype=bool)
        for places in self._results:
            bounds = np.empty((len(places), *shape))
            for row, place in zip(bounds, places, strict=True):
                row[:] = np.nan if place < 0 else values[place]
            is_nan = np.isnan(bounds).any(axis=1)
            outputs.append(np.where((is_nan | is_unknown)[:, None], EVERYTHING, bounds))
            is_unknown |= np.asarray(is_nan).any(axis=0)
            for place in places:
                is_unknown |= jumps[place]
        return outputs

    def _evaluate(
        self, entries: Sequence[Any], needed: set[int], moving: Collection[int]
    ) -> tuple[list[Any], list[Any]]:
        # All values, and flags of the boxes in which they may jump.
        values = [*entries, *self._values[len(entries) :]]
        jumps: list[Any] = [False] * len(values)
        with np.errstate(all="ignore"):
            for place, (_, operation, operands) in self._steps.items():
                if place not in needed:
                    continue
                arguments = [values[operand] for operand in operands]
                if place in moving:
                    values[place] = result = operation.rule(*arguments)
                    jumps[place] = operation.jumps(
                        [jumps[operand] for operand in operands], result, *arguments
                    )
                else:
                    values[place] = operation.exact(*arguments)
        return values, jumps

    def _append(self, constant: Any) -> int:
        self._values.append(constant)
        return len(self._values) - 1

    def _add(self, operation: ElementaryOperation, operands: Sequence[int], code: int = -1) -> int:
        place = self._append(None)
        self._steps[place] = Step(code, operation, operands)
        return place

    def _read(self, code: int, operands: Sequence[int]) -> int:
        if code == ca.OP_ADD:
            steps = [self._steps.get(place, NO_STEP) for place in operands]
            codes = {step.code for step in steps}
            if codes == {ca.OP_IF_ELSE_ZERO} and (choice := self._choice(steps)):
                return choice
            if codes == {ca.OP_LE} and list(steps[0].operands) == list(steps[1].operands)[::-1]:
                # Of a <= b and b <= a one holds: derivatives of the larger of two divide by this sum.
                return self._add(AT_LEAST_ONE, [self._add(OPERATIONS[code], operands)])
        if code == ca.OP_IF_ELSE_ZERO:
            condition, chosen = operands
            operands = [condition, self._guarded(condition, chosen, holds=True)]
        return self._add(OPERATIONS.get(code) or _without_rule(code), operands, code)

    def _choice(self, steps: Sequence[Step]) -> int | None:
        # CasADi writes if_else as a sum of two terms of which one is 0. Bounded apart, these would not know
        # of each other.
        for (_, _, (condition, chosen)), (_, _, (negation, otherwise)) in (steps, steps[::-1]):
            opposite = self._steps.get(negation, NO_STEP)
            if opposite.code == ca.OP_NOT and opposite.operands[0] == condition:
                otherwise = self._guarded(condition, otherwise, holds=False)
                return self._add(CHOICE, [condition, chosen, otherwise])
        return None

    def _guarded(self, condition: int, chosen: int, *, holds: bool) -> int:
        # Where a comparison chooses one of the very numbers that it compares, this is beyond the other one:
        # so a divisor is kept away from 0.
        step = self._steps.get(condition, NO_STEP)
        if step.code not in (ca.OP_LT, ca.OP_LE) or chosen not in step.operands:
            return chosen
        less, more = step.operands
        is_below = (chosen == less) == holds
        return self._add(BELOW if is_below else ABOVE, [chosen, more if chosen == less else less])

    def _needed_by(self, places: Sequence[int]) -> set[int]:
        # Places of the steps whose results enter these values.
        reached = set(places)
        for place, step in reversed(list(self._steps.items())):
            if place in reached:
                reached.update(step.operands)
        return reached & self._steps.keys()


def _unknown(*operands: Any) -> Any:
    (interval, *_) = (operand for operand in operands if np.ndim(operand) == 2)
    return np.full_like(interval, np.nan)


NO_STEP = Step(-1, ElementaryOperation(_unknown, _unknown), ())


def _without_rule(code: int) -> ElementaryOperation:
    def exact(*operands: Any) -> Any:
        elementary = ca.DM.unary if len(operands) == 1 else ca.DM.binary
        columns = np.broadcast_arrays(*operands)
        numbers = elementary(code, *(ca.DM(column.ravel()) for column in columns))
        return np.array(numbers).reshape(columns[0].shape)

    return ElementaryOperation(exact, _unknown)

"""Rows of instants that a program looks at."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from oed.foundation.arrays import Array, Places


@dataclass(frozen=True)
class ChosenRows:
    """Rows of instants, one for each slot of a program.

    Attributes:
        run: run of each slot's instant among those of all watched systems, (K,).
        sample: sample in the run, (K,).
        row: row among those of an instant, (K,).
        share: how much of the row the slot holds: 1, or 0 of an empty slot, (K,).
        constants: constants of the instant, (K, c).
        asked: derivatives of the inputs that splines ask for by z, (K, inputs, size); none asked for: 0.
        lower: lower bounds of the rows, (K,).
        upper: upper bounds of the rows, (K,).
    """

    run: Places
    sample: Places
    row: Places
    share: Array
    constants: Array
    asked: Array
    lower: Array
    upper: Array

    def __len__(self) -> int:
        """Return K."""
        return len(self.row)

    def padded(self, slots: int) -> ChosenRows:
        """Return the rows with empty slots behind them, which have no bounds."""
        spare = slots - len(self)
        places = np.append(np.arange(len(self)), np.zeros(spare, dtype=int))
        copied = {field.name: getattr(self, field.name)[places] for field in fields(self)}
        ends = {"share": 0.0, "lower": -np.inf, "upper": np.inf}
        for name, end in ends.items():
            copied[name][len(self) :] = end
        return ChosenRows(**copied)

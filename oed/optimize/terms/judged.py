"""The judged information of drives, with its derivatives: of what samples add, or of whole drives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.direct_call import mapped
from oed.optimize.terms.differentiated import Differentiated
from oed.optimize.terms.information import Information
from oed.optimize.terms.runs import Rolled, Runs, RunValues, RunWeights
from oed.optimize.terms.whole import WholeDrive
from oed.optimize.terms.whole_rows import Formulas


class Judged(ABC):
    """The entries of the judged matrices of K systems as a function of what their runs do.

    Attributes:
        runs: runs of the systems, which are given the same inputs.
        sizes: sizes of the matrices of one system.
    """

    runs: Runs
    sizes: Sequence[int]

    @abstractmethod
    def entries(self, values: RunValues, further: Array) -> Array:
        """Return the entries of every system's matrices, (drives, K e).

        Args:
            values: what the runs of all drives do.
            further: variables of whole drives that no sample hands on, (drives, m).
        """

    @abstractmethod
    def at(self, rolled: Rolled, further: Array) -> JudgedAt:
        """Return the information of a single drive.

        Args:
            rolled: runs of the drive.
            further: variables of whole drives that no sample hands on, (m,).
        """


class JudgedAt(ABC):
    """The entries of the judged matrices of one drive, with their derivatives by all unknowns.

    Attributes:
        entries: entries of all systems' matrices, (K e,).
        slopes: their derivatives, (K e, size).
    """

    entries: Array
    slopes: Array

    @abstractmethod
    def weigh(self, weights: Array, on_runs: RunWeights) -> Array:
        """Add what weighted entries weigh of the runs; return second derivatives besides, (size, size).

        Args:
            weights: weights of the entries, (K e,).
            on_runs: weights of what the runs do.
        """


class AddedInformation(Judged):
    """Information that samples add.

    Args:
        runs: runs of the judged systems.
        information: matrices of what samples add up to.
        ending: what is read at a run's end, of (x, inputs held until then) and of parameters that differ;
            None of regressions.
    """

    def __init__(self, runs: Runs, information: Information, ending: Differentiated | None) -> None:
        """Take the parts."""
        self.runs, self.information, self.ending = runs, information, ending
        self.sizes = information.sizes

    def groups(self, values: RunValues) -> Array:
        """Return sums within groups of what samples and runs' ends add, (systems, runs, groups, added)."""
        runs = self.runs.count // self.runs.systems
        systems, ends = len(values.added) // runs, None
        if self.ending is not None:
            last = self.ending_variables(values)
            constants = np.tile(self.runs.parameters, (len(last) // self.runs.count, 1))
            ends = self.ending.values(last, constants).reshape(systems, runs, values.added.shape[2])
        added = values.added.reshape(systems, runs, *values.added.shape[1:])
        return self.information.grouped(added, ends)

    @staticmethod
    def ending_variables(values: RunValues) -> Array:
        """Return x at the runs' ends and the inputs held until then."""
        return np.hstack([values.ends, values.held[:, -1]])

    def entries(self, values: RunValues, further: Array) -> Array:
        """Return the entries of every system's matrices, (drives, K e)."""
        entries = self.information.entries(self.information.sums(self.groups(values)))
        return entries.reshape(len(values.added) // self.runs.count, -1)

    def at(self, rolled: Rolled, further: Array) -> JudgedAt:
        """Return the information of a single drive."""
        return _AddedAt(self, rolled)


class _AddedAt(JudgedAt):
    def __init__(self, judged: AddedInformation, rolled: Rolled) -> None:
        self._judged, self._rolled, self._information = judged, rolled, judged.information

    @cached_property
    def _groups(self) -> Array:
        return self._judged.groups(self._rolled)

    @cached_property
    def _sums(self) -> Array:
        return self._information.sums(self._groups)

    @cached_property
    def entries(self) -> Array:  # type: ignore[override]
        return self._information.entries(self._sums).ravel()

    @cached_property
    def _end(self) -> Array:
        return self._judged.ending_variables(self._rolled)

    @cached_property
    def _end_slopes(self) -> Array:
        # Of x at the runs' ends and the inputs held until then, (count, width + inputs, w).
        held = self._rolled.runs.held_slopes[-1]
        last = np.broadcast_to(held, (len(self._end), *held.shape))
        return np.concatenate([self._rolled.end_slopes, last], axis=1)

    @cached_property
    def _group_slopes(self) -> Array:
        slopes, ending = self._rolled.added_slopes(self._information.groups), self._judged.ending
        if ending is not None:
            by_end = ending.slopes(self._end, self._rolled.runs.parameters)
            slopes[:, 0] += np.matmul(by_end, self._end_slopes)
        return slopes.reshape(*self._groups.shape[:2], *slopes.shape[1:])

    @cached_property
    def _sum_slopes(self) -> list[Array]:
        # Of every system, (sums, size).
        runs = self._rolled.runs
        places = runs.places[: self._groups.shape[1]]
        pairs = zip(self._groups, self._group_slopes, strict=True)
        return [self._information.sum_slopes(groups, slopes, places, runs.size) for groups, slopes in pairs]

    @cached_property
    def slopes(self) -> Array:  # type: ignore[override]
        both = zip(self._sums, self._sum_slopes, strict=True)
        return np.concatenate([self._information.entry_slopes(sums) @ slopes for sums, slopes in both])

    def weigh(self, weights: Array, on_runs: RunWeights) -> Array:
        information, parts = self._information, []
        total = np.zeros((self._rolled.runs.size, self._rolled.runs.size))
        systems = zip(
            self._sums, self._sum_slopes, self._groups, np.split(weights, len(self._sums)), strict=True
        )
        for place, (sums, slopes, groups, weights_of_system) in enumerate(systems):
            on_sums, bent = information.weighted(sums, weights_of_system)
            if bent is not None:
                total += slopes.T @ bent @ slopes
            on_groups, square = information.group_weights(groups, on_sums)
            parts.append(np.broadcast_to(on_groups, groups.shape))
            if square is not None:
                steps = self._group_slopes[place]
                first, last = place * len(groups), (place + 1) * len(groups)
                bent_runs = np.matmul(steps.transpose(0, 1, 3, 2), np.matmul(square, steps)).sum(axis=1)
                on_runs.bent[first:last] += bent_runs
        on_groups = np.concatenate(parts)
        length = self._rolled.runs.samples // information.groups
        on_runs.added += np.repeat(on_groups, length, axis=1)
        ending = self._judged.ending
        if ending is not None:
            parameters, on_ends = self._rolled.runs.parameters, np.ascontiguousarray(on_groups[:, 0])
            by_end = ending.slopes(self._end, parameters)
            on_runs.ends += np.matmul(on_ends[:, None], by_end)[:, 0, : on_runs.ends.shape[1]]
            inner, slopes = ending.curvature(self._end, on_ends, parameters), self._end_slopes
            on_runs.bent += np.matmul(slopes.transpose(0, 2, 1), np.matmul(inner, slopes))
        return total


class WholeInformation(Judged):
    """Information that no samples add up to: formulas of whole drives.

    Args:
        runs: runs of the judged systems, with their sensitivities.
        formulas: formulas of one system's entries.
        sizes: sizes of its matrices.
    """

    def __init__(self, runs: Runs, formulas: Formulas, sizes: Sequence[int]) -> None:
        """Take the parts."""
        self.runs, self.formulas, self.sizes = runs, formulas, sizes

    def entries(self, values: RunValues, further: Array) -> Array:
        """Return the entries of every system's matrices, (drives, K e)."""
        drives, runs = len(further), self.runs.count // self.runs.systems
        x, samples = self.formulas.x
        points = values.points.reshape(drives, self.runs.systems, runs * self.runs.samples, -1)
        variables = np.concatenate(
            [points[:, :, samples, x], np.repeat(further[:, None], self.runs.systems, axis=1)], axis=2
        )
        parameters = np.tile(self.runs.parameters[::runs], (drives, 1))
        call = mapped(self.formulas.values, drives * self.runs.systems)
        (flat,) = call(variables, parameters)
        return flat.reshape(drives, -1)

    def at(self, rolled: Rolled, further: Array) -> JudgedAt:
        """Return the information of a single drive."""
        runs = self.runs.count // self.runs.systems
        return _WholeAt(
            [WholeDrive(self.formulas, rolled, first, further) for first in range(0, self.runs.count, runs)]
        )


class _WholeAt(JudgedAt):
    def __init__(self, systems: Sequence[WholeDrive]) -> None:
        self._systems = systems

    @cached_property
    def entries(self) -> Array:  # type: ignore[override]
        return np.concatenate([drive.values for drive in self._systems])

    @cached_property
    def slopes(self) -> Array:  # type: ignore[override]
        return np.concatenate([drive.slopes for drive in self._systems])

    def weigh(self, weights: Array, on_runs: RunWeights) -> Array:
        parts = zip(self._systems, np.split(weights, len(self._systems)), strict=True)
        return np.asarray(np.sum([drive.weigh(part, on_runs) for drive, part in parts], axis=0))

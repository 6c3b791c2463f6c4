"""Consequences of the parts of a design problem: bounds, limits, information."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from oed.foundation.arguments import real_array
from oed.foundation.arrays import Array
from oed.foundation.presenting import Presented
from oed.kernel.criteria import Criterion, Subject
from oed.kernel.dynamics.rollout import Drive, drive_shape
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.starts import StartStates
from oed.kernel.dynamics.system import System
from oed.kernel.limit import Limit, Rows, checked_rows, implied_bounds
from oed.kernel.measurement.blocks import Block, Nuisance
from oed.kernel.measurement.information import Estimation
from oed.kernel.measurement.measurement import Measurement, sensors_of
from oed.kernel.measurement.prior import Prior
from oed.kernel.measurement.process_noise import ProcessNoise
from oed.kernel.measurement.readings import constants_of
from oed.kernel.measurement.sensor import Sensor, process_noise_of
from oed.kernel.selection import Selection
from oed.kernel.tightening import ParameterUncertainty, Tightening, UncertainSystem, tightened_rows


@dataclass(frozen=True, eq=False, repr=False)
class Statement(Presented):
    """The parts of a design problem, and all that follows from them; see `Problem`."""

    model: System
    design: Space
    measurement: Measurement
    limits: tuple[Limit, ...]
    criterion: Criterion
    name: str
    estimate: tuple[str, ...] | None
    prior: Prior | None
    uncertainty: ParameterUncertainty | None
    robust: Tightening | None
    excess: float
    selection: Selection | None
    designed: bool

    @cached_property
    def system(self) -> System:
        """The system with the parameters to estimate: the model, or the same known by others."""
        return self.model.estimating(self.estimated_of_system or ())

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors that read; () for a regression."""
        return sensors_of(self.measurement)

    @property
    def process_noise(self) -> ProcessNoise | None:
        """Process noise that the sensors state; None without any."""
        return process_noise_of(self.sensors)

    @cached_property
    def constants(self) -> dict[str, Nuisance]:
        """Constants of sensors that `estimate` names, with the nuisances that they would be else."""
        names_of_system = {name for names in self.model.estimable.values() for name in names}
        constants = constants_of(self.sensors)
        return {
            name: constants[name]
            for name in self.estimate or ()
            if name not in names_of_system and name in constants
        }

    @property
    def estimated_of_system(self) -> tuple[str, ...] | None:
        """`estimate` without the sensors' constants."""
        if self.estimate is None:
            return None
        return tuple(name for name in self.estimate if name not in self.constants)

    @cached_property
    def objective(self) -> Criterion:
        """The criterion of the parameters that it judges."""
        return self.judging(self.criterion)

    def judging(self, criterion: Criterion) -> Criterion:
        """Any criterion of the same scaling and subset, of the parameters that it judges."""
        return criterion.about(self.subject)

    @cached_property
    def input_bounds(self) -> Array:
        """Bounds (inputs, 2) that the limits set on each input, by itself or together with others."""
        bounds = self._tightest([limit.input_bounds(self.model) for limit in self.limits])
        combined = [bound for limit in self.limits for bound in limit.linear_bounds(self.model)]
        return implied_bounds(bounds, [bound.widened(self.excess) for bound in combined])

    @cached_property
    def rate_bounds(self) -> Array:
        """Bounds (inputs, 2) that they set on each input's rate."""
        return self._tightest([limit.rate_bounds(self.model) for limit in self.limits])

    def _tightest(self, bounds_by_limit: Sequence[Mapping[str, tuple[float, float]]]) -> Array:
        bounds = np.tile([-np.inf, np.inf], (len(self.model.inputs), 1))
        for limit, limited in zip(self.limits, bounds_by_limit, strict=True):
            if self.excess and limited:
                limited = limit.widened_bounds(limited, self.excess, limit.rows(self._any_drive).size)
            for name, (low, high) in limited.items():
                row = bounds[self.model.input_names.index(name)]
                row[:] = max(row[0], low), min(row[1], high)
        return bounds

    def widened(self, share: float) -> Self:
        """The problem with every limit exceeded by at most `share` of its size, as a tolerance allows: for
        evaluations and bounds, not for searches.

        A drive keeps the limits within that tolerance if and only if it keeps these exactly. The same holds
        for the duration, and for rest and starts.
        """
        longer = self.design.model_copy(update={"duration": (1 + share) * self.design.duration})
        return replace(self, design=longer, excess=share)

    def refined(self, times: int) -> Self:
        """The problem with so many times more steps of its system's integration in a period; itself where
        nothing is integrated.

        Args:
            times: factor, at least 1.
        """
        if not self.system.integrates:
            return self
        if times not in self._refinements:
            self._refinements[times] = replace(self, model=self.model.refined(times))
        return self._refinements[times]

    @cached_property
    def _refinements(self) -> dict[int, Self]:
        # Those that were asked for: their compiled functions are kept with them.
        return {1: self}

    @cached_property
    def unselected(self) -> Self:
        """The problem with all readings taken."""
        return self if self.selection is None else replace(self, selection=None)

    @cached_property
    def unlimited(self) -> Self:
        """The problem without limits and back-off: for information, or a drive's length, alone."""
        return replace(self, limits=(), robust=None, designed=False)

    @cached_property
    def steady(self) -> Self:
        """The problem without process noise: of every drive it has more information, or as much."""
        measurement = self.measurement.steady()
        return self if measurement is self.measurement else replace(self, measurement=measurement)

    @property
    def rest_spare(self) -> float:
        """Largest speed of an input that is to rest [SI]: a share of the largest bound of all inputs."""
        return self.excess * float(np.abs(self.input_bounds).max()) if self.excess else 0.0

    @property
    def start_spare(self) -> float:
        """Largest distance of a fixed start from its place [m or rad]: a share of 1."""
        return self.excess

    @cached_property
    def fixed_starts(self) -> Array | None:
        """The start state of every run, (runs, states), where it is fixed."""
        starts = self.design.fixed_starts
        return None if starts is None else self.start_states(starts)

    @cached_property
    def starts(self) -> StartStates:
        """Start states of all runs, of the unknowns that choose them."""
        count, runs, ranges = len(self.system.states), self.design.runs, self.design.start_ranges
        if self.fixed_starts is not None:
            return StartStates(self.fixed_starts, np.zeros(count))
        if ranges is None:
            is_free = np.arange(count) < self.system.chosen_states
            return StartStates(np.zeros((runs, count)), is_free.astype(float))
        return StartStates.between(ranges, count, runs)

    def start_states(self, chosen: npt.ArrayLike) -> Array:
        """Start states (runs, states) of which the first k are chosen, (runs, k): the others begin at 0."""
        table = real_array("start", chosen)
        table = table if table.ndim == 2 else table.reshape(self.design.runs, -1)
        return np.pad(table, ((0, 0), (0, len(self.model.states) - table.shape[1])))

    @cached_property
    def uncertain_system(self) -> UncertainSystem:
        """The system with what is said of its parameters beforehand."""
        return UncertainSystem(self.model, self.system, self.design.runs, self.uncertainty, self.prior)

    def limit_rows(self, drive: Drive) -> list[Rows]:
        """Every limit on a drive; of a robust problem tightened."""
        if self.robust is None:
            rows = [checked_rows(limit, drive) for limit in self.limits]
        else:
            rows = tightened_rows(self.robust, self.limits, drive, self.uncertain_system)
        return [row.widened(self.excess) for row in rows] if self.excess else rows

    @cached_property
    def judged_systems(self) -> tuple[tuple[Array, Array], ...]:
        """Parameters (p,) and shifts of the start states (runs, states) of the systems that are judged."""
        if self.robust is None or self.robust.objective == "nominal":
            return ((np.array(self.system.nominal), np.zeros((self.design.runs, len(self.system.states)))),)
        return self.robust.judged(self.uncertain_system).each

    def together(self, values: Sequence[float | Array]) -> Array:
        """The objective (...,) from the criterion's values (...,) for each of these systems."""
        return self.robust.together(values) if self.robust is not None else np.asarray(values[0])

    def estimations(self, drive: Drive) -> tuple[Estimation, ...]:
        """Return the information in each block of a drive's readings about the parameters to estimate."""
        return self._estimations(self._blocks(drive))

    def _estimations(self, blocks: Sequence[Block]) -> tuple[Estimation, ...]:
        return tuple(self._estimation(block) for block in blocks if self.judged(block))

    @cached_property
    def any_estimations(self) -> tuple[Estimation, ...]:
        """Estimations of a drive without values: for parameters, noise and nuisances."""
        return self._estimations(self.any_blocks)

    @cached_property
    def any_blocks(self) -> tuple[Block, ...]:
        """The blocks of a drive without values."""
        return self._blocks(self._any_drive)

    def _blocks(self, drive: Drive) -> tuple[Block, ...]:
        blocks = self.measurement.blocks(drive)
        labels = {name: constant.name for name, constant in self.constants.items()}
        return tuple(block.asking(labels) for block in blocks) if labels else blocks

    @cached_property
    def _any_drive(self) -> Drive:
        # Enough to ask which parameters there are.
        space = self.design
        return drive_shape(self.system, samples=space.samples, runs=space.runs, period=space.period)

    def _estimated(self, block: Block) -> tuple[str, ...]:
        wanted = block.parameters if self.estimate is None else self.estimate
        return tuple(name for name in wanted if name in block.parameters)

    def judged(self, block: Block) -> tuple[str, ...]:
        """Names of a block's parameters that the criterion judges."""
        subset = self.criterion.subset
        return tuple(name for name in self._estimated(block) if subset is None or name in subset)

    def _estimation(self, block: Block) -> Estimation:
        judged, scaling = self.judged(block), self.criterion.scaling
        unjudged = tuple(name for name in self._estimated(block) if name not in judged)
        estimation = Estimation(block, judged + unjudged, judged, scaling, None)
        if self.prior is None or not set(self.prior.names) & set(estimation.parameters):
            return estimation
        known = self.prior.precision(estimation.parameters, estimation.nominal, estimation.units)
        return replace(estimation, prior=known)

    @property
    def subject(self) -> Subject:
        """Subject that the criterion judges."""
        estimations = self.any_estimations
        return Subject(
            system=self.system.estimating(
                [
                    name
                    for estimation in estimations
                    for name in estimation.judged
                    if name not in self.constants
                ]
            ),
            parameters=tuple(estimation.judged for estimation in estimations),
            scales=tuple(estimation.scales for estimation in estimations),
            start=self.starts.middle[0],
            period=self.design.period,
        )

    def __getstate__(self) -> dict[str, Any]:
        """The parts only: caches are made again where they are needed."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

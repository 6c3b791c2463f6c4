"""Monte Carlo: simulate noisy experiments, estimate as the paper does, compare with the promised covariance.

The promise is sigma^2 (W'W)^-1 [Choi, eq. 18]. The estimator is two-stage least squares: c11, c12 from the
turns [Choi, eq. 12], then c21, c22 from the displacements with the headings that are known, predicted by
the first stage [Choi, eq. 16], or measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from oed.errors import Flaw, ProblemError
from oed.measurements.displacements import Displacements
from oed.measurements.measurement import Measurement
from oed.problem import Problem
from oed.regressors import Regressors
from oed.solvers.parallel import run_tasks
from oed.solvers.progress import Progress, Silent
from oed.trajectory import Trajectory
from oed.validation.checks import Check, check_all

Array = npt.NDArray[np.float64]
Heading = Literal["known", "predicted", "measured", "corrected"]

BATCH = 1000
"""Replicates drawn from one stream: the same numbers whatever the number of workers."""
ALPHA = 0.01
"""Probability with which all tests together reject a right covariance."""
SHOWN = 200
"""Estimates kept for a scatter plot."""
STREAM = 5


@dataclass(frozen=True)
class Validation:
    """Promised against simulated precision; all SI.

    Attributes:
        heading: which headings the position regression used.
        replicates, seed, alpha: of the simulation and its tests.
        parameters: names, (p,).
        true: values simulated with, (p,).
        mean: of the estimates, (p,).
        promised: covariance sigma^2 (W'W)^-1, (p, p).
        sampled: covariance of the estimates, (p, p).
        paired_ratio: sampled over promised variance, (p,), each replicate paired with the linear estimate
            from the same noise, which removes most of the sampling error.
        paired_error: standard error of that ratio, (p,).
        checks: the tests, judged together.
        estimates: the first estimates, (<= 200, p).
    """

    heading: Heading
    replicates: int
    seed: int
    alpha: float
    parameters: tuple[str, ...]
    true: Array
    mean: Array
    promised: Array
    sampled: Array
    paired_ratio: Array
    paired_error: Array
    checks: tuple[Check, ...]
    estimates: Array

    @property
    def passed(self) -> bool:
        """Whether the promised covariance is right as far as this simulation can tell."""
        return all(check.passed for check in self.checks)

    @property
    def verdict(self) -> str:
        """The outcome in words."""
        if self.passed:
            return (
                f"In {self.replicates} simulated experiments the estimates scatter as promised: "
                f"all {len(self.checks)} tests passed."
            )
        failed = ", ".join(check.name for check in self.checks if not check.passed)
        ratios = np.sqrt(np.diag(self.sampled) / np.diag(self.promised))
        worst = int(np.argmax(np.abs(np.log(ratios))))
        offset = (self.mean[worst] - self.true[worst]) / math.sqrt(self.promised[worst, worst])
        return (
            f"In {self.replicates} simulated experiments the promise did not hold ({failed}): "
            f"{self.parameters[worst]} scatters {ratios[worst]:.3g} times as much as promised "
            f"and is off by {offset:+.2g} promised standard deviations on average."
        )


def validate(
    problem: Problem,
    trajectory: Trajectory,
    *,
    replicates: int = 10_000,
    heading: Heading = "known",
    seed: int = 0,
    alpha: float = ALPHA,
    workers: int = 1,
    progress: Progress | None = None,
) -> Validation:
    """Simulate `replicates` experiments of a drive and test the promised covariance against them.

    Args:
        problem: with a `Displacements` measurement whose noise is given.
        trajectory: the drive.
        replicates: simulated experiments.
        heading: which headings the position regression uses: the true ones ("known"), those that the
            first stage predicts, or noisy ones measured at every sample, taken as they are or "corrected"
            for errors in variables.
        seed: of all noise.
        alpha: joint level of the tests.
        workers: processes; does not change the result.
        progress: told how far it is.

    Raises:
        ProblemError: no noise given, a singular design, or a measurement that is not `Displacements`.
    """
    experiment = Experiment(problem, trajectory, heading)
    listener = progress or Silent()
    batches = [
        _Batch(experiment, seed, index, min(BATCH, replicates - index * BATCH))
        for index in range(math.ceil(replicates / BATCH))
    ]
    listener.begin("simulate experiments", len(batches))
    results: list[tuple[Array, Array]] = [(np.zeros(0), np.zeros(0))] * len(batches)

    def take(index: int, result: tuple[Array, Array]) -> None:
        results[index] = result
        listener.advance()

    run_tasks(_simulate, batches, workers, take)
    estimates = np.concatenate([estimate for estimate, _ in results])
    linear = np.concatenate([estimate for _, estimate in results])
    return _validation(experiment, estimates, linear, seed, alpha)


@dataclass(frozen=True)
class _Batch:
    experiment: Experiment
    seed: int
    index: int
    size: int


def _simulate(batch: _Batch) -> tuple[Array, Array]:
    rng = np.random.default_rng([batch.seed, STREAM, batch.index])
    return batch.experiment.estimate(rng, batch.size)


def _validation(
    experiment: Experiment, estimates: Array, linear: Array, seed: int, alpha: float
) -> Validation:
    true, promised = experiment.true, experiment.promised
    ratio, error = _paired_ratio(estimates - true, linear - true, np.diag(promised))
    return Validation(
        heading=experiment.heading,
        replicates=len(estimates),
        seed=seed,
        alpha=alpha,
        parameters=experiment.parameters,
        true=true,
        mean=estimates.mean(axis=0),
        promised=promised,
        sampled=np.cov(estimates, rowvar=False),
        paired_ratio=ratio,
        paired_error=error,
        checks=check_all(estimates - true, promised, alpha),
        estimates=estimates[:SHOWN],
    )


def _paired_ratio(errors: Array, linear: Array, promised: Array) -> tuple[Array, Array]:
    # E[linear^2] is the promise exactly, so only the difference of squares is left to chance.
    differences = (errors**2 - linear**2) / promised
    return 1.0 + differences.mean(axis=0), differences.std(axis=0, ddof=1) / math.sqrt(len(errors))


def missing_noise(measurement: Measurement, heading: Heading) -> list[str]:
    """The noises that a simulation with such headings needs and the measurement does not give."""
    if not isinstance(measurement, Displacements):
        return []
    needed = set(measurement.regressions) | (set() if heading == "known" else {"heading"})
    return sorted(name for name in needed if getattr(measurement.noise, name) is None)


class Experiment:
    """One drive's regressions, ready to be simulated many times.

    Raises:
        ProblemError: no noise given, a singular design, or a measurement that is not `Displacements`.
    """

    def __init__(self, problem: Problem, trajectory: Trajectory, heading: Heading) -> None:
        """Compute the regressors at the true coefficients."""
        measurement = problem.measurement
        if not isinstance(measurement, Displacements):
            raise ProblemError([Flaw(("validation",), f"no simulation is known for {measurement.kind}")])
        missing = missing_noise(measurement, heading)
        if missing:
            text = f"simulating {heading} headings needs the noise of {', '.join(missing)}"
            raise ProblemError([Flaw(("measurement", "noise"), text)])
        self.heading, self.measurement = heading, measurement
        self.regressors = Regressors(problem.model, problem.design.integration, measurement, trajectory)
        self._check_rank()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters compared."""
        return tuple(name for block in self.measurement.regressions for name in self.regressors.names[block])

    @property
    def true(self) -> Array:
        """The true coefficients compared, (p,)."""
        return np.concatenate([self.regressors.true[block] for block in self.measurement.regressions])

    @cached_property
    def promised(self) -> Array:
        """sigma^2 (W'W)^-1, block by block [Choi, eq. 18]."""
        designs = self.regressors.nominal_designs
        blocks = [
            self._noise(name) ** 2 * np.linalg.inv(designs[name].T @ designs[name])
            for name in self.measurement.regressions
        ]
        return np.asarray(block_diag(*blocks))

    def estimate(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Estimates (count, p) from simulated noise, and the linear estimates from the same noise."""
        designs, true = self.regressors.nominal_designs, self.regressors.true
        noise = {
            name: self._noise(name) * rng.standard_normal((count, len(designs[name])))
            for name in self._simulated
        }
        linear = {name: true[name] + noise[name] @ np.linalg.pinv(designs[name]).T for name in noise}
        estimates = dict(linear)
        if "position" in estimates and self.heading != "known":
            measured = designs["position"] @ true["position"] + noise["position"]
            estimates["position"] = self._position(rng, measured, linear)
        chosen = self.measurement.regressions
        return (
            np.hstack([estimates[name] for name in chosen]),
            np.hstack([linear[name] for name in chosen]),
        )

    def _position(self, rng: np.random.Generator, measured: Array, first_stage: dict[str, Array]) -> Array:
        if self.heading == "predicted":
            return _least_squares(self.regressors.predicted_positions(first_stage["heading"]), measured)
        designs = self._noisy_designs(rng, len(measured))
        corrected = self.heading == "corrected"
        return self._corrected(designs, measured) if corrected else _least_squares(designs, measured)

    def _corrected(self, designs: Array, measured: Array) -> Array:
        # Errors in variables: E[W~'W~] = k^2 W'W + (1 - k^2) S1 and E[W~] = k W, k = E[cos(noise)].
        shrink = math.exp(-(self._noise("heading") ** 2) / 2)
        rows = self.regressors.per_sample
        own = rows.reshape(-1, rows.shape[-1])
        normal = np.einsum("rij,rik->rjk", designs, designs) / shrink**2
        normal -= (shrink**-2 - 1) * (own.T @ own)
        right = np.einsum("rij,ri->rj", designs, measured) / shrink
        return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])

    @property
    def _simulated(self) -> tuple[str, ...]:
        # The two-stage estimator needs the turns even where only positions are asked for.
        chosen = self.measurement.regressions
        first = self.heading == "predicted" and "heading" not in chosen
        return ("heading", *chosen) if first else chosen

    def _noise(self, name: str) -> float:
        return float(getattr(self.measurement.noise, name) or 0.0)

    def _check_rank(self) -> None:
        for name in self._simulated:
            design = self.regressors.nominal_designs[name]
            if np.linalg.matrix_rank(design) < design.shape[1]:
                names = ", ".join(self.regressors.names[name])
                text = f"the drive does not tell {names} apart; nothing to simulate"
                raise ProblemError([Flaw(("validation",), text)])

    def _noisy_designs(self, rng: np.random.Generator, count: int) -> Array:
        # W~ of every replicate: each sample's rows turned by its own heading error, then summed by segment.
        samples = self.regressors.trajectory.samples
        edges = self.measurement.segment_edges(samples)
        turns = np.exp(1j * self._noise("heading") * rng.standard_normal((count, samples)))
        rows = self.regressors.per_sample[:, 0] + 1j * self.regressors.per_sample[:, 1]
        designs = np.empty((count, 2 * (len(edges) - 1), rows.shape[1]))
        for segment, (first, last) in enumerate(pairwise(edges)):
            sums = turns[:, first:last] @ rows[first:last]
            designs[:, 2 * segment], designs[:, 2 * segment + 1] = sums.real, sums.imag
        return designs


def _least_squares(designs: Array, measured: Array) -> Array:
    # Ordinary least squares of each replicate (R, rows, p), (R, rows) by its normal equations [Choi, eq. 16].
    normal = np.einsum("rij,rik->rjk", designs, designs)
    right = np.einsum("rij,ri->rj", designs, measured)
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])

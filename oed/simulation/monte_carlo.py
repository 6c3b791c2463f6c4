"""Monte Carlo: simulate noisy experiments, estimate from them, compare with the covariance predicted.

What is predicted, and how the readings are simulated, is the estimator's; what is tested is the same for all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.estimation.methods import Estimator, EstimatorName, Heading, make_estimator
from oed.estimation.setup.options import Loss
from oed.foundation.arguments import require_count, typed
from oed.foundation.arrays import Array
from oed.foundation.equality import ByValue
from oed.foundation.errors import ProblemError
from oed.foundation.presenting import Card, Fact, Presented, dataframe
from oed.foundation.text import deviation_text, significant
from oed.foundation.work.parallel import Workers, run_tasks
from oed.foundation.work.progress import Progress, Silent
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.simulation.agreement import agreement_sentence, largest_ratio
from oed.simulation.checks import Check, Moments, Tally, check_tally
from oed.simulation.linearisation import Linearisation, differences, directions_of

BATCH = 1000
"""Replicates drawn from one stream: the same numbers whatever the number of workers."""
ALPHA = 0.01
"""Probability with which all tests together reject a right covariance."""
SLOW_BATCH = 100
"""The same where every replicate is a search of its own."""
SHOWN = 200
"""Estimates kept for a scatter plot."""
STREAM = 5
"""Of simulated experiments: their draws are independent of all others of a seed."""


@dataclass(frozen=True, repr=False, eq=False)
class Validation(ByValue, Presented):
    """Predicted against simulated precision; all SI.

    Attributes:
        estimator: what estimated, and predicted its covariance.
        heading: which headings a position regression used.
        replicates, seed, alpha: of the simulation and its tests.
        parameters: names, (p,).
        true: values simulated with, (p,).
        mean: of the estimates, (p,).
        predicted: covariance by the estimator's formula, (p, p).
        sampled: covariance of the estimates, (p, p).
        paired_ratio: sampled over predicted variance, (p,), each replicate paired with the linear estimate
            from the same noise, which removes most of the sampling error.
        paired_error: standard error of that ratio, (p,).
        checks: the tests, judged together.
        estimates: the first estimates, (<= 200, p).
        units: SI units of the parameters, (p,); () where they are not known.
        linearisation: whether the noise is small enough for it; None where that is not known.
    """

    estimator: EstimatorName
    heading: Heading
    replicates: int
    seed: int
    alpha: float
    parameters: tuple[str, ...]
    true: Array
    mean: Array
    predicted: Array
    sampled: Array
    paired_ratio: Array
    paired_error: Array
    checks: tuple[Check, ...]
    estimates: Array
    units: tuple[str, ...] = ()
    linearisation: Linearisation | None = None

    @property
    def passed(self) -> bool:
        """Whether the predicted covariance is right as far as this simulation can tell."""
        return all(check.passed for check in self.checks)

    @property
    def largest_ratio(self) -> float:
        """How many times as large, or as small, as predicted the standard error of any combination of
        parameters may be, with 95 % confidence; infinite where so few replicates say nothing of it.
        """
        return largest_ratio(self.predicted, self.sampled, self.replicates)

    @property
    def verdict(self) -> str:
        """The outcome in words, with how much it says; and whether noise is too large for linearised fits."""
        known = self.linearisation
        if known is None or self.estimator != "nonlinear" or known.small_enough is not False:
            return self._outcome
        return f"{self._outcome} {known.sentence}"

    @property
    def _outcome(self) -> str:
        if self.passed:
            return (
                f"In {self.replicates:,} simulated experiments the estimates scatter as predicted: "
                f"all {len(self.checks)} tests passed. {agreement_sentence(self.largest_ratio)}"
            )
        failed = ", ".join(check.name for check in self.checks if not check.passed)
        ratios = np.sqrt(np.diag(self.sampled) / np.diag(self.predicted))
        worst = int(np.argmax(np.abs(np.log(ratios))))
        offset = (self.mean[worst] - self.true[worst]) / math.sqrt(self.predicted[worst, worst])
        return (
            f"In {self.replicates:,} simulated experiments the prediction did not hold ({failed}): "
            f"{self.parameters[worst]} scatters {ratios[worst]:.3g} times as much as predicted "
            f"and is off by {offset:+.2g} predicted standard errors on average."
        )

    @property
    def columns(self) -> dict[str, Any]:
        """What is compared, by name, an entry of each parameter; SI."""
        return compared(self.parameters, self.true, self.mean, self.predicted, self.sampled)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row per parameter: true value, mean estimate, predicted and sampled
        standard error, SI, and the ratio of these.

        Raises:
            UserMistake: pandas is not installed.
        """
        return dataframe({**self.columns, "unit": list(self.units or [""] * len(self.parameters))})

    def _card(self) -> Card:
        facts: tuple[Fact, ...] = (
            ("verdict", self.verdict),
            ("estimator", f"{self.estimator}, {self.replicates} experiments, seed {self.seed}"),
        )
        found, units = self.columns, self.units or ("",) * len(self.parameters)
        sizes = (
            [deviation_text(float(one), unit) for one, unit in zip(found[name], units, strict=True)]
            for name in ("predicted", "sampled")
        )
        if self.linearisation is not None:
            facts = (*facts, ("linearisation", self.linearisation.sentence))
        rows = zip(self.parameters, *sizes, map(significant(3), found["ratio"]), strict=True)
        heads = ("parameter", "predicted standard error", "sampled", "ratio")
        return Card(f"Validation: {'passed' if self.passed else 'failed'}", facts, heads, tuple(rows))


def compared(
    parameters: Sequence[str],
    true: npt.ArrayLike,
    mean: npt.ArrayLike,
    predicted: npt.ArrayLike,
    sampled: npt.ArrayLike,
) -> dict[str, Any]:
    """Columns of predicted and sampled standard errors and of their ratio, an entry of each parameter; SI.

    Args:
        parameters: names, (p,).
        true: values simulated with, (p,).
        mean: of the estimates, (p,).
        predicted: covariance, (p, p).
        sampled: covariance of the estimates, (p, p).
    """
    found = {"predicted": np.sqrt(np.diag(predicted)), "sampled": np.sqrt(np.diag(sampled))}
    ratio = found["sampled"] / found["predicted"]
    return {"parameter": list(parameters), "true": true, "mean": mean, **found, "ratio": ratio}


def _units(problem: Problem, parameters: Sequence[str]) -> tuple[str, ...]:
    known = {
        name: unit
        for one in problem.any_estimations
        for name, unit in zip(one.parameters, one.units, strict=True)
    }
    return tuple(known.get(name, "") for name in parameters)


@typed
def validate(
    problem: Problem,
    trajectory: Trajectory,
    *,
    replicates: int = 10_000,
    estimator: EstimatorName | None = None,
    heading: Heading = "known",
    loss: Loss = "linear",
    seed: int = 0,
    alpha: float = ALPHA,
    workers: Workers = 1,
    progress: Progress | None = None,
) -> Validation:
    """Simulate `replicates` experiments of a drive and test an estimator's covariance against them.

    Args:
        problem: whose measurement's noise is given.
        trajectory: the drive.
        replicates: simulated experiments; at least one more than there are parameters. (Studies and
            `oed validate` need 100.)
        estimator: "ols", "sandwich", "gls", "errors_in_variables" for displacements, "nonlinear" for
            sensors; by default the one whose information the problem's measurement gives.
        heading: which headings the position regression of displacements uses: the true ones ("known"),
            those that the first stage predicts, or noisy ones measured at every sample.
        loss: of the residuals of joint least squares.
        seed: of all noise.
        alpha: joint level of the tests.
        workers: processes, or a cluster; does not change the result.
        progress: told how far it is.

    Raises:
        ProblemError: no noise given, a singular design, an estimator that does not suit the measurement, or
            too few replicates for a covariance.
        WrongKind: arguments that are something else.
    """
    require_count("replicates", replicates, least=None)
    chosen = make_estimator(problem, trajectory, estimator, heading=heading, loss=loss)
    least = len(chosen.parameters) + 1
    if replicates < least:
        text = f"expected at least {least}, one more than there are parameters, got {replicates}"
        raise ProblemError.about(("validation", "replicates"), text)
    directions = directions_of(chosen.covariance)
    found = _simulated(chosen, directions, replicates, seed, workers, progress or Silent())
    predicted, whitened = chosen.covariance, found.tally.whitened
    root = np.linalg.cholesky(predicted)
    # E[linear^2] is known exactly, so only the difference of squares is left to chance.
    ratio = np.diag(chosen.linear_covariance) / np.diag(predicted) + found.paired.mean
    return Validation(
        estimator=chosen.name,
        heading=heading,
        replicates=found.tally.count,
        seed=seed,
        alpha=alpha,
        parameters=chosen.parameters,
        units=_units(problem, chosen.parameters),
        true=chosen.true,
        mean=chosen.true + root @ whitened.mean,
        predicted=predicted,
        sampled=root @ whitened.covariance @ root.T,
        paired_ratio=ratio,
        paired_error=np.sqrt(np.diag(found.paired.covariance) / found.paired.count),
        checks=check_tally(found.tally, alpha),
        estimates=found.estimates,
        linearisation=Linearisation.of(
            chosen.parameters, directions, chosen.linear_covariance, found.pairs, alpha
        ),
    )


def _simulated(
    chosen: Estimator,
    directions: Array,
    replicates: int,
    seed: int,
    workers: Workers,
    listener: Progress,
) -> _Result:
    # In batches that are drawn by their number, whoever draws them.
    size = min(BATCH, SLOW_BATCH) if chosen.name == "nonlinear" else BATCH
    batches = [(index, min(size, replicates - index * size)) for index in range(math.ceil(replicates / size))]
    listener.begin("simulate experiments", len(batches))
    total = _Total()

    def take(index: int, result: _Result) -> None:
        total.take(index, result)
        listener.advance()

    run_tasks(partial(_simulate, chosen, directions, seed), batches, workers, take)
    return total.result


@dataclass
class _Result:
    # Of a batch, or of all so far.
    tally: Tally
    paired: Moments
    pairs: Moments
    estimates: Array

    def add(self, other: _Result) -> None:
        self.tally.add(other.tally)
        self.paired.add(other.paired)
        self.pairs.add(other.pairs)
        missing = SHOWN - len(self.estimates)
        if missing > 0:
            self.estimates = np.concatenate([self.estimates, other.estimates[:missing]])


class _Total:
    """The sum of all batches, added in their order whatever the order in which workers end them."""

    def __init__(self) -> None:
        self._waiting: dict[int, _Result] = {}
        self._batches = 0
        self.result: _Result

    def take(self, index: int, result: _Result) -> None:
        self._waiting[index] = result
        while self._batches in self._waiting:
            following = self._waiting.pop(self._batches)
            if self._batches:
                self.result.add(following)
            else:
                self.result = following
            self._batches += 1


def _simulate(estimator: Estimator, directions: Array, seed: int, batch: tuple[int, int]) -> _Result:
    # A batch by its number, and how many replicates it has; what is compared is the same on all machines.
    index, size = batch
    estimates, linear = estimator.simulate(np.random.default_rng([seed, STREAM, index]), size)
    true, predicted = estimator.true, estimator.covariance
    squares = ((estimates - true) ** 2 - (linear - true) ** 2) / np.diag(predicted)
    return _Result(
        Tally.of(estimates - true, predicted),
        Moments.of(squares),
        Moments.of(differences(estimates, linear, true, directions)),
        estimates[:SHOWN].copy(),
    )

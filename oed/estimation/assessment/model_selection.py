"""Other robots fitted to the logs that a study's own was fitted to, and the scores they are compared by.

Every model has the same readings, in the same segments, and noise in the same form, whose size and growth are
the most likely ones given that model. What was known of the parameters beforehand is left out.

Information criteria take from twice the logarithm of the likelihood a price for every number fitted, here
with the sign by which less is better. AICc = -2 ln L / c + 2 k + 2 k (k + 1) / (n / c - k - 1) looks for
the best prediction [Burnham, Anderson: Model selection and multimodel inference, 2002, sections 2.4, 2.5];
BIC = -2 ln L / c + k ln(n / c) for the true model, which it finds, where that is among them, the more surely
the more readings there are [Schwarz: Estimating the dimension of a model, 1978]. c says how many correlated
readings count as one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import scipy

from oed.estimation.assessment.covariance import LEVEL, Covariance
from oed.estimation.assessment.dead_reckoning import HeldOut, cross_validated
from oed.estimation.assessment.diagnostics import not_identified
from oed.estimation.assessment.likelihood import FittedReadings, Likelihood, Way, inflation
from oed.estimation.methods.beforehand import LOOSE
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.fitting import Fitting
from oed.estimation.preprocessing.preprocess import PreparedLogs
from oed.estimation.setup.options import CalibrationOptions
from oed.foundation.arrays import Array
from oed.foundation.errors import FileError, ProblemError
from oed.robots.models.model import Model

Measure = Literal["aicc", "bic", "held_out"]

UNKNOWN = math.sqrt(0.5) * LOOSE
"""Relative standard error from which on logs are less informative about parameters than their loose prior."""
MEASURES: tuple[Measure, ...] = ("aicc", "bic", "held_out")
"""What models are judged by, of each the less the better: two information criteria, and the position error
(RMS along a log, geometric mean of the logs) of dead reckoning of logs that a model was fitted without [m].
"""
SLIGHT = 2.0
"""Difference of information criteria up to which a model has as good as the best one's support [Burnham,
Anderson 2002, section 2.6; Kass, Raftery: Bayes factors, 1995]."""
ALIKE = 1.05
"""Ratio of position errors up to which models are practically equal, however surely they differ."""
LEAST = 1e-9
"""Smallest position error that is believed [m]."""
FEWEST_LOGS = 3
"""Logs from which on their disagreement gives an interval."""


@dataclass(frozen=True)
class Score:
    """One model by one measure.

    Attributes:
        value: the measure.
        difference: to the best model's.
        interval: of the difference, 95 % by how much it varies from log to log; None of too few logs, and of
            the best.
        equal: whether the model is as good as the best, for all that the logs show.
    """

    value: float
    difference: float
    interval: tuple[float, float] | None
    equal: bool


@dataclass(frozen=True)
class Compared:
    """One model.

    Attributes:
        name: in tables.
        robot: with its nominal values.
        parameters: names of those that were fitted, (p,).
        reason: why it cannot be compared; "" where it can.
        doubt: what speaks against its fit; "" for nothing.
        fit: the solution, None where there is none.
        covariance: of it.
        likelihood: of the readings, None where none can be given.
        cross_validation: each log by the others.
        scores: by measure.
    """

    name: str
    robot: Model
    parameters: tuple[str, ...]
    reason: str = ""
    doubt: str = ""
    fit: Fit | None = None
    covariance: Covariance | None = None
    likelihood: Likelihood | None = None
    cross_validation: tuple[HeldOut, ...] = ()
    scores: dict[Measure, Score] = field(default_factory=dict)

    @property
    def errors(self) -> Array:
        """Position error of every log by the others, (logs,) [m]; (0,) where there are none."""
        every = [one.rmse_position for held in self.cross_validation for one in held.after]
        return np.array([size for size in every if size is not None])

    @property
    def by_log(self) -> Array:
        """The likelihood's logarithm by logs, (logs,); (0,) where there is none."""
        if self.fit is None or self.likelihood is None:
            return np.zeros(0)
        layout = self.fit.layout
        return np.array([self.likelihood.each[layout.owner == log].sum() for log in range(len(layout.logs))])


@dataclass(frozen=True)
class Comparison:
    """Models side by side.

    Attributes:
        models: the study's own robot first.
        readings: their number, less the states of segments' starts.
        inflation: how many of them count as one, for their residuals are correlated.
        inflation_by: how that was found.
        best: the best model's name by every measure that there is.
    """

    models: tuple[Compared, ...]
    readings: float
    inflation: float
    inflation_by: Way
    best: dict[Measure, str]

    @property
    def agree(self) -> bool | None:
        """Whether all measures have the same best model; None of less than two measures."""
        return len(set(self.best.values())) == 1 if len(self.best) > 1 else None

    @property
    def favourites(self) -> tuple[str, ...]:
        """Models that are as good as the best by every measure, the simplest first."""
        able = [one for one in self.models if self.best and set(one.scores) == set(self.best)]
        equal = [one for one in able if all(score.equal for score in one.scores.values())]
        return tuple(one.name for one in sorted(equal, key=lambda one: len(one.parameters)))


def scored(models: Sequence[Compared], readings: float, inflation: float, way: Way) -> Comparison:
    """Fitted models with their scores.

    Args:
        models: those that can be compared have no reason why not.
        readings: number of readings, n.
        inflation: how many of them count as one, c.
        way: how that was found.
    """
    found, best = list(models), dict[Measure, str]()
    for measure in MEASURES:
        values = {
            place: value
            for place, one in enumerate(models)
            if not one.reason
            and (value := _value(one, measure, readings, inflation)) is not None
            and math.isfinite(value)
        }
        if not values:
            continue
        first = min(values, key=lambda place: values[place])
        best[measure] = models[first].name
        for place, value in values.items():
            score = _score(measure, models[place], models[first], value, values[first], inflation)
            found[place] = replace(found[place], scores={**found[place].scores, measure: score})
    return Comparison(tuple(found), readings, inflation, way, best)


def _value(one: Compared, measure: Measure, readings: float, inflation: float) -> float | None:
    if measure == "held_out":
        return float(np.exp(_logarithms(one).mean())) if len(one.errors) else None
    if one.likelihood is None:
        return None
    effective, starts = readings / inflation, one.likelihood.starts
    misfit = -2 * float(one.likelihood.each.sum()) / inflation
    if measure == "bic":
        # A start is identified by its own segment alone, and costs as much less, but no less than by AIC.
        each = math.log(max(effective / len(one.likelihood.each), 1.0))
        return misfit + one.likelihood.unknowns * math.log(effective) + starts * max(each, 2.0)
    count = one.likelihood.unknowns + starts
    left = effective - count - 1
    return misfit + 2 * count + 2 * count * (count + 1) / left if left > 0 else None


def _score(
    measure: Measure, one: Compared, first: Compared, value: float, least: float, inflation: float
) -> Score:
    difference = value - least
    if one is first:
        return Score(value, 0.0, None, equal=True)
    if measure == "held_out":
        half = _half_width(_logarithms(one) - _logarithms(first)) / len(one.errors)
        low, high = (
            value * math.exp(sign * half) - least if math.isfinite(half) else 0.0 for sign in (-1, 1)
        )
        alike = value <= ALIKE * least
    else:
        half = _half_width(2 / inflation * (one.by_log - first.by_log))
        low, high, alike = difference - half, difference + half, difference <= SLIGHT
    judged = math.isfinite(half)
    return Score(value, difference, (low, high) if judged else None, alike or (judged and low <= 0))


def _logarithms(one: Compared) -> Array:
    # Errors go with a log's length, so what counts are their ratios.
    return np.asarray(np.log(np.maximum(one.errors, LEAST)))


def _half_width(differences: Array) -> float:
    """Half the 95 % interval of a sum of differences (logs,), by how they vary; infinite of too few logs.

    Of likelihoods' logarithms that is what Vuong's test compares with [Vuong: Likelihood ratio tests for
    model selection and non-nested hypotheses, 1989], of prediction errors a paired t interval.
    """
    count = len(differences)
    if count < FEWEST_LOGS:
        return math.inf
    spread = math.sqrt(count) * float(np.std(differences, ddof=1))
    return float(scipy.stats.t.ppf((1 + LEVEL) / 2, count - 1)) * spread


@dataclass(frozen=True)
class ModelSelection:
    """How models are compared.

    Attributes:
        own: how the study's own robot is fitted.
        prepared: the logs.
        covariance: of a fit, as the study asks.
        announce: hears what is being done.
    """

    own: Fitting
    prepared: PreparedLogs
    covariance: Callable[[Fit], Covariance]
    announce: Callable[[str], None]

    def compared(self, fit: Fit) -> Comparison:
        """The study's robot, whose fit is given, beside its options' other models."""
        alike = replace(self.own, prior=None, options=_with_segments(self.own.options, fit))
        robot = self.own.robot.physical
        first = Compared(str(robot.kind), robot, self.own.parameters)
        known = self.own.prior is not None
        first = self._fitted(first, alike, robot) if known else replace(first, fit=fit)
        models = [first]
        for one in alike.options.models:
            self.announce(f"model {one.label}")
            robot = one.fitted_robot.system(alike.robot.integration)
            fitting = replace(alike, robot=robot, parameters=one.parameters)
            models.append(self._fitted(Compared(one.label, one.robot, one.parameters), fitting, one.robot))
        return self._scored(models, fit, alike)

    def _fitted(self, entry: Compared, fitting: Fitting, robot: Model) -> Compared:
        strangers = [name for name in self.prepared.logs[0].quantities if name not in robot.states]
        if strangers:
            return replace(entry, reason=f"the logs hold {', '.join(strangers)}, which it has not")
        try:
            fit = fitting.fitted(self._logs(robot)).fit
        except (ProblemError, FileError) as error:
            return replace(entry, reason="; ".join(issue.message for issue in error.issues))
        except np.linalg.LinAlgError:
            return replace(entry, reason="the search failed; are its nominal values near enough?")
        return replace(entry, fit=fit)

    def _logs(self, robot: Model) -> PreparedLogs:
        # With the inputs that it takes, in its order.
        names = self.own.robot.input_names
        chosen = [names.index(name) for name in robot.input_names]
        if chosen == list(range(len(names))):
            return self.prepared
        logs = tuple(replace(log, integrals=log.integrals[:, chosen]) for log in self.prepared.logs)
        return replace(self.prepared, logs=logs)

    def _scored(self, models: Sequence[Compared], fit: Fit, alike: Fitting) -> Comparison:
        block = None if alike.options.block == "auto" else float(alike.options.block)
        fits = [one.fit for one in models if one.fit is not None] or [fit]
        readings = FittedReadings.of(fits)
        judged = [self._judged(one, readings, alike) for one in models]
        # Of the most likely model the residuals are nearest to noise.
        able = [one for one in judged if not one.reason and one.likelihood is not None] or judged[:1]
        nearest = max(able, key=lambda one: float(one.by_log.sum()))
        reference = fit if nearest.fit is None else nearest.fit
        return scored(judged, readings.count, *inflation(reference, block))

    def _judged(self, one: Compared, readings: FittedReadings, alike: Fitting) -> Compared:
        if one.fit is None:
            return one
        fit, options = one.fit, alike.options
        doubt = "" if fit.converged else "its search did not converge: it may fit better than it seems"
        try:
            found = replace(one, covariance=self.covariance(fit), reason=_why_not(fit), doubt=doubt)
        except ProblemError as error:
            return replace(one, reason="; ".join(issue.message for issue in error.issues))
        if options.loss == "linear":
            found = replace(found, likelihood=readings.likelihood(fit, options))
        if {"x", "y"} <= set(fit.layout.quantities):
            found = replace(found, cross_validation=cross_validated(fit))
        return found


def _with_segments(options: CalibrationOptions, fit: Fit) -> CalibrationOptions:
    # Those that the study's own robot was fitted over.
    if fit.motions:
        return options
    seconds = fit.layout.seconds
    update: dict[str, object] = {"segment": seconds if math.isfinite(seconds) else "log"}
    if fit.correlated is not None and options.noise != "specified":
        update["noise"] = "correlated"
    return options.model_copy(update=update)


def _why_not(fit: Fit) -> str:
    # Why a fit cannot be compared.
    if not np.all(np.isfinite(fit.values)) or not np.all(np.isfinite(fit.residuals[fit.layout.valid])):
        return "the search failed; are its nominal values near enough?"
    hidden = [what for what, _ in not_identified(fit, fit.inverse, UNKNOWN)]
    return f"{'; '.join(hidden)}: leave parameters out of its `estimate`" if hidden else ""

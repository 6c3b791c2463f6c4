"""Other robots fitted to the logs that a study's own was fitted to, to be compared with it.

Every model has the same readings, in the same segments, and noise in the same form, whose size and growth are
the most likely ones given that model. What was known of the parameters beforehand is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.estimation.assessment.covariance import Covariance
from oed.estimation.assessment.dead_reckoning import cross_validated
from oed.estimation.assessment.diagnostics import not_identified
from oed.estimation.assessment.likelihood import FittedReadings, inflation
from oed.estimation.assessment.model_scores import Compared, Comparison, scored
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.fitting import LOOSE, Fitting
from oed.estimation.preprocessing.preprocess import PreparedLogs
from oed.estimation.setup.options import CalibrationOptions
from oed.foundation.errors import FileError, ProblemError
from oed.robots.models.model import Model

UNKNOWN = math.sqrt(0.5) * LOOSE
"""Relative standard error from which on logs are less informative about parameters than their loose prior."""


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
            return replace(entry, reason="; ".join(flaw.message for flaw in error.flaws))
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
        try:
            found = replace(one, covariance=self.covariance(fit), reason=_why_not(fit), doubt=_doubt(fit))
        except ProblemError as error:
            return replace(one, reason="; ".join(flaw.message for flaw in error.flaws))
        if options.loss == "linear":
            found = replace(found, likelihood=readings.likelihood(fit, options))
        if {"x", "y"} <= set(fit.layout.quantities):
            found = replace(found, cross_validation=cross_validated(fit))
        return found


def _with_segments(options: CalibrationOptions, fit: Fit) -> CalibrationOptions:
    # Those that the study's own robot was fitted over.
    if options.method != "joint":
        return options
    seconds = fit.layout.seconds
    return options.model_copy(update={"segment": seconds if math.isfinite(seconds) else "log"})


def _doubt(fit: Fit) -> str:
    return "" if fit.converged else "its search did not converge: it may fit better than it seems"


def _why_not(fit: Fit) -> str:
    # Why a fit cannot be compared.
    if not np.all(np.isfinite(fit.values)) or not np.all(np.isfinite(fit.residuals[fit.layout.valid])):
        return "the search failed; are its nominal values near enough?"
    hidden = [what for what, _ in not_identified(fit, fit.inverse, UNKNOWN)]
    return f"{'; '.join(hidden)}: leave parameters out of its `estimate`" if hidden else ""

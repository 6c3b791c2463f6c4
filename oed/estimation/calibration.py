"""From logs to parameters with honest error bars: `calibrate` does everything in turn."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from oed.estimation.assessment.by_likelihood import covariance_of, likeliest
from oed.estimation.assessment.cautions import cautions
from oed.estimation.assessment.covariance import Covariance
from oed.estimation.assessment.dead_reckoning import HeldOut, cross_validated, held_out
from oed.estimation.assessment.diagnostics import Diagnostic, diagnostics, weak_directions
from oed.estimation.assessment.doubts import Doubt, plausibility_doubts, stray_doubts
from oed.estimation.assessment.exactness import exact_doubts
from oed.estimation.assessment.further_sensors import odd_points, unread
from oed.estimation.assessment.input_noise import Dilution, dilution_doubts, dilution_of
from oed.estimation.assessment.model_selection import Comparison, ModelSelection
from oed.estimation.assessment.prior_weight import weighted_with_prior
from oed.estimation.assessment.trusted_covariance import covariances_of, expected_between_logs, few_blocks
from oed.estimation.methods.drift_rates import DriftRates, drift_rates
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.fitting import Fitting
from oed.estimation.methods.segment_length import Segmenting
from oed.estimation.methods.whole_logs import Likeliest
from oed.estimation.prediction.motion_layout import noise_specified
from oed.estimation.preprocessing.preprocess import PreparedLogs, preprocess, thinned, thinning_notes
from oed.estimation.preprocessing.steering_checks import steered_beyond
from oed.estimation.setup.options import CalibrationOptions, alternative_issues
from oed.estimation.setup.unknowns import PLACE
from oed.foundation.arrays import Array
from oed.foundation.equality import ByValue
from oed.foundation.errors import LogError, ProblemError
from oed.foundation.presenting import Brief
from oed.kernel.problem import Problem
from oed.logs.log import Log
from oed.robots.models.model import Model, robot_of

TOO_SHORT = (
    "too few and short logs for more than F^-1: where they drift, true errors are several times as large"
)
ITSELF_DRIFTING = (
    "dead reckoning is compared with the path that the relative poses make up, one after the other: it "
    "drifts itself, and what it drifts counts as dead reckoning's error"
)
CLOCKS_APART = 0.1
"""Offset of two clocks that is worth a warning [s]."""


@dataclass(frozen=True, repr=False, eq=False)
class Calibration(ByValue, Brief):
    """What logs say of a robot.

    Attributes:
        robot: whose parameters were estimated.
        fit: the solution.
        covariances: by the ways that apply, the chosen one first.
        segmenting: how the length of segments was found, None where it was given.
        drift: how fast the robot drifts, None of methods that compare windows and of relative poses.
        log_errors: the sizes of all that errs in whole logs, where these were fitted by likelihood.
        logs: that were used, with what was found in them.
        diagnostics: tests of what the fit leaves.
        weak_directions: what is not identifiable from the logs.
        doubts: of single estimates.
        dilution: what noise of the inputs may have done to the estimates, for which the covariances allow;
            None of methods that it is not known for.
        cross_validation: every log against the others.
        held_out: logs that were kept as test data, or None.
        own: the logs themselves where there are no others to judge by, or None.
        comparison: of other models with the study's robot, None where none are named.
        notes: what was decided on the way.
    """

    robot: Model
    fit: Fit
    covariances: tuple[Covariance, ...]
    segmenting: Segmenting | None
    drift: DriftRates | None
    log_errors: Likeliest | None
    logs: tuple[Log, ...]
    diagnostics: tuple[Diagnostic, ...]
    weak_directions: tuple[str, ...]
    doubts: tuple[Doubt, ...]
    dilution: Dilution | None
    cross_validation: tuple[HeldOut, ...]
    held_out: HeldOut | None
    own: HeldOut | None
    comparison: Comparison | None
    notes: tuple[str, ...]

    @property
    def drifts(self) -> bool | None:
        """Whether the logs show drift; None where they leave it open, or it was not asked."""
        if self.segmenting is None or self.segmenting.drifts or self.drift is None:
            return None if self.segmenting is None else self.segmenting.drifts
        return self.drift.shown

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of what was estimated, (p,)."""
        return self.fit.unknowns.parameters

    @property
    def values(self) -> Array:
        """Their values (p,), SI."""
        return np.asarray(self.fit.values[: len(self.parameters)])

    @property
    def covariance(self) -> Array:
        """Of the estimates, (p, p), SI, by the chosen way."""
        count = len(self.parameters)
        return np.asarray(self.covariances[0].matrix[:count, :count])

    @property
    def standard_deviations(self) -> dict[str, float]:
        """Of each parameter, SI."""
        return dict(zip(self.parameters, map(float, np.sqrt(np.diag(self.covariance))), strict=True))

    @property
    def coefficients(self) -> tuple[tuple[str, ...], Array, Array]:
        """Names, values and standard errors of the coefficients that the estimates give [Choi, eq. 6].

        Nothing where the estimates are coefficients themselves, or the robot has none; those that no estimate
        changes, such as one that is 0 by the robot's geometry, are no finding and are left out.
        """
        names, values, slopes = self._given_coefficients
        changed = np.any(slopes != 0, axis=1)
        names = tuple(name for name, one in zip(names, changed, strict=True) if one)
        values, slopes = values[changed], slopes[changed]
        return names, values, np.sqrt(np.diag(slopes @ self.covariance @ slopes.T))

    @property
    def effective_track(self) -> tuple[float, float] | None:
        """The distance of two wheels that would turn a robot without slip as this one turns, and its standard
        error [m]: the sum of c21 and c22 over the mean of c11 and -c12. None for robots without two sides.
        """
        names, values, slopes = self._given_coefficients
        if names[:4] != ("c11", "c12", "c21", "c22"):
            return None
        forward, turning = values[2] + values[3], (values[0] - values[1]) / 2
        track = forward / turning
        slope = (slopes[2] + slopes[3] - track * (slopes[0] - slopes[1]) / 2) / turning
        return float(track), float(np.sqrt(slope @ self.covariance @ slope))

    @cached_property
    def _given_coefficients(self) -> tuple[tuple[str, ...], Array, Array]:
        # Names, values, derivatives by the estimates.
        unknowns = self.fit.unknowns
        names, values, slopes = unknowns.coefficients(unknowns.parts(self.fit.values)[0])
        if set(names) & set(self.parameters):
            return (), np.zeros(0), np.zeros((0, len(self.parameters)))
        return names, values, slopes


def calibrate(
    problem: Problem,
    logs: Sequence[Log],
    options: CalibrationOptions | None = None,
    *,
    test_logs: Sequence[Log] = (),
    seed: int = 0,
    announce: Callable[[str], None] = lambda _: None,
) -> Calibration:
    """Estimate a robot's parameters from logs of its drives.

    Args:
        problem: names the robot, what to estimate, what is known before, and the measurement's noise.
        logs: to estimate from.
        options: how; the defaults suit a first look.
        test_logs: logs that only dead reckoning is tried on.
        seed: of the bootstrap.
        announce: hears what is being done.

    Raises:
        LogError: logs that do not fit the robot or each other, or hold no motion.
        ProblemError: options that do not fit the problem.
    """
    chosen = options or CalibrationOptions()
    work = _Work(problem, chosen, tuple(logs), seed, announce)
    return work.calibration(tuple(test_logs))


class _Judged(NamedTuple):
    # A fit, its covariances, and what they rest on.
    fit: Fit
    covariances: tuple[Covariance, ...]
    drift: DriftRates | None
    errors: Likeliest | None
    segmenting: Segmenting | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Work:
    # One calibration on its way.
    problem: Problem
    options: CalibrationOptions
    logs: tuple[Log, ...]
    seed: int
    announce: Callable[[str], None]

    def calibration(self, test_logs: tuple[Log, ...]) -> Calibration:
        issues = alternative_issues(robot_of(self.problem.model), self.options.models)
        if issues:
            raise ProblemError(issues)
        self.announce("comparing wheels and poses")
        found, other = self._prepared(test_logs)
        self.announce("fitting")
        fitted = self._fitting.fitted(found)
        self.announce("error bars")
        judged = self._judged(fitted.fit, fitted.segmenting)
        fit, rates, dilution = judged.fit, judged.drift, dilution_of(fitted.fit, self.seed)
        # The other ways stay what their names say.
        chosen, *others = judged.covariances
        if dilution is not None:
            chosen = replace(chosen, matrix=dilution.widened(chosen.matrix))
        self.announce("checks")
        logs = _with_clocks(found.logs, fit)
        alone = len(logs) == 1 and _has_positions(logs)
        return Calibration(
            robot=robot_of(self.problem.system),
            fit=fit,
            covariances=(chosen, *others),
            segmenting=judged.segmenting,
            drift=rates,
            log_errors=judged.errors,
            logs=logs,
            diagnostics=self._diagnostics(judged, logs),
            weak_directions=weak_directions(fit, chosen.matrix),
            doubts=self._doubts(found, judged, dilution),
            dilution=dilution,
            cross_validation=cross_validated(fit) if _has_positions(logs) else (),
            held_out=None if other is None else held_out(fit, fit.values, other.logs, _clocks(fit, other)),
            own=held_out(fit, fit.values, logs, fit.clocks_of(logs)) if alone else None,
            comparison=self._comparison(found, fitted.fit, judged),
            notes=(*self._notes(found, fitted.notes, judged), *fit.notes),
        )

    def _prepared(self, test_logs: tuple[Log, ...]) -> tuple[PreparedLogs, PreparedLogs | None]:
        found, other = self._preprocess(self.logs), self._preprocess(test_logs) if test_logs else None
        if other is not None and not _has_positions(other.logs):
            text = "dead reckoning needs positions to compare a test log with: name x and y in log.poses"
            raise LogError.about(other.logs[0].file, text)
        return found, other

    def _diagnostics(self, judged: _Judged, logs: Sequence[Log]) -> tuple[Diagnostic, ...]:
        expected = expected_between_logs(judged.fit, self.options, judged.covariances, judged.drift)
        return diagnostics(judged.fit, noise_specified(self.problem.measurement, logs), expected)

    def _doubts(self, found: PreparedLogs, judged: _Judged, dilution: Dilution | None) -> tuple[Doubt, ...]:
        fit, chosen = judged.fit, judged.covariances[0]
        doubts = exact_doubts(fit, noise_specified(self.problem.measurement, found.logs))
        doubts += stray_doubts(found.logs, self.options.loss)
        lost = set() if dilution is None else dilution.lost(fit.unknowns.parameters)
        doubts += plausibility_doubts(fit, chosen.matrix, lost)
        if dilution is not None:
            doubts += dilution_doubts(fit, dilution, chosen.matrix)
        doubts += odd_points(fit)
        if self.options.covariance != "auto":
            doubts += few_blocks(fit, self.options, judged.covariances, judged.drift)
        if len(judged.covariances) == 1 and not fit.correlated and judged.errors is None:
            doubts += (Doubt("", "short_logs", TOO_SHORT),)
        return doubts

    def _notes(self, found: PreparedLogs, of_fit: Sequence[str], judged: _Judged) -> list[str]:
        notes = [*thinning_notes(self.logs, found.logs), *of_fit]
        notes += [*unread(self.problem.measurement, found.logs), *judged.notes]
        rates, chosen = judged.drift, judged.covariances[0]
        notes += cautions(judged.fit, chosen, judged.segmenting, rates, judged.errors)
        if rates is not None and (judged.errors is not None or chosen.name == "drift"):
            notes.append(rates.words)
        return [*notes, ITSELF_DRIFTING] if found.relative else notes

    def _comparison(self, found: PreparedLogs, fit: Fit, judged: _Judged) -> Comparison | None:
        if not self.options.models:
            return None

        def covariance(other: Fit) -> Covariance:
            # The study's own robot has been judged already.
            of_it = judged if other is fit else self._judged(other, judged.segmenting)
            return of_it.covariances[0]

        return ModelSelection(self._fitting, found, covariance, self.announce).compared(fit)

    def _judged(self, plain: Fit, segmenting: Segmenting | None) -> _Judged:
        # The fit and how sure it is: of whole logs where these are asked for, else of what was fitted.
        if self.options.method != "likelihood":
            rates = drift_rates(plain)
            drifts = segmenting is not None and segmenting.drifts
            ways = covariances_of(plain, self.options, rates, drifts=drifts, seed=self.seed)
            fit, ways, notes = weighted_with_prior(plain, ways)
            return _Judged(fit, ways, rates, None, segmenting, notes)
        found = likeliest(plain, self.options, self.problem.measurement)
        chosen = None if segmenting is None else replace(segmenting, seconds=math.inf, fit=found.fit)
        rates = DriftRates.of_whole_logs(found)
        return _Judged(found.fit, (covariance_of(found),), rates, found, chosen)

    def _preprocess(self, logs: Sequence[Log]) -> PreparedLogs:
        # What is too long for a fit is too long for all that goes before and comes after it.
        robot, limits = robot_of(self.problem.system), self.problem.limits
        steered = [steered_beyond(log, robot, limits) for log in thinned(logs)]
        return preprocess(robot, steered, compare_clocks=self.options.clock_offset)

    @cached_property
    def _fitting(self) -> Fitting:
        robot = robot_of(self.problem.system)
        names = self.problem.estimated_of_system or tuple(parameter.name for parameter in robot.parameters)
        known = (*names, *PLACE)
        prior, measurement = self._prior(known), self.problem.measurement
        return Fitting(robot, names, measurement, self.options, prior, known)

    def _prior(self, names: Sequence[str]) -> Array | None:
        # Prior information on parameters and the sensor's place, (n, n).
        if self.problem.prior is None:
            return None
        matrix, constants = np.zeros((len(names),) * 2), self.problem.constants
        for one in self.problem.any_estimations:
            # A constant may go by its sensor's label.
            called = [
                constants[name].name.rpartition(".")[2] if name in constants else name
                for name in one.parameters
            ]
            own = [index for index, name in enumerate(called) if name in names]
            if one.prior is not None and own:
                places = [names.index(called[index]) for index in own]
                matrix[np.ix_(places, places)] += one.prior[np.ix_(own, own)]
        return matrix


def _clocks(fit: Fit, other: PreparedLogs) -> list[float]:
    # Of logs from a file of the fit as that has them.
    known = dict(zip(fit.layout.clocks, map(float, fit.clock_offsets), strict=True))
    return [known.get(log.file, own) for log, own in zip(other.logs, other.clocks, strict=True)]


def _has_positions(logs: Sequence[Log]) -> bool:
    return {"x", "y"} <= set(logs[0].quantities)


def _with_clocks(logs: tuple[Log, ...], fit: Fit) -> tuple[Log, ...]:
    found = []
    for log, offset in zip(logs, fit.clocks_of(logs), strict=True):
        if abs(offset) > CLOCKS_APART:
            text = f"the wheels' clock is {offset:+.3f} s off the poses'; estimated and taken into account"
            log = log.found("clock_offset", text)
        found.append(log)
    return tuple(found)

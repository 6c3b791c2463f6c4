"""From logs to parameters with honest error bars: `calibrate` does everything in turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from oed.estimation.assessment.covariance import (
    Covariance,
    blocks_of,
    bootstrap,
    information,
    judgeable,
    sandwich,
)
from oed.estimation.assessment.dead_reckoning import HeldOut, cross_validated, held_out
from oed.estimation.assessment.diagnostics import Diagnostic, diagnostics, weak_directions
from oed.estimation.assessment.model_selection import Comparison, ModelSelection
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.fitting import Fitting, Segmenting
from oed.estimation.preprocessing.preprocess import PreparedLogs, preprocess, thinned, thinning_notes
from oed.estimation.setup.noise import groups, places_of, specified_noise
from oed.estimation.setup.options import CalibrationOptions, alternative_flaws
from oed.foundation.arrays import Array
from oed.foundation.errors import LogError, ProblemError
from oed.foundation.moved import Renamed
from oed.foundation.presenting import Brief
from oed.kernel.measurement.measurement import Measurement
from oed.kernel.measurement.sensor import sensor_labels
from oed.kernel.problem import Problem
from oed.logs.log import Log
from oed.robots.models.model import Model, robot_of
from oed.robots.sensors.logged import LoggedSensor

TOO_SHORT = (
    "too few and short logs for more than F^-1: where they drift, true errors are several times as large"
)
ODD_WHEEL = 0.3
"""Change of a wheel's radius that looks like a mistake."""
ODD_POINT = 3.0
"""How many times as far off as others a landmark is that looks like a mistake."""
CLOCKS_APART = 0.1
"""Offset of two clocks that is worth a warning [s]."""


@dataclass(frozen=True, repr=False)
class Calibration(Brief, Renamed):
    """What logs say of a robot.

    Attributes:
        robot: whose parameters were estimated.
        fit: the solution.
        covariances: by the ways that apply, the chosen one first.
        segmenting: how the length of segments was found, None where it was given.
        logs: that were used, with what was found in them.
        diagnostics: tests of what the fit leaves.
        weak_directions: what is not identifiable from the logs.
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
    logs: tuple[Log, ...]
    diagnostics: tuple[Diagnostic, ...]
    weak_directions: tuple[str, ...]
    cross_validation: tuple[HeldOut, ...]
    held_out: HeldOut | None
    own: HeldOut | None
    comparison: Comparison | None
    notes: tuple[str, ...]

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

        Nothing where the estimates are coefficients themselves, or the robot has none.
        """
        names, values, slopes = self._given_coefficients
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


@dataclass(frozen=True)
class _Work:
    # One calibration on its way.
    problem: Problem
    options: CalibrationOptions
    logs: tuple[Log, ...]
    seed: int
    announce: Callable[[str], None]

    def calibration(self, test_logs: tuple[Log, ...]) -> Calibration:
        flaws = alternative_flaws(robot_of(self.problem.model), self.options.models)
        if flaws:
            raise ProblemError(flaws)
        self.announce("comparing wheels and poses")
        found, other = self._preprocess(self.logs), self._preprocess(test_logs) if test_logs else None
        if other is not None and not _has_positions(other.logs):
            text = "dead reckoning needs positions to compare with"
            raise LogError.about(other.logs[0].file, text)
        self.announce("fitting")
        fitted = self._fitting.fitted(found)
        segmenting, fit = fitted.segmenting, fitted.fit
        notes = [*thinning_notes(self.logs, found.logs), *fitted.notes]
        notes += _unread(self.problem.measurement, found.logs)
        self.announce("error bars")
        covariances = self._covariances(fit, segmenting)
        if len(covariances) == 1 and (fit.motions or (segmenting is not None and segmenting.drifts)):
            notes.append(TOO_SHORT)
        notes += [*_odd_wheels(fit), *_odd_points(fit)]
        self.announce("checks")
        logs = _with_clocks(found.logs, fit)
        alone = len(logs) == 1 and _has_positions(logs)
        return Calibration(
            robot=robot_of(self.problem.system),
            fit=fit,
            covariances=covariances,
            segmenting=segmenting,
            logs=logs,
            diagnostics=diagnostics(fit, specified_noise(self.problem.measurement, logs[0].averaged)),
            weak_directions=weak_directions(fit, covariances[0].matrix),
            cross_validation=cross_validated(fit) if _has_positions(logs) else (),
            held_out=None if other is None else held_out(fit, fit.values, other.logs, other.clocks),
            own=held_out(fit, fit.values, logs, fit.clocks_of(logs)) if alone else None,
            comparison=self._comparison(found, fit, segmenting),
            notes=(*notes, *fit.notes),
        )

    def _comparison(self, found: PreparedLogs, fit: Fit, segmenting: Segmenting | None) -> Comparison | None:
        if not self.options.models:
            return None

        def covariance(other: Fit) -> Covariance:
            return self._covariances(other, segmenting)[0]

        return ModelSelection(self._fitting, found, covariance, self.announce).compared(fit)

    def _preprocess(self, logs: Sequence[Log]) -> PreparedLogs:
        # What is too long for a fit is too long for all that goes before and comes after it.
        compare = self.options.clock_offset
        return preprocess(robot_of(self.problem.system), thinned(logs), compare_clocks=compare)

    @cached_property
    def _fitting(self) -> Fitting:
        robot = robot_of(self.problem.system)
        names = self.problem.estimate or tuple(parameter.name for parameter in robot.parameters)
        prior, measurement = self._prior(names), self.problem.measurement
        return Fitting(robot, names, measurement, self.options, prior)

    def _prior(self, parameters: Sequence[str]) -> Array | None:
        # Prior information on the parameters, (p, p).
        if self.problem.prior is None:
            return None
        matrix = np.zeros((len(parameters),) * 2)
        for one in self.problem.any_estimations:
            own = [index for index, name in enumerate(one.parameters) if name in parameters]
            if one.prior is not None and own:
                places = [parameters.index(one.parameters[index]) for index in own]
                matrix[np.ix_(places, places)] += one.prior[np.ix_(own, own)]
        return matrix

    def _covariances(self, fit: Fit, segmenting: Segmenting | None) -> tuple[Covariance, ...]:
        block = None if self.options.block == "auto" else float(self.options.block)
        blocks, rng = blocks_of(fit, block), np.random.default_rng(self.seed)
        found = [information(fit)]
        # From very few parts their disagreement cannot be judged.
        if judgeable(fit, blocks):
            found += [sandwich(fit, blocks), bootstrap(fit, blocks, self.options.replicates, rng)]
        wanted = self.options.covariance
        if wanted == "auto":
            drifts = segmenting is None or segmenting.drifts
            wanted = "bootstrap" if drifts and len(found) > 1 else "information"
        if wanted not in [one.name for one in found]:
            text = (
                f"the logs are too short for {wanted}: {blocks.independent} blocks; log more, or information"
            )
            raise ProblemError.about(("calibration", "covariance"), text)
        return tuple(sorted(found, key=lambda one: one.name != wanted))


def _unread(measurement: Measurement, logs: Sequence[Log]) -> list[str]:
    # Sensors of the study that the estimate knows nothing of.
    sensors, read = measurement.joint_sensors, {one.sensor for log in logs for one in log.sensors}
    states = set(logs[0].quantities)
    return [
        f"{label} is not used: the logs have no readings of it (`log: sensors: {label}` says where they are)"
        for label, sensor in zip(sensor_labels(sensors), sensors, strict=True)
        if label not in read
        and not (isinstance(sensor, LoggedSensor) and (set(sensor.noises) & states or not sensor.noises))
    ]


def _odd_wheels(fit: Fit) -> list[str]:
    # Nobody measures a wheel that wrongly; a gear or a unit is soon forgotten.
    table = {parameter.name: parameter.nominal for parameter in fit.unknowns.robot.parameters}
    found = zip(fit.unknowns.parameters, fit.values, strict=False)
    changes = {name: value / table[name] - 1 for name, value in found if name.startswith("wheel_radius")}
    return [
        f"{name} is {change:+.0%} off its nominal value: check ticks_per_turn, gear and units"
        for name, change in changes.items()
        if abs(change) > ODD_WHEEL
    ]


def _odd_points(fit: Fit) -> list[str]:
    # A landmark that stands elsewhere than the study has it, or another one of that id.
    quantities, notes = fit.layout.quantities, list[str]()
    for group in groups(quantities):
        own = [place for place in places_of(group, quantities) if quantities[place].endswith("]")]
        left = np.where(fit.layout.valid, fit.residuals, 0.0)[..., own]
        counts = fit.layout.valid[..., own].sum(axis=(0, 1))
        sizes = np.sqrt((left**2).sum(axis=(0, 1)) / np.maximum(counts, 1))
        usual = float(np.median(sizes[sizes > 0])) if np.count_nonzero(sizes) > 2 else np.inf
        notes += [
            f"{quantities[place]} is {size / usual:.0f} times as far off as others of its kind: is its place "
            "in the study right, and is it the one of that id?"
            for place, size in zip(own, sizes, strict=True)
            if size > ODD_POINT * usual
        ]
    return notes


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

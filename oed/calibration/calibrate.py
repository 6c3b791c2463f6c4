"""From logs to parameters with honest error bars: `calibrate` does everything in turn."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from oed.calibration.clocks import clock_offsets
from oed.calibration.covariance import Covariance, blocks_of, bootstrap, information, sandwich
from oed.calibration.diagnostics import Diagnostic, diagnostics
from oed.calibration.joint import Fit, JointSearch, Knowledge
from oed.calibration.layout import Layout, cut, stretches
from oed.calibration.left_out import HeldOut, held_out, leave_out
from oed.calibration.motion import Moves
from oed.calibration.noise import Noise, group_of
from oed.calibration.options import CalibrationOptions
from oed.calibration.segmenting import Segmenting, longest_without_drift
from oed.calibration.suspicion import poorly_explained, suspicion
from oed.calibration.unknowns import Unknowns
from oed.calibration.untold import untold
from oed.calibration.window_fit import window_fit
from oed.errors import FileFlaw, Flaw, LogError, ProblemError
from oed.logs.log import Log
from oed.measurements.measurement import Measurement
from oed.measurements.poses import Poses
from oed.measurements.sensor import PlacedSensor
from oed.measurements.several import sensors_of
from oed.models.coefficient_robot import coefficient_values
from oed.models.model import Integration, Model
from oed.problem import Problem, prior_of
from oed.segments import PLACE

Array = npt.NDArray[np.float64]

LOOSE = 1.0
"""Standard deviation that parameters are given before the logs, relative to their sizes: it keeps the
search in bounds where the logs tell nothing, and is nothing beside what they tell."""
LOOSE_PLACE, LOOSE_CLOCK = 0.3, 0.5
"""The same of the sensor's place [m, rad] and of a clock's offset [s]."""
TOLD = 1e-8
"""Share of what is told of a parameter alone, below which the sensor's place hides it."""
CLOCKS_APART = 0.1
"""Offset of two clocks that is worth a warning [s]."""


@dataclass(frozen=True)
class Calibration:
    """What logs say of a robot.

    Attributes:
        robot: whose parameters were estimated.
        integration: rule by which its poses follow from its twist.
        fit: the solution.
        covariances: by the ways that apply, the chosen one first.
        segmenting: how the length of segments was found, None where it was given.
        logs: that were used, with what was found in them.
        diagnostics: tests of what the fit leaves.
        untold: what the logs do not tell.
        left_out: every log against the others.
        held_out: logs that were kept apart, or None.
        notes: what was decided on the way.
    """

    robot: Model
    integration: Integration
    fit: Fit
    covariances: tuple[Covariance, ...]
    segmenting: Segmenting | None
    logs: tuple[Log, ...]
    diagnostics: tuple[Diagnostic, ...]
    untold: tuple[str, ...]
    left_out: tuple[HeldOut, ...]
    held_out: HeldOut | None
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

    @cached_property
    def coefficients(self) -> tuple[tuple[str, ...], Array, Array]:
        """Names, values and standard errors of the coefficients that the estimates give [Choi, eq. 6].

        Nothing where the estimates are coefficients themselves, or the robot has none.
        """
        names, values, slopes = coefficient_values(self.robot, self.fit.unknowns.parts(self.fit.values)[0])
        if not names or set(names) & set(self.parameters):
            return (), np.zeros(0), np.zeros(0)
        known = [parameter.name for parameter in self.robot.parameters]
        own = slopes[:, [known.index(name) for name in self.parameters]]
        return names, values, np.sqrt(np.diag(own @ self.covariance @ own.T))


def calibrate(
    problem: Problem,
    logs: Sequence[Log],
    options: CalibrationOptions | None = None,
    *,
    apart: Sequence[Log] = (),
    seed: int = 0,
    told: Callable[[str], None] = lambda _: None,
) -> Calibration:
    """Estimate a robot's parameters from logs of its drives.

    Args:
        problem: names the robot, what to estimate, what is known before, and the measurement's noise.
        logs: to estimate from.
        options: how; the defaults suit a first look.
        apart: logs that only dead reckoning is tried on.
        seed: of the bootstrap.
        told: hears what is being done.

    Raises:
        LogError: logs that do not fit the robot or each other, or hold no motion.
        ProblemError: options that do not fit the problem.
    """
    chosen = options or CalibrationOptions()
    work = _Work(problem, chosen, tuple(logs), seed, told)
    return work.calibration(tuple(apart))


@dataclass(frozen=True)
class _Work:
    # One calibration on its way.
    problem: Problem
    options: CalibrationOptions
    logs: tuple[Log, ...]
    seed: int
    told: Callable[[str], None]

    def calibration(self, apart: tuple[Log, ...]) -> Calibration:
        _require_alike(self.logs)
        _require_motion((*self.logs, *apart))
        logs, offsets = self._on_one_clock(self.logs)
        unknowns, notes = self._unknowns(logs), list[str]()
        self.told("fitting")
        segmenting, fit = self._fitted(logs, offsets, unknowns)
        hidden = _hidden_by_place(fit)
        if hidden:
            notes.append(f"{', '.join(hidden)} cannot be told from the parameters: taken as the study has it")
            unknowns = replace(unknowns, place=tuple(set_ for set_ in unknowns.place if set_ not in hidden))
            segmenting, fit = self._fitted(logs, offsets, unknowns)
        self.told("error bars")
        covariances = self._covariances(fit, segmenting)
        self.told("checks")
        return Calibration(
            robot=self.problem.robot,
            integration=self._integration,
            fit=fit,
            covariances=covariances,
            segmenting=segmenting,
            logs=_with_clocks(logs, fit),
            diagnostics=diagnostics(fit, stated_noise(self.problem.measurement)),
            untold=untold(fit, covariances[0].matrix),
            left_out=leave_out(fit, self._integration) if _reckonable(logs) else (),
            held_out=self._held_out(apart, fit),
            notes=(*notes, *fit.notes),
        )

    @property
    def _integration(self) -> Integration:
        return self.problem.design.integration

    def _on_one_clock(self, logs: tuple[Log, ...]) -> tuple[tuple[Log, ...], Array]:
        # What is plainly wrong is refused; the clocks' offsets come by file.
        self.told("comparing wheels and poses")
        moves = Moves.of(self.problem.robot, self._integration, logs)
        files = moves.layout.clocks
        offsets = clock_offsets(moves) if self.options.clock_offset else np.zeros(len(files))
        flaws, doubts = [], dict[str, str]()
        for index, file in enumerate(files):
            own = moves.within(moves.layout.clock == index)
            wrong = suspicion(own, offsets)
            if wrong is not None:
                flaws.append(FileFlaw(file, 0, 0, "", wrong))
                continue
            left = poorly_explained(own, offsets)
            if left is not None:
                doubts[file] = f"the wheels leave {left:.0%} of the measured motion unexplained"
        if flaws:
            raise LogError(flaws)
        found = tuple(
            log.found("poorly_explained", doubts[log.file], doubtful=True) if log.file in doubts else log
            for log in logs
        )
        return found, offsets

    def _unknowns(self, logs: tuple[Log, ...]) -> Unknowns:
        robot, problem = self.problem.robot, self.problem
        known = tuple(parameter.name for parameter in robot.parameters)
        sits = sensor_place(problem.measurement)
        place = [name for name in self.options.sensor_place if name in _told_places(logs[0].quantities)]
        if any(sits):
            place = [name for name in place if name == "sensor_heading"]
        clocks = len({log.file for log in logs}) if self.options.clock_offset else 0
        return Unknowns(robot, problem.estimate or known, tuple(place), clocks, sits)

    def _fitted(
        self, logs: tuple[Log, ...], offsets: Array, unknowns: Unknowns
    ) -> tuple[Segmenting | None, Fit]:
        files = list(dict.fromkeys(log.file for log in logs))
        clocks = [float(offsets[files.index(log.file)]) for log in logs]
        last: list[Array] = []

        def layout(seconds: float) -> Layout:
            return cut(logs, seconds, clocks)

        def fit(segments: Layout) -> Fit:
            found = self._search(segments, unknowns, offsets).fit(last[-1] if last else None)
            last.append(found.values)
            return found

        if self.options.method != "joint":
            known, stated = self._known(unknowns), self._stated(logs[0].quantities)
            found = window_fit(self.options, layout, unknowns, self._integration, offsets, known, stated)
            return None, found
        if self.options.segment == "auto":
            segmenting = longest_without_drift(layout, fit)
            return segmenting, segmenting.fit
        seconds = math.inf if self.options.segment == "log" else self.options.segment
        return None, fit(layout(seconds))

    def _search(self, layout: Layout, unknowns: Unknowns, offsets: Array) -> JointSearch:
        return JointSearch(
            layout,
            unknowns,
            self._integration,
            offsets,
            self.options.loss,
            grows=self.options.noise == "estimated",
            known=self._known(unknowns),
            stated=self._stated(layout.quantities),
        )

    def _stated(self, quantities: Sequence[str]) -> dict[str, Noise] | None:
        # The noise that is not to be estimated.
        if self.options.noise != "stated":
            return None
        stated = stated_noise(self.problem.measurement)
        missing = [name for name in quantities if group_of(name) not in stated]
        if missing:
            text = f"the measurement states no noise of {', '.join(missing)}; use noise: estimated"
            raise ProblemError([Flaw(("calibration", "noise"), text)])
        return stated

    def _known(self, unknowns: Unknowns) -> Knowledge:
        count = len(unknowns.parameters)
        loose = LOOSE * unknowns.scale
        loose[count:] = LOOSE_PLACE
        loose[unknowns.size - unknowns.clocks :] = LOOSE_CLOCK
        matrix = np.diag(loose**-2)
        if self.problem.prior is not None:
            for one in self.problem.any_estimations:
                names = [name for name in one.parameters if name in unknowns.parameters]
                prior = prior_of(self.problem.prior, one.block, names)
                if prior is not None:
                    places = [unknowns.parameters.index(name) for name in names]
                    matrix[np.ix_(places, places)] += prior
        return Knowledge(matrix, unknowns.nominal)

    def _covariances(self, fit: Fit, segmenting: Segmenting | None) -> tuple[Covariance, ...]:
        block = None if self.options.block == "auto" else float(self.options.block)
        blocks, rng = blocks_of(fit, block), np.random.default_rng(self.seed)
        found = [information(fit)]
        # From a handful of parts their disagreement cannot be judged.
        if blocks.independent > fit.unknowns.size:
            found += [sandwich(fit, blocks), bootstrap(fit, blocks, self.options.replicates, rng)]
        wanted = self.options.covariance
        if wanted == "auto":
            drifts = segmenting is None or segmenting.drifts
            wanted = "bootstrap" if drifts and len(found) > 1 else "information"
        if wanted not in [one.name for one in found]:
            text = (
                f"the logs are too short for {wanted}: {blocks.independent} blocks; log more, or information"
            )
            raise ProblemError([Flaw(("calibration", "covariance"), text)])
        return tuple(sorted(found, key=lambda one: one.name != wanted))

    def _held_out(self, apart: tuple[Log, ...], fit: Fit) -> HeldOut | None:
        if not apart:
            return None
        if not _reckonable(apart):
            raise LogError(
                [FileFlaw(apart[0].file, 0, 0, "", "dead reckoning needs positions to compare with")]
            )
        logs, offsets = self._on_one_clock(apart)
        files = list(dict.fromkeys(log.file for log in logs))
        clocks = [float(offsets[files.index(log.file)]) for log in logs]
        parameters, place, _ = fit.unknowns.parts(fit.values)
        return held_out(self.problem.robot, self._integration, logs, parameters, place, clocks)


def stated_noise(measurement: Measurement) -> dict[str, Noise]:
    """The noise of absolute poses that a measurement states, by kind of reading."""
    found = {}
    for sensor in sensors_of(measurement):
        if not isinstance(sensor, Poses) or sensor.noise.covariance is not None:
            continue
        for quantity in sensor.quantities:
            size = sensor.noise.deviation(quantity)
            if size is not None:
                found[group_of(quantity)] = Noise(size, sensor.noise.per_speed(quantity))
    return found


def sensor_place(measurement: Measurement) -> tuple[float, float, float]:
    """Where the study says that the pose sensor sits: ahead, to the left [m], not turned."""
    placed = [one for one in sensors_of(measurement) if isinstance(one, PlacedSensor)]
    return (placed[0].lever_arm.x, placed[0].lever_arm.y, 0.0) if placed else (0.0, 0.0, 0.0)


def _told_places(quantities: Sequence[str]) -> tuple[str, ...]:
    # Without positions a lever arm shows in nothing; without a heading nothing tells how it is turned.
    if not {"x", "y"} <= set(quantities):
        return ()
    return PLACE if "heading" in quantities else PLACE[:2]


def _hidden_by_place(fit: Fit) -> tuple[str, ...]:
    # Coordinates of the sensor that exactly make up for parameters: c21, c22 and a sensor off to the side.
    count, names = len(fit.unknowns.parameters), fit.unknowns.place
    matrix = fit.information.sum(axis=0)
    scale = np.sqrt(np.where(np.diag(matrix) > 0, np.diag(matrix), 1.0))
    unit = matrix / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(unit)
    lost = vectors[:, values < TOLD]
    if not np.any(np.abs(lost[:count]) > 1e-3):
        return ()
    shares = np.abs(lost[count : count + len(names)]).max(axis=1, initial=0.0)
    return tuple(name for name, share in zip(names, shares, strict=True) if share > 1e-3)


def _require_alike(logs: tuple[Log, ...]) -> None:
    first = logs[0]
    flaws = [
        FileFlaw(
            log.file,
            0,
            0,
            "",
            f"holds {', '.join(log.quantities)}, {first.name} {', '.join(first.quantities)}",
        )
        for log in logs
        if log.quantities != first.quantities
    ]
    if flaws:
        raise LogError(flaws)


def _require_motion(logs: tuple[Log, ...]) -> None:
    text = "no poses while the wheels are logged; do the two clocks begin together?"
    flaws = [FileFlaw(log.file, 0, 0, "", text) for log in logs if not stretches(log, 0.0)]
    if flaws:
        raise LogError(flaws)


def _reckonable(logs: Sequence[Log]) -> bool:
    return {"x", "y"} <= set(logs[0].quantities)


def _with_clocks(logs: tuple[Log, ...], fit: Fit) -> tuple[Log, ...]:
    found = []
    for log in logs:
        offset = float(fit.clock_offsets[fit.layout.clocks.index(log.file)])
        if abs(offset) > CLOCKS_APART:
            text = f"the wheels' clock is {offset:+.3f} s off the poses'; estimated and taken into account"
            log = log.found("clock_offset", text)
        found.append(log)
    return tuple(found)

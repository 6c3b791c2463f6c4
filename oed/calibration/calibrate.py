"""From logs to parameters with honest error bars: `calibrate` does everything in turn."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from oed.calibration.covariance import Covariance, blocks_of, bootstrap, information, sandwich
from oed.calibration.diagnostics import Diagnostic, diagnostics
from oed.calibration.joint import Fit, JointSearch, Knowledge
from oed.calibration.layout import Layout, cut
from oed.calibration.left_out import HeldOut, held_out, leave_out
from oed.calibration.noise import Noise, group_of
from oed.calibration.options import CalibrationOptions
from oed.calibration.ready import ReadyLogs, ready
from oed.calibration.segmenting import Segmenting, longest_without_drift
from oed.calibration.stated import Mount, stated_mount, stated_noise
from oed.calibration.unknowns import Unknowns
from oed.calibration.untold import untold
from oed.calibration.window_fit import window_fit
from oed.errors import FileFlaw, Flaw, LogError, ProblemError
from oed.logs.log import Log
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
FEWEST_BLOCKS = 4
"""Blocks that do not overlap, without which neither sandwich nor bootstrap means anything."""
ASKEW = 0.5
"""Angle by which a sensor has to be turned on the robot for the search to start from there [rad]."""
TOO_SHORT = (
    "too few and short logs for more than F^-1: where they drift, true errors are several times as large"
)
ODD_WHEEL = 0.3
"""Change of a wheel's radius that looks like a mistake."""
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
        own: the logs themselves where there are no others to judge by, or None.
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
    own: HeldOut | None
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
        names, values, slopes = coefficient_values(self.robot, self.fit.unknowns.parts(self.fit.values)[0])
        if not names or set(names) & set(self.parameters):
            return (), np.zeros(0), np.zeros((0, len(self.parameters)))
        known = [parameter.name for parameter in self.robot.parameters]
        return names, values, slopes[:, [known.index(name) for name in self.parameters]]


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
        self.told("comparing wheels and poses")
        found, other = self._ready(self.logs), self._ready(apart) if apart else None
        if other is not None and not _reckonable(other.logs):
            text = "dead reckoning needs positions to compare with"
            raise LogError([FileFlaw(other.logs[0].file, 0, 0, "", text)])
        unknowns, notes = self._unknowns(found), list[str]()
        self.told("fitting")
        segmenting, fit = self._fitted(found, unknowns)
        _require_enough(fit)
        hidden = _hidden_by_place(fit)
        if hidden:
            notes.append(f"{', '.join(hidden)} cannot be told from the parameters: taken as the study has it")
            unknowns = replace(unknowns, place=tuple(name for name in unknowns.place if name not in hidden))
            segmenting, fit = self._fitted(found, unknowns)
        self.told("error bars")
        covariances = self._covariances(fit, segmenting)
        if len(covariances) == 1 and (fit.motions or (segmenting is not None and segmenting.drifts)):
            notes.append(TOO_SHORT)
        notes += _odd_wheels(fit)
        self.told("checks")
        logs = _with_clocks(found.logs, fit)
        fitted_clocks = [float(fit.clock_offsets[fit.layout.clocks.index(log.file)]) for log in logs]
        return Calibration(
            robot=self.problem.robot,
            integration=self._integration,
            fit=fit,
            covariances=covariances,
            segmenting=segmenting,
            logs=logs,
            diagnostics=diagnostics(fit, stated_noise(self.problem.measurement)),
            untold=untold(fit, covariances[0].matrix),
            left_out=leave_out(fit, self._integration) if _reckonable(logs) else (),
            held_out=None if other is None else self._held_out(other.logs, other.clocks, fit),
            own=self._held_out(logs, fitted_clocks, fit) if len(logs) == 1 and _reckonable(logs) else None,
            notes=(*notes, *fit.notes),
        )

    @property
    def _integration(self) -> Integration:
        return self.problem.design.integration

    def _ready(self, logs: Sequence[Log]) -> ReadyLogs:
        return ready(self.problem.robot, self._integration, logs, compare_clocks=self.options.clock_offset)

    @cached_property
    def _mount(self) -> Mount:
        return stated_mount(self.problem.measurement)

    def _unknowns(self, found: ReadyLogs) -> Unknowns:
        robot, mount = self.problem.robot, self._mount
        known = tuple(parameter.name for parameter in robot.parameters)
        free = [name for name in self.options.sensor_place if name in _told_places(found.logs[0].quantities)]
        if mount.fixed:
            free = [name for name in free if name == "sensor_heading"]
        clocks = len(found.files) if self.options.clock_offset else 0
        # A sensor that looks backwards is found from there only.
        turned = found.mounting if "sensor_heading" in free and abs(found.mounting) > ASKEW else 0.0
        sits = (*mount.sits[:2], turned)
        return Unknowns(robot, self.problem.estimate or known, tuple(free), clocks, sits)

    def _fitted(self, ready_logs: ReadyLogs, unknowns: Unknowns) -> tuple[Segmenting | None, Fit]:
        logs, offsets = ready_logs.logs, ready_logs.offsets
        last: list[Array] = []

        def layout(seconds: float) -> Layout:
            return cut(logs, seconds, ready_logs.clocks)

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
        for index, name in enumerate(unknowns.place):
            loose[count + index] = self._mount.deviations.get(name, LOOSE_PLACE)
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
        # From very few parts their disagreement cannot be judged.
        common = fit.unknowns.size - fit.unknowns.clocks
        if blocks.independent >= FEWEST_BLOCKS and len(blocks.ranges) > common:
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

    def _held_out(self, logs: Sequence[Log], clocks: Sequence[float], fit: Fit) -> HeldOut:
        parameters, place, _ = fit.unknowns.parts(fit.values)
        return held_out(self.problem.robot, self._integration, logs, parameters, place, clocks)


def _told_places(quantities: Sequence[str]) -> tuple[str, ...]:
    # Without positions a lever arm shows in nothing; without a heading nothing tells how it is turned.
    if not {"x", "y"} <= set(quantities):
        return ()
    return PLACE if "heading" in quantities else PLACE[:2]


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


def _require_enough(fit: Fit) -> None:
    # As many unknowns as readings fit anything without error.
    told, starts = int(fit.layout.valid.sum()), fit.layout.count
    readings, states = told * len(fit.layout.quantities), starts * fit.starts.shape[1]
    if fit.motions:
        readings, states = starts * len(fit.layout.quantities), 0
    if readings <= states + fit.unknowns.size:
        text = f"{readings} readings cannot tell {states + fit.unknowns.size} unknowns; log more poses"
        raise LogError([FileFlaw(fit.layout.logs[0].file, 0, 0, "", text)])


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

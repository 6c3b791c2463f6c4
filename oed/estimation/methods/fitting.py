"""One robot fitted to preprocessed logs: what is unknown, with which noise, over which segments."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.estimation.methods.beforehand import known_before, punctual
from oed.estimation.methods.correlated_readings import CorrelatedReadings
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gauss_markov import GaussMarkov
from oed.estimation.methods.gls import WeightedWindows
from oed.estimation.methods.joint import JointSearch
from oed.estimation.methods.noise_selection import has_lasting_form
from oed.estimation.methods.segment_length import (
    Segmenting,
    if_bounded,
    lengths_tried,
    longest_without_drift,
)
from oed.estimation.methods.two_stage import TwoStage
from oed.estimation.methods.windows import Windows
from oed.estimation.prediction.layout import FEWEST, SegmentLayout, cut, usual_step
from oed.estimation.prediction.motion_layout import motion_segments, noise_specified, with_usual_motions
from oed.estimation.prediction.segments import Labelled, nuisances_of
from oed.estimation.preprocessing.preprocess import PreparedLogs
from oed.estimation.setup.noise import group_of
from oed.estimation.setup.options import CalibrationOptions
from oed.estimation.setup.unknowns import PLACE, Knowledge, Unknowns, specified_mount
from oed.foundation.arrays import Array
from oed.foundation.errors import LogError, ProblemError
from oed.kernel.measurement.measurement import Measurement, sensors_of
from oed.kernel.measurement.readings import sensor_labels
from oed.kernel.measurement.square_root import SquareRoot
from oed.logs.log import Log
from oed.robots.models.model import Model
from oed.robots.sensors.logged import Noise
from oed.robots.sensors.mounting import PLACE as UNITS

ASKEW = 0.5
"""Angle by which a sensor has to be turned on the robot for the search to start from there [rad]."""
USUAL = 2.0
"""Length of a window, where none is given [s]: drift hardly shows, and pose noise is small beside motion."""
LONG = 4.0
"""Times that length of the shortest segments from which on what these say is where a search begins."""


@dataclass(frozen=True)
class Fitted:
    """A robot's fit.

    Attributes:
        fit: the solution.
        segmenting: how the length of segments was found, None where it was given.
        notes: what was decided on the way.
    """

    fit: Fit
    segmenting: Segmenting | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Fitting:
    """How a robot is fitted.

    Attributes:
        robot: at its nominal parameters.
        parameters: names of those to estimate.
        measurement: says where the pose sensor sits, and how noisy it is.
        options: of the calibration.
        prior: information on `prior_of`, SI.
        prior_of: what the prior is of: the parameters to estimate, then constants of the sensor.
    """

    robot: Model
    parameters: tuple[str, ...]
    measurement: Measurement
    options: CalibrationOptions
    prior: Array | None = None
    prior_of: tuple[str, ...] = ()

    def fitted(self, prepared: PreparedLogs) -> Fitted:
        """The solution; coordinates of the sensor that the parameters hide are taken as the study has them.

        Raises:
            LogError: fewer readings than unknowns.
            ProblemError: options that do not suit the robot or the logs.
        """
        self._require_suitable(prepared)
        unknowns, notes = self._unknowns(prepared), list[str]()
        segmenting, fit = self._solved(prepared, unknowns)
        _require_enough(fit)
        hidden = _hidden_by_place(fit)
        if hidden:
            notes.append(
                f"{', '.join(hidden)} cannot be separated from the parameters: taken as the study has it"
            )
            unknowns = replace(unknowns, place=tuple(name for name in unknowns.place if name not in hidden))
            segmenting, fit = self._solved(prepared, unknowns)
        return Fitted(fit, segmenting, tuple(notes))

    def planned(
        self,
        logs: Sequence[Log],
        seconds: float,
        noises: Mapping[str, Noise],
        correlated: GaussMarkov | None = None,
    ) -> Fit:
        """What the joint fit will be to readings of such noise, by logs without any error of the robot at its
        nominal parameters.

        Args:
            logs: of the drives.
            seconds: length of the segments; infinite for whole logs.
            noises: of the readings.
            correlated: the same where they last.
        """
        prepared = PreparedLogs(tuple(logs), np.zeros(len({log.file for log in logs})), 0.0)
        layout = cut(prepared.logs, seconds, prepared.clocks, self.sensors(prepared))

        def at_nominal(unknowns: Unknowns) -> Fit:
            known = self._known(unknowns, layout)
            search = JointSearch(
                layout, unknowns, prepared.offsets, known, specified=noises, correlated=correlated
            )
            return search.at_first.fit(unknowns.nominal, search.first_starts(unknowns.nominal))

        unknowns = self._unknowns(prepared)
        fit = at_nominal(unknowns)
        shown = tuple(name for name in unknowns.place if name not in _hidden_by_place(fit))
        return fit if shown == unknowns.place else at_nominal(replace(unknowns, place=shown))

    def _require_suitable(self, prepared: PreparedLogs) -> None:
        # Motions that a sensor read of itself are fitted one by one; windows are of poses.
        sensors = self.sensors(prepared)
        if not self.options.by_readings and sensors:
            text = (
                f"{self.options.method} takes poses alone; the logs have {', '.join(dict(sensors))} as well"
            )
            raise ProblemError.about(("calibration", "method"), f"{text}: use joint")
        if not prepared.relative:
            return
        if not self.options.by_readings:
            text = (
                f"{self.options.method} is for poses; each motion of relative_poses is fitted: method: joint"
            )
            raise ProblemError.about(("calibration", "method"), text)
        if self.options.segment != "auto":
            text = "each motion of relative_poses is a segment of its own: omit it"
            raise ProblemError.about(("calibration", "segment"), text)

    def _unknowns(self, prepared: PreparedLogs) -> Unknowns:
        mount = specified_mount(self.measurement, relative=prepared.relative)
        shown = _observable_places(prepared.logs[0].quantities)
        if mount.fixed:
            shown = shown[2:]
        if mount.heading_fixed:
            shown = shown[:-1]
        free = tuple(name for name in self.options.sensor_place if name in shown)
        clocks = len(prepared.files) if self.options.clock_offset else 0
        # A sensor that looks backwards is found from there only.
        given = mount.sits[2]
        found = float(np.angle(np.exp(1j * (prepared.mounting - given))))
        turned = given + found if "sensor_heading" in free and abs(found) > ASKEW else given
        own = nuisances_of(self.sensors(prepared))
        return Unknowns(
            self.robot,
            self.parameters,
            (*free, *(one.name for one in own)),
            clocks,
            sits=(*mount.sits[:2], turned, *(one.nominal for one in own)),
            constants={**UNITS, **{one.name: one.unit for one in own}},
        )

    def sensors(self, prepared: PreparedLogs) -> Labelled:
        """The measurement's sensors that the logs have readings of, beside the poses, by their names.

        Without poses the readings' clock is that of the sensors: what they are late is its offset.
        """
        if prepared.relative:
            return ()
        read = {one.sensor for log in prepared.logs for one in log.sensors}
        late = self.options.clock_offset and not prepared.logs[0].quantities
        every = sensors_of(self.measurement)
        known = zip(sensor_labels(every), every, strict=True)
        return tuple((label, punctual(one) if late else one) for label, one in known if label in read)

    def _solved(self, prepared: PreparedLogs, unknowns: Unknowns) -> tuple[Segmenting | None, Fit]:
        logs, offsets, sensors = prepared.logs, prepared.offsets, self.sensors(prepared)
        last: list[Array] = []

        def layout(seconds: float) -> SegmentLayout:
            return cut(logs, seconds, prepared.clocks, sensors)

        def fit(segments: SegmentLayout) -> Fit:
            found = self._search(segments, unknowns, offsets).fit(last[-1] if last else None)
            last.append(found.values)
            return found

        if prepared.relative:
            if usual := with_usual_motions(logs):
                fit(motion_segments(usual, prepared.clocks))
            return None, fit(motion_segments(logs, prepared.clocks))
        chosen = self.options.segment
        seconds = math.inf if isinstance(chosen, str) else chosen
        if not self.options.by_readings and not self._of_readings(logs):
            length = usual_seconds(layout(math.inf)) if chosen == "auto" else seconds
            return None, self._over_windows(Windows(layout(length), unknowns, offsets))
        if chosen == "auto":
            segmenting = longest_without_drift(layout, fit)
            if self._may_last(segmenting.fit.layout) and not segmenting.turns_drift:
                whole = self._search(layout(math.inf), unknowns, offsets)
                segmenting = if_bounded(segmenting, whole)
            return segmenting, self._correlated(segmenting.fit, unknowns)
        # Over a long drive a wrong size turns the robot anywhere: from there no derivative leads back.
        short = next(lengths_tried(layout(math.inf)))
        if LONG * short < seconds:
            fit(layout(short))
        return None, self._correlated(fit(layout(seconds)), unknowns)

    def _of_readings(self, logs: Sequence[Log]) -> bool:
        # Whether gls weights readings: windows of positions alone show no turn.
        return self.options.method == "gls" and set(logs[0].quantities) == {"x", "y"}

    def _may_last(self, layout: SegmentLayout) -> bool:
        # Whether noise that lasts is looked for. Likelihood looks for it itself, beside drift.
        options = self.options
        free = options.loss == "linear" and options.noise != "specified" and options.method != "likelihood"
        return free and has_lasting_form(layout.quantities)

    def _correlated(self, fit: Fit, unknowns: Unknowns) -> Fit:
        # With noise that lasts, where it is asked for.
        logs = fit.layout.logs
        if fit.correlated or not (self.options.noise == "correlated" or self._of_readings(logs)):
            return fit
        self._require_lasting_form(fit.layout.quantities)
        return CorrelatedReadings(self._search(fit.layout, unknowns, fit.offsets)).fit(fit.values)

    def _require_lasting_form(self, quantities: Sequence[str]) -> None:
        if self.options.loss != "linear":
            text = f"correlated noise takes every reading for what it is, not loss: {self.options.loss}"
            raise ProblemError.about(("calibration", "loss"), f"{text}; use linear")
        if not has_lasting_form(quantities):
            text = f"correlated noise is that of x, y and heading; the logs hold {', '.join(quantities)}"
            raise ProblemError.about(("calibration", "noise"), f"{text}; use noise: estimated")

    def _over_windows(self, windows: Windows) -> Fit:
        options, known = self.options, self._known(windows.unknowns, windows.layout)
        if options.loss != "linear":
            text = f"loss: {options.loss} bounds single readings, of which windows are made up"
            raise ProblemError.about(("calibration", "loss"), f"{text}; use method: joint")
        if options.noise == "correlated":
            text = f"{options.method} has a noise of its own between windows; use method: joint"
            raise ProblemError.about(("calibration", "noise"), text)
        specified = self._specified(windows.layout)
        if options.method == "gls":
            return WeightedWindows(windows, known, specified, grows=options.noise != "constant").fit()
        return TwoStage(windows, known, specified).fit()

    def _search(self, layout: SegmentLayout, unknowns: Unknowns, offsets: Array) -> JointSearch:
        return JointSearch(
            layout,
            unknowns,
            offsets,
            self._known(unknowns, layout),
            self.options.loss,
            grows=self.options.noise == "estimated",
            specified=self._specified(layout),
        )

    def _specified(self, layout: SegmentLayout) -> dict[str, Noise] | None:
        # The noise that is not to be estimated.
        if self.options.noise != "specified":
            return None
        specified = noise_specified(self.measurement, layout.logs)
        missing = [name for name in layout.quantities if group_of(name) not in specified]
        if missing:
            text = f"the measurement specifies no noise of {', '.join(missing)}; use noise: estimated"
            raise ProblemError.about(("calibration", "noise"), text)
        return specified

    def _known(self, unknowns: Unknowns, layout: SegmentLayout) -> Knowledge:
        return known_before(self.measurement, unknowns, layout, self.prior, self.prior_of)


def _observable_places(quantities: Sequence[str]) -> tuple[str, ...]:
    # Without positions a lever arm shows in nothing; without a heading nothing shows how it is turned.
    if not {"x", "y"} <= set(quantities):
        return ()
    return PLACE if "heading" in quantities else PLACE[:2]


def _hidden_by_place(fit: Fit) -> tuple[str, ...]:
    # Coordinates of the sensor that exactly make up for parameters: c21, c22 and a sensor off to the side.
    count, names = len(fit.unknowns.parameters), fit.unknowns.place
    root = SquareRoot.of_matrix(fit.information.sum(axis=0))
    lost = root.directions[:, ~root.identifiable]
    if not np.any(np.abs(lost[:count]) > 1e-3):
        return ()
    shares = np.abs(lost[count : count + len(names)]).max(axis=1, initial=0.0)
    return tuple(name for name, share in zip(names, shares, strict=True) if share > 1e-3)


def _require_enough(fit: Fit) -> None:
    # As many unknowns as readings fit anything without error.
    readings = int(fit.layout.valid.sum())
    states = 0 if fit.motions else fit.layout.count * fit.starts.shape[1]
    if readings <= states + fit.unknowns.size:
        text = f"{readings} readings cannot identify {states + fit.unknowns.size} unknowns; log more poses"
        raise LogError.about(fit.layout.logs[0].file, text)


def usual_seconds(layout: SegmentLayout) -> float:
    """The length of windows where none is given [s], for logs of such steps."""
    return max(USUAL, FEWEST * usual_step(layout))

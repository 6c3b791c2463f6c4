"""One robot fitted to preprocessed logs: what is unknown, with which noise, over which segments.

Segments are as long as no drift shows in them beside the sensor's noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gls import WeightedWindows
from oed.estimation.methods.joint import JointSearch
from oed.estimation.methods.two_stage import TwoStage
from oed.estimation.methods.windows import Windows
from oed.estimation.prediction.layout import SegmentLayout, cut
from oed.estimation.prediction.segments import Labelled, nuisances_of
from oed.estimation.preprocessing.preprocess import PreparedLogs
from oed.estimation.setup.noise import LEAST, group_of, groups, places_of, specified_noise
from oed.estimation.setup.options import CalibrationOptions
from oed.estimation.setup.unknowns import PLACE, UNITS, Knowledge, Unknowns, specified_mount
from oed.foundation.arrays import Array
from oed.foundation.errors import LogError, ProblemError
from oed.kernel.measurement.measurement import Measurement
from oed.kernel.measurement.sensor import FRAME, Sensor, labelled_nuisances, sensor_labels
from oed.kernel.measurement.square_root import SquareRoot
from oed.logs.log import Log
from oed.robots.models.model import Model
from oed.robots.sensors.logged import Mount, Noise
from oed.robots.sensors.mapped import MappedSensor
from oed.robots.sensors.placed import PlacedSensor

LOOSE = 1.0
"""Standard deviation that parameters are given before the logs, relative to their sizes: it keeps the
search in bounds where the logs say nothing, and is nothing beside what they say."""
LOOSE_PLACE, LOOSE_CLOCK = 0.3, 0.5
"""The same of the sensor's place [m, rad] and of a clock's offset [s]."""
LOOSE_CONSTANT = {"m": 10.0, "rad": 3.0, "s": LOOSE_CLOCK}
"""The same of other sensors' constants, SI; of other units `LOOSE`."""
ASKEW = 0.5
"""Angle by which a sensor has to be turned on the robot for the search to start from there [rad]."""
USUAL = 2.0
"""Length of a window, where none is given [s]: drift hardly shows, and pose noise is small beside motion."""
SHORTEST = 1.0
"""Length of the shortest segments tried [s]."""
FEWEST = 8
"""Steps that the shortest segments have at least."""
GROWTH = 2.0
"""Factor by which the residuals' variance may grow with the length of segments before it counts as drift."""


@dataclass(frozen=True)
class Segmenting:
    """The length that was chosen, and why.

    Attributes:
        seconds: infinite for whole logs.
        fit: of that length.
        tried: root mean square residuals by length and noise, SI.
        drifts: whether longer segments showed drift.
    """

    seconds: float
    fit: Fit
    tried: dict[float, dict[str, float]]
    drifts: bool


def longest_without_drift(
    layout: Callable[[float], SegmentLayout], fit: Callable[[SegmentLayout], Fit]
) -> Segmenting:
    """The longest segments whose residuals are hardly larger than those of the shortest.

    Args:
        layout: the segments of a length [s].
        fit: the solution over segments.
    """
    chosen: tuple[float, Fit] | None = None
    tried: dict[float, dict[str, float]] = {}
    for seconds in _lengths(layout(math.inf)):
        found = fit(layout(seconds))
        tried[seconds] = spread(found)
        first = next(iter(tried.values()))
        if chosen is not None and any(
            tried[seconds][name] ** 2 > GROWTH * first[name] ** 2 for name in first
        ):
            return Segmenting(*chosen, tried, drifts=True)
        chosen = seconds, found
    assert chosen is not None
    return Segmenting(*chosen, tried, drifts=False)


def spread(fit: Fit) -> dict[str, float]:
    """Root mean square of the residuals of each noise, SI, as an unbiased estimate."""
    quantities, valid = fit.layout.quantities, fit.layout.valid
    found = {}
    for group in groups(quantities):
        own = places_of(group, quantities)
        present = valid[..., own]
        squares = (fit.residuals[..., own][present] ** 2).sum()
        size = float(np.sqrt(squares / max(fit.redundancy[..., own][present].sum(), 1e-12)))
        # Rounding of exact readings is no drift.
        found[group] = max(size, LEAST)
    return found


def _lengths(whole: SegmentLayout) -> Iterator[float]:
    steps = whole.steps[whole.steps > 0]
    seconds = max(SHORTEST, FEWEST * float(np.median(steps)))
    longest = float((whole.times[:, -1] - whole.times[:, 0]).max())
    while seconds < longest / 1.5:
        yield seconds
        seconds *= 2
    yield math.inf


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
        prior: information on the parameters to estimate, (p, p), SI.
    """

    robot: Model
    parameters: tuple[str, ...]
    measurement: Measurement
    options: CalibrationOptions
    prior: Array | None = None

    def fitted(self, prepared: PreparedLogs) -> Fitted:
        """The solution; coordinates of the sensor that the parameters hide are taken as the study has them.

        Raises:
            LogError: fewer readings than unknowns.
            ProblemError: options that do not suit the robot or the logs.
        """
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

    @cached_property
    def _mount(self) -> Mount:
        return specified_mount(self.measurement)

    def _unknowns(self, prepared: PreparedLogs) -> Unknowns:
        mount, shown = self._mount, _observable_places(prepared.logs[0].quantities)
        if mount.fixed:
            shown = shown[2:]
        free = tuple(name for name in self.options.sensor_place if name in shown)
        clocks = len(prepared.files) if self.options.clock_offset else 0
        # A sensor that looks backwards is found from there only.
        turned = prepared.mounting if "sensor_heading" in free and abs(prepared.mounting) > ASKEW else 0.0
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
        read = {one.sensor for log in prepared.logs for one in log.sensors}
        late = self.options.clock_offset and not prepared.logs[0].quantities
        every = self.measurement.joint_sensors
        known = zip(sensor_labels(every), every, strict=True)
        return tuple((label, _punctual(one) if late else one) for label, one in known if label in read)

    def _solved(self, prepared: PreparedLogs, unknowns: Unknowns) -> tuple[Segmenting | None, Fit]:
        logs, offsets, sensors = prepared.logs, prepared.offsets, self.sensors(prepared)
        last: list[Array] = []

        def layout(seconds: float) -> SegmentLayout:
            return cut(logs, seconds, prepared.clocks, sensors)

        def fit(segments: SegmentLayout) -> Fit:
            found = self._search(segments, unknowns, offsets).fit(last[-1] if last else None)
            last.append(found.values)
            return found

        chosen = self.options.segment
        seconds = math.inf if isinstance(chosen, str) else chosen
        if self.options.method != "joint" and sensors:
            text = (
                f"{self.options.method} takes poses alone; the logs have {', '.join(dict(sensors))} as well"
            )
            raise ProblemError.about(("calibration", "method"), f"{text}: use joint")
        if self.options.method != "joint":
            length = usual_seconds(layout(math.inf)) if chosen == "auto" else seconds
            return None, self._over_windows(Windows(layout(length), unknowns, offsets))
        if chosen == "auto":
            segmenting = longest_without_drift(layout, fit)
            return segmenting, segmenting.fit
        return None, fit(layout(seconds))

    def _over_windows(self, windows: Windows) -> Fit:
        options, known = self.options, self._known(windows.unknowns, windows.layout)
        if options.loss != "linear":
            text = f"loss: {options.loss} bounds single readings, of which windows are made up"
            raise ProblemError.about(("calibration", "loss"), f"{text}; use method: joint")
        specified = self._specified(windows.layout.logs[0], windows.layout.quantities)
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
            specified=self._specified(layout.logs[0], layout.quantities),
        )

    def _specified(self, log: Log, quantities: Sequence[str]) -> dict[str, Noise] | None:
        # The noise that is not to be estimated.
        if self.options.noise != "stated":
            return None
        specified = specified_noise(self.measurement, log.averaged)
        missing = [name for name in quantities if group_of(name) not in specified]
        if missing:
            text = f"the measurement specifies no noise of {', '.join(missing)}; use noise: estimated"
            raise ProblemError.about(("calibration", "noise"), text)
        return specified

    @cached_property
    def _before(self) -> dict[str, float]:
        # What is known of the pose sensor's place and of the constants of sensors.
        own = labelled_nuisances(self.measurement.joint_sensors)
        known = {one.name: one.deviation or LOOSE_CONSTANT.get(one.unit, LOOSE) for one in own}
        return known | dict(self._mount.deviations)

    def _known(self, unknowns: Unknowns, layout: SegmentLayout) -> Knowledge:
        count, known = len(unknowns.parameters), self._before | _frame_of(layout)
        loose = LOOSE * unknowns.scale
        for index, name in enumerate(unknowns.place):
            loose[count + index] = known.get(name, LOOSE_PLACE)
        loose[unknowns.size - unknowns.clocks :] = LOOSE_CLOCK
        matrix = np.diag(loose**-2)
        if self.prior is not None:
            matrix[:count, :count] += self.prior
        return Knowledge(matrix, unknowns.nominal)


def _punctual(sensor: Sensor) -> Sensor:
    # Without a latency of its own.
    return sensor.model_copy(update={"latency": "known"}) if isinstance(sensor, PlacedSensor) else sensor


def _frame_of(layout: SegmentLayout) -> dict[str, float]:
    # What defines the frame where no position and no known point does: some of the first map.
    placed = [(label, sensor) for label, sensor in layout.sensors if sensor.start_known is not None]
    free = [(label, sensor) for label, sensor in placed if sensor.gauge and isinstance(sensor, MappedSensor)]
    if not free or len(free) < len(placed) or {"x", "y"} <= set(layout.states):
        return {}
    label, sensor = free[0]
    return {f"{label}.{name}": FRAME for name in sensor.frame}


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
    return max(USUAL, FEWEST * float(np.median(layout.steps[layout.steps > 0])))

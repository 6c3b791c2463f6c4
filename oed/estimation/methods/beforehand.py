"""What is known of a fit's unknowns before any log: parameters, sensors' places and constants, clocks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.setup.unknowns import Knowledge, Unknowns, specified_mount
from oed.foundation.arrays import Array
from oed.kernel.measurement.measurement import FRAME, Measurement, sensors_of
from oed.kernel.measurement.readings import labelled_nuisances
from oed.kernel.measurement.sensor import Sensor
from oed.robots.sensors.mapped import MappedSensor
from oed.robots.sensors.placed import PlacedSensor

LOOSE = 1.0
"""Standard deviation that parameters are given before the logs, relative to their sizes: it keeps the
search in bounds where the logs say nothing, and is nothing beside what they say."""
LOOSE_PLACE, LOOSE_CLOCK = 0.3, 0.5
"""The same of the sensor's place [m, rad] and of a clock's offset [s]."""
LOOSE_CONSTANT = {"m": 10.0, "rad": 3.0, "s": LOOSE_CLOCK}
"""The same of other sensors' constants, SI; of other units `LOOSE`."""


def known_before(
    measurement: Measurement,
    unknowns: Unknowns,
    layout: SegmentLayout,
    prior: Array | None = None,
    prior_of: Sequence[str] = (),
) -> Knowledge:
    """What a study knows of the unknowns of a fit over segments; where it knows nothing, hardly anything.

    Args:
        measurement: that says where sensors sit, and what their constants are.
        unknowns: of the fit.
        layout: the segments.
        prior: information on `prior_of`, SI.
        prior_of: parameters, and constants of the sensor.
    """
    own = labelled_nuisances(sensors_of(measurement))
    known = {one.name: one.deviation or LOOSE_CONSTANT.get(one.unit, LOOSE) for one in own}
    known |= specified_mount(measurement, relative=layout.relative).deviations
    known |= _frame_of(layout)
    count = len(unknowns.parameters)
    loose = LOOSE * unknowns.scale
    for index, name in enumerate(unknowns.place):
        loose[count + index] = known.get(name, LOOSE_PLACE)
    loose[unknowns.size - unknowns.clocks :] = LOOSE_CLOCK
    matrix = np.diag(loose**-2)
    if prior is not None:
        given = [place for place, name in enumerate(prior_of) if name in unknowns.names]
        places = [unknowns.names.index(prior_of[place]) for place in given]
        matrix[np.ix_(places, places)] += prior[np.ix_(given, given)]
    return Knowledge(matrix, unknowns.nominal)


def punctual(sensor: Sensor) -> Sensor:
    """The sensor without a latency of its own."""
    return sensor.model_copy(update={"latency": "known"}) if isinstance(sensor, PlacedSensor) else sensor


def _frame_of(layout: SegmentLayout) -> dict[str, float]:
    # What defines the frame where no position and no known point does: some of the first map.
    placed = [(label, sensor) for label, sensor in layout.sensors if sensor.start_known is not None]
    free = [(label, sensor) for label, sensor in placed if sensor.gauge and isinstance(sensor, MappedSensor)]
    if not free or len(free) < len(placed) or {"x", "y"} <= set(layout.states):
        return {}
    label, sensor = free[0]
    return {f"{label}.{name}": FRAME for name in sensor.frame}

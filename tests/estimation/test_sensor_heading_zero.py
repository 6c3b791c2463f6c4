"""Where the heading of a sensor has its zero says nothing of the robot."""

from __future__ import annotations

import numpy as np
import pytest
from simulated import TRUTH, course, log_of, logged_problem, options

from oed.estimation import calibrate


@pytest.mark.slow
@pytest.mark.parametrize("method", ["joint", "gls", "likelihood"])
def test_standard_errors_of_the_robot_are_the_same_wherever_the_sensors_heading_has_its_zero(method: str):
    drive = course(seconds=20.0, period=0.05, drift=0.002)
    deviations, values = [], []
    for turned in (0.09, 0.09 + np.pi / 4, 0.09 + np.pi / 2):
        log = log_of(drive, noise=(0.001, 0.0035), place=(0.04, 0.0, turned), offset=0.08)
        calibration = calibrate(logged_problem(), [log], options(method=method))
        deviations.append(np.sqrt(np.diag(calibration.covariance))[: len(TRUTH)])
        values.append(calibration.values[: len(TRUTH)])
    for place in (1, 2):
        assert deviations[place] == pytest.approx(deviations[0], rel=0.02)
        assert np.all(np.abs(values[place] - values[0]) < 0.02 * deviations[0])

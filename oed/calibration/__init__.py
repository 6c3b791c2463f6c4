"""Calibration: from logs of real drives to parameters with honest error bars."""

from oed.calibration.calibrate import Calibration, calibrate, sensor_place, stated_noise
from oed.calibration.covariance import Covariance
from oed.calibration.diagnostics import Diagnostic, correlations
from oed.calibration.left_out import HeldOut
from oed.calibration.noise import Noise
from oed.calibration.options import CalibrationOptions
from oed.calibration.reckoning import Reckoning, reckoned

__all__ = [
    "Calibration",
    "CalibrationOptions",
    "Covariance",
    "Diagnostic",
    "HeldOut",
    "Noise",
    "Reckoning",
    "calibrate",
    "correlations",
    "reckoned",
    "sensor_place",
    "stated_noise",
]

"""Calibration: from logs of real drives to parameters with honest error bars."""

from oed.calibration.alternatives import Alternative, alternative_flaws
from oed.calibration.calibrate import Calibration, calibrate
from oed.calibration.comparison import Compared, Comparison, Score
from oed.calibration.covariance import Covariance
from oed.calibration.diagnostics import Diagnostic, correlations
from oed.calibration.left_out import HeldOut
from oed.calibration.noise import Noise
from oed.calibration.options import CalibrationOptions
from oed.calibration.reckoning import Reckoning, reckoned
from oed.calibration.stated import Mount, stated_mount, stated_noise

__all__ = [
    "Alternative",
    "Calibration",
    "CalibrationOptions",
    "Compared",
    "Comparison",
    "Covariance",
    "Diagnostic",
    "HeldOut",
    "Mount",
    "Noise",
    "Reckoning",
    "Score",
    "alternative_flaws",
    "calibrate",
    "correlations",
    "reckoned",
    "stated_mount",
    "stated_noise",
]

"""Calibration: from logs of real drives to parameters with honest error bars."""

from typing import TYPE_CHECKING

from oed.lazy import loader

if TYPE_CHECKING:
    from oed.calibration.alternatives import Alternative as Alternative
    from oed.calibration.alternatives import alternative_flaws as alternative_flaws
    from oed.calibration.calibration import Calibration as Calibration
    from oed.calibration.calibration import calibrate as calibrate
    from oed.calibration.comparison import Compared as Compared
    from oed.calibration.comparison import Comparison as Comparison
    from oed.calibration.comparison import Score as Score
    from oed.calibration.covariance import Covariance as Covariance
    from oed.calibration.diagnostics import Diagnostic as Diagnostic
    from oed.calibration.diagnostics import correlations as correlations
    from oed.calibration.left_out import HeldOut as HeldOut
    from oed.calibration.noise import Noise as Noise
    from oed.calibration.options import CalibrationOptions as CalibrationOptions
    from oed.calibration.reckoning import Reckoning as Reckoning
    from oed.calibration.reckoning import reckoned as reckoned
    from oed.calibration.stated import Mount as Mount
    from oed.calibration.stated import stated_mount as stated_mount
    from oed.calibration.stated import stated_noise as stated_noise

_HOMES = {
    "oed.calibration.alternatives": (
        "Alternative",
        "alternative_flaws",
    ),
    "oed.calibration.calibration": (
        "Calibration",
        "calibrate",
    ),
    "oed.calibration.comparison": (
        "Compared",
        "Comparison",
        "Score",
    ),
    "oed.calibration.covariance": ("Covariance",),
    "oed.calibration.diagnostics": (
        "Diagnostic",
        "correlations",
    ),
    "oed.calibration.left_out": ("HeldOut",),
    "oed.calibration.noise": ("Noise",),
    "oed.calibration.options": ("CalibrationOptions",),
    "oed.calibration.reckoning": (
        "Reckoning",
        "reckoned",
    ),
    "oed.calibration.stated": (
        "Mount",
        "stated_mount",
        "stated_noise",
    ),
}
__getattr__ = loader(__name__, _HOMES)

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

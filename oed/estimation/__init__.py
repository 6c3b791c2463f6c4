"""Calibration: from logs of real drives to parameters with honest error bars."""

from typing import TYPE_CHECKING

from oed.foundation.lazy import loader

if TYPE_CHECKING:
    from oed.estimation.assessment.comparison import Compared as Compared
    from oed.estimation.assessment.comparison import Comparison as Comparison
    from oed.estimation.assessment.comparison import Score as Score
    from oed.estimation.assessment.covariance import Covariance as Covariance
    from oed.estimation.assessment.diagnostics import Diagnostic as Diagnostic
    from oed.estimation.assessment.diagnostics import correlations as correlations
    from oed.estimation.assessment.left_out import HeldOut as HeldOut
    from oed.estimation.assessment.reckoning import Reckoning as Reckoning
    from oed.estimation.assessment.reckoning import reckoned as reckoned
    from oed.estimation.calibration import Calibration as Calibration
    from oed.estimation.calibration import calibrate as calibrate
    from oed.estimation.setup.alternatives import Alternative as Alternative
    from oed.estimation.setup.alternatives import alternative_flaws as alternative_flaws
    from oed.estimation.setup.options import CalibrationOptions as CalibrationOptions
    from oed.robots.sensors.logged import Noise as Noise

_HOMES = {
    "oed.estimation.setup.alternatives": (
        "Alternative",
        "alternative_flaws",
    ),
    "oed.estimation.calibration": (
        "Calibration",
        "calibrate",
    ),
    "oed.estimation.assessment.comparison": (
        "Compared",
        "Comparison",
        "Score",
    ),
    "oed.estimation.assessment.covariance": ("Covariance",),
    "oed.estimation.assessment.diagnostics": (
        "Diagnostic",
        "correlations",
    ),
    "oed.estimation.assessment.left_out": ("HeldOut",),
    "oed.estimation.setup.options": ("CalibrationOptions",),
    "oed.estimation.assessment.reckoning": (
        "Reckoning",
        "reckoned",
    ),
    "oed.robots.sensors.logged": ("Noise",),
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
    "Noise",
    "Reckoning",
    "Score",
    "alternative_flaws",
    "calibrate",
    "correlations",
    "reckoned",
]

"""What is not known of a system beforehand: distributions, back-off, violation probability."""

from typing import TYPE_CHECKING

from oed.foundation.lazy import loader

if TYPE_CHECKING:
    from oed.uncertainty.departures import leaving as leaving
    from oed.uncertainty.robust import Robust as Robust
    from oed.uncertainty.uncertainty import Uncertainty as Uncertainty

_HOMES = {
    "oed.uncertainty.departures": ("leaving",),
    "oed.uncertainty.robust": ("Robust",),
    "oed.uncertainty.uncertainty": ("Uncertainty",),
}
__getattr__ = loader(__name__, _HOMES)

"""Logs that follow the model far more closely than any sensor reads: designs and simulations, not drives."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from oed.estimation.assessment.doubts import Doubt
from oed.estimation.methods.fit import Fit
from oed.estimation.setup.noise import LEAST, groups, places_of
from oed.foundation.text import listing, words
from oed.robots.sensors.logged import Noise

ROUNDING = 1e-6
"""Share of the specified noise that rounding leaves: no reading is that good."""
ROUNDED = 1e-3
"""The same of the smallest noise that is believed, where none is specified."""
TINY = 0.01
"""Share of the specified noise that no sensor is better than by chance, or by a cautious study."""
MANY = 50
"""Degrees of freedom from which that is no chance of a few readings that happen to fit."""
FEW = 5
"""Degrees of freedom below which a fit goes through its readings, whatever they are."""
EXACT = (
    "{} the model exactly, to {} of the noise {}: is this the design, or a simulation without noise, and not "
    "the robot's log?"
)


def exact_doubts(fit: Fit, specified: Mapping[str, Noise]) -> tuple[Doubt, ...]:
    """A word on readings that leave next to nothing unexplained.

    Args:
        fit: of all logs.
        specified: noise that the study specifies, by the readings' kind; {} where it specifies none.
    """
    shares = {group: _share(fit, group, specified.get(group)) for group in groups(fit.layout.quantities)}
    exact = {group: share for group, share in shares.items() if share is not None}
    if not exact:
        return ()
    named = listing([words(group) for group in exact])
    follow = "follows" if len(exact) == 1 and not named.endswith("s") else "follow"
    noise = "that is specified" if specified.keys() & exact.keys() else "that any sensor has"
    return (Doubt("", "exact", EXACT.format(f"{named} {follow}", f"{max(exact.values()):.1g}", noise)),)


def _share(fit: Fit, group: str, specified: Noise | None) -> float | None:
    # What the fit leaves of a kind of reading as a share of its noise; None where that is enough.
    places = places_of(group, fit.layout.quantities)
    valid = fit.layout.valid[..., places]
    free = float(np.clip(fit.redundancy[..., places][valid], 0.0, 1.0).sum())
    if free < FEW:
        return None
    noise = specified or Noise(LEAST)
    sizes = np.broadcast_to(noise.deviation(fit.speeds, fit.yaw_rates)[..., None], valid.shape)[valid]
    usual = float(np.sqrt(np.mean(sizes**2)))
    left = float(np.sqrt(np.sum(fit.residuals[..., places][valid] ** 2) / free))
    share = left / usual if usual > 0 else np.inf
    least = ROUNDED if specified is None else TINY if free >= MANY else ROUNDING
    return share if share < least else None

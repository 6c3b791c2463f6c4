"""How whole logs err: noise of readings, errors that pass, errors that last, drift; each of its own size.

What is read is off by white noise; by errors of the motion that pass, such as those of a wheel that is not
round or of play: of the place, seen from the robot, they stay as large as they are, of the heading turning
makes them; by errors of the reference that last, such as those of a distorted frame; and by the drift of the
robot's pose, a random walk. Where only noise and drift are looked for, what passes or lasts is taken for one
of these, and standard errors come out several times too large, or too small.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.robots.sensors.drift import USUAL, Drift

SIZES = (
    "position",
    "heading",
    "passing_ahead",
    "passing_sideways",
    "passing_heading",
    "passing_seconds",
    "lasting_position",
    "lasting_heading",
    "lasting_seconds",
    "ahead",
    "sideways",
    "turn_by_path",
    "turn_by_turning",
)
"""Standard deviations of white noise [m, rad]; of what passes, ahead, sideways [m], of the heading after
1 rad of turning [rad], and the time after which 1/e of that is left [s]; of what lasts, alike; of drift ahead
and sideways after 1 m [m], of the heading after 1 m and after 1 rad of turning [rad]."""
WHITE, LASTING, DRIFT = SIZES[:2], SIZES[6:9], SIZES[9:]
PASSING, SECONDS = SIZES[2:6], ("passing_seconds", "lasting_seconds")
DESCRIBED = dict(
    zip(
        SIZES,
        (
            ("noise", "position", "m"),
            ("noise", "heading", "rad"),
            ("passing", "ahead", "m"),
            ("passing", "sideways", "m"),
            ("passing", "heading, after 1 rad of turning", "rad"),
            ("passing", "time after which 1/e is left", "s"),
            ("lasting", "position", "m"),
            ("lasting", "heading", "rad"),
            ("lasting", "time after which 1/e is left", "s"),
            ("drift", "ahead, after 1 m", "m"),
            ("drift", "sideways, after 1 m", "m"),
            ("drift", "heading, after 1 m", "rad"),
            ("drift", "heading, after 1 rad of turning", "rad"),
        ),
        strict=True,
    )
)
"""Kind of each, what it is of, SI unit."""
NONE = -60.0
"""Logarithm of a size that is none."""
VAGUE = 3.0
"""Standard deviation of the logarithms of sizes about their first guess: a factor of 20."""
USUALLY = 0.75
"""The same of drift about the usual one: a factor of 2."""
BEYOND_DOUBT = 2 * np.log(1000.0)
"""Twice the logarithm of the odds from which on there is no drift [Kass, Raftery: Bayes factors, 1995]."""
FARTHEST = 6.0
"""How far the logarithm of a size may be from its first guess."""
RATES = ("ahead_per_metre", "sideways_per_metre", "heading_per_metre", "heading_per_radian")
"""Of `Drift`, as `DRIFT`."""
PASSED, LASTED = 2.0, 0.3
"""First guesses: of the time that errors pass in [s], and of that which they last, relative to the longest
log's."""


@dataclass(frozen=True)
class ErrorSizes:
    """What is thought of the sizes before the logs are heard, by logarithms, (13,).

    Attributes:
        guess: where a search begins.
        spread: standard deviation about it; 0 of sizes that are known.
    """

    guess: Array
    spread: Array

    @classmethod
    def of(cls, white: Mapping[str, float], seconds: float) -> ErrorSizes:
        """Of logs.

        Args:
            white: noise of position [m] and heading [rad] that segments of seconds show.
            seconds: how long the longest log is.
        """
        position, heading = white["position"], white["heading"]
        sizes = {
            "position": position,
            "heading": heading,
            "passing_ahead": position,
            "passing_sideways": position,
            "passing_heading": heading,
            "passing_seconds": PASSED,
            "lasting_position": position,
            "lasting_heading": heading,
            "lasting_seconds": LASTED * seconds,
            **dict(zip(DRIFT, (getattr(USUAL, rate) for rate in RATES), strict=True)),
        }
        spread = [USUALLY if name in DRIFT else VAGUE for name in SIZES]
        return cls(np.log([sizes[name] for name in SIZES]), np.array(spread))

    def known(self, sizes: Mapping[str, float]) -> ErrorSizes:
        """Some of them known; those of no size are none."""
        guess, spread = self.guess.copy(), self.spread.copy()
        for name, size in sizes.items():
            place = SIZES.index(name)
            guess[place] = np.log(size) if size > 0 else NONE
            spread[place] = 0.0
        return ErrorSizes(guess, spread)

    def without(self, names: Iterable[str]) -> ErrorSizes:
        """None of these."""
        return self.known(dict.fromkeys(names, 0.0))

    @classmethod
    def specified(cls, white: Mapping[str, float], drift: Drift | None) -> ErrorSizes:
        """Of noise, and drift if there is any, as they are specified, with nothing that passes or lasts.

        Args:
            white: noise of position [m] and heading [rad].
            drift: None for one that is to be found.
        """
        found = cls.of(white, 1.0).known(white).without([*PASSING, *LASTING])
        if drift is None:
            return found
        return found.known(dict(zip(DRIFT, (getattr(drift, rate) for rate in RATES), strict=True)))

    @property
    def free(self) -> Bools:
        """Which are to be found, (13,)."""
        return self.spread > 0

    def surprise(self, logs: Array) -> tuple[float, Array]:
        """Twice the negative logarithm of their density, but for a constant, and its slope, (13,)."""
        off = np.where(self.free, (logs - self.guess) / np.where(self.free, self.spread, 1.0), 0.0)
        slope = 2 * off / np.where(self.free, self.spread, 1.0)
        return float(off @ off), slope


def drift_shows(odds: float) -> bool | None:
    """Whether drift shows: False where none is likelier beyond doubt, None where that is open.

    Args:
        odds: -2 times the logarithm of the likelihood with drift, less that without.
    """
    return None if 0 < odds < BEYOND_DOUBT else bool(odds <= 0)


def of_rates(drift: Drift) -> bool:
    """Whether it is by `RATES` alone."""
    given = {name for name, value in drift if value}
    return given <= set(RATES)

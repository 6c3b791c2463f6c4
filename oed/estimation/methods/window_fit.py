"""The methods that work on windows: which one, and how long its windows are."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gls import WeighedWindows
from oed.estimation.methods.knowledge import Knowledge
from oed.estimation.methods.two_stage import TwoStage
from oed.estimation.methods.windows import Windows, usual_seconds
from oed.estimation.prediction.layout import Layout
from oed.estimation.setup.options import CalibrationOptions
from oed.estimation.setup.unknowns import Unknowns
from oed.foundation.errors import Flaw, ProblemError
from oed.robots.models.model import Integration
from oed.robots.sensors.logged import Noise

Array = npt.NDArray[np.float64]


def window_fit(
    options: CalibrationOptions,
    layout: Callable[[float], Layout],
    unknowns: Unknowns,
    integration: Integration,
    offsets: Array,
    known: Knowledge,
    stated: Mapping[str, Noise] | None,
) -> Fit:
    """The solution by `gls` or `two_stage`.

    Args:
        options: with the method and the windows' length.
        layout: the segments of a length [s].
        unknowns: to estimate.
        integration: rule by which poses follow from twists.
        offsets: of the clocks, as far as known, (clocks,) [s].
        known: of the unknowns from before.
        stated: noise of the poses that is not to be estimated.

    Raises:
        ProblemError: a robot, logs or options that do not suit the method.
    """
    if options.loss != "linear":
        text = f"loss: {options.loss} bounds single readings, of which windows are made up; use method: joint"
        raise ProblemError([Flaw(("calibration", "loss"), text)])
    windows = Windows(layout(_seconds(options, layout)), unknowns, integration, offsets)
    if options.method == "gls":
        return WeighedWindows(windows, known, stated, grows=options.noise != "constant").fit()
    return TwoStage(windows, known, stated).fit()


def _seconds(options: CalibrationOptions, layout: Callable[[float], Layout]) -> float:
    if options.segment == "auto":
        return usual_seconds(layout(math.inf))
    return math.inf if options.segment == "log" else options.segment

"""Which covariances a fit of logs has, and which of them is the one to trust."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from oed.estimation.assessment.covariance import (
    Blocks,
    Covariance,
    blocks_of,
    bootstrap,
    information,
    judgeable,
    sandwich,
)
from oed.estimation.assessment.diagnostics import Expected
from oed.estimation.assessment.doubts import Doubt
from oed.estimation.assessment.drift import drift, drift_of_motions
from oed.estimation.methods.drift_rates import DriftRates
from oed.estimation.methods.fit import SUREST, Fit
from oed.estimation.setup.options import CalibrationOptions, CovarianceName
from oed.foundation.errors import ProblemError

TOO_SURE = 0.5
"""Standard errors of some combination, in units of those that noise and drift give, below which disagreement
of blocks is doubted: twice as sure as can be."""
MATTERS = 1.25
"""Times F^-1's standard errors from which on drift that logs leave open counts: below, intervals of 95 % hold
the truth 88 % of the time even if it is all there."""


def covariances_of(
    fit: Fit, options: CalibrationOptions, rates: DriftRates | None, *, drifts: bool, seed: int
) -> tuple[Covariance, ...]:
    """By the ways that apply, the one that was asked for or is trusted most first.

    Args:
        fit: of logs, or their segments.
        options: the way that is asked for, the length of blocks, replicates of the bootstrap.
        rates: how fast the robot drifts, where that is known.
        drifts: whether the search for the segments' length saw drift.
        seed: of the bootstrap.

    Raises:
        ProblemError: the way that is asked for does not apply.
    """
    blocks = _blocks(fit, options)
    found = [information(fit)]
    if rates is not None:
        found.append(drift(fit, rates))
    if fit.parts is not None:
        found.append(drift_of_motions(fit))
    # From very few parts their disagreement cannot be judged.
    if judgeable(fit, blocks):
        rng = np.random.default_rng(seed)
        found += [sandwich(fit, blocks), bootstrap(fit, blocks, options.replicates, rng)]
    ways, wanted = {one.name: one for one in found}, options.covariance
    if wanted == "auto" and fit.correlated:
        wanted = "information"
    elif wanted == "auto":
        parameters = len(fit.unknowns.parameters)
        wanted = most_trusted(ways, blocks, rates, drifts, parameters)
        if wanted == "bootstrap":
            # So few blocks disagree in fewer directions than there are unknowns.
            floor = _floor(ways, rates, ways[wanted], blocks, parameters)
            ways[wanted] = ways[wanted].no_surer_than(floor, parameters)
    if wanted not in ways:
        raise ProblemError.about(("calibration", "covariance"), _missing(wanted, blocks))
    return tuple(sorted(ways.values(), key=lambda one: one.name != wanted))


def few_blocks(
    fit: Fit, options: CalibrationOptions, ways: Sequence[Covariance], rates: DriftRates | None
) -> tuple[Doubt, ...]:
    """A word on disagreement of blocks that leaves a combination of parameters far too sure.

    Scores of a few blocks sum to nothing, and lie in fewer directions than there are unknowns.

    Args:
        fit: of the logs.
        options: the length of blocks.
        ways: covariances, the one in use first.
        rates: how fast the robot drifts, where that is known.
    """
    chosen, known, parameters = ways[0], {one.name: one for one in ways}, len(fit.unknowns.parameters)
    if chosen.name not in ("bootstrap", "sandwich"):
        return ()
    floor = _floor(known, rates, chosen, _blocks(fit, options), parameters)
    share = chosen.surest(floor, parameters)
    if share > TOO_SURE:
        return ()
    than = "under drift" if floor.name == "drift" else "by the noise alone"
    text = (
        f"of some combination of the parameters the {chosen.name} of so few blocks says standard errors "
        f"{100 * share:.0f} % of those {than}: do not trust it for more than one parameter at a time; use "
        "covariance: auto, which allows for that, or log more"
    )
    return (Doubt("", "few_blocks", text),)


def expected_between_logs(
    fit: Fit, options: CalibrationOptions, ways: Sequence[Covariance], rates: DriftRates | None
) -> Expected:
    """By how much logs may differ, as far as the covariance in use knows.

    Args:
        fit: of the logs.
        options: the length of blocks.
        ways: covariances, the one in use first.
        rates: how fast the robot drifts, where that is known.
    """
    # Rates found in the same logs are as large as these are far apart: known, as far as this goes.
    found = rates is not None and rates.shown is True
    degrees = next((one.degrees_together for one in ways if one.name == "drift" and not found), SUREST)
    whole = _blocks(fit, options).whole_logs
    return Expected(rates, degrees, whole and ways[0].name in ("bootstrap", "sandwich"))


def _floor(
    ways: Mapping[CovarianceName, Covariance],
    rates: DriftRates | None,
    of_blocks: Covariance,
    blocks: Blocks,
    parameters: int,
) -> Covariance:
    # What nothing is surer than: noise and drift, where the logs themselves say how much of it there is.
    # Whole logs show by themselves how large errors are, which drift may overrate: its proportions count.
    only_usual = rates is not None and rates.seconds is None
    floor = ways["information" if "drift" not in ways or only_usual else "drift"]
    return floor.no_larger_than(of_blocks, parameters) if blocks.whole_logs else floor


def _blocks(fit: Fit, options: CalibrationOptions) -> Blocks:
    return blocks_of(fit, None if options.block == "auto" else float(options.block))


def most_trusted(
    ways: Mapping[CovarianceName, Covariance],
    blocks: Blocks,
    rates: DriftRates | None,
    drifts: bool,
    parameters: int,
) -> CovarianceName:
    """The way that allows for whatever the logs show: drift, or all that they disagree by.

    Args:
        ways: covariances by their names.
        blocks: of which the bootstrap is.
        rates: how fast the robot drifts, where that is known.
        drifts: whether the search for the segments' length saw drift.
        parameters: number of them, the first of the unknowns.
    """
    if "drift" not in ways:
        return "bootstrap" if "bootstrap" in ways else "information"
    errors = {name: one.deviations[:parameters] for name, one in ways.items()}
    if rates is not None and rates.shown is False and not drifts:
        matters = np.any(errors["drift"] > MATTERS * errors["information"])
        return "drift" if matters else "information"
    if "bootstrap" not in ways:
        return "drift"
    # How much whole logs disagree shows whatever goes wrong. Parts of a log share what is wrong with all of
    # it, and disagree too little; but where they disagree more than drift explains, there is more than drift.
    if blocks.whole_logs or (rates is not None and rates.seconds is None):
        return "bootstrap"
    widths = [errors[name] * ways[name].half_width for name in ("bootstrap", "drift")]
    more = np.subtract(*np.log(np.maximum(widths, np.finfo(float).tiny)))
    return "bootstrap" if more.max() > -more.min() else "drift"


def _missing(wanted: CovarianceName, blocks: Blocks) -> str:
    if wanted == "drift":
        return "drift is judged beside poses; each of relative_poses begins where the robot is: use bootstrap"
    return (
        f"the logs are too short for {wanted}: {blocks.independent} blocks; log more, or information or drift"
    )

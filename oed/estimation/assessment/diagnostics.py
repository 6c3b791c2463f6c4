"""Does the fit hold? Tests of what it leaves, and what is not identifiable, each in a sentence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from oed.estimation.assessment.covariance import ENOUGH_LOGS
from oed.estimation.assessment.drift import drifting_scores
from oed.estimation.methods.drift_rates import DriftRates
from oed.estimation.methods.fit import SUREST, Fit
from oed.estimation.setup.noise import groups, in_turn, places_of
from oed.foundation.arrays import Array, Bools
from oed.foundation.text import words
from oed.kernel.measurement.square_root import SquareRoot
from oed.robots.sensors.logged import Noise

ALPHA = 0.01
"""Level of the tests."""
LAGS = 10
"""Correlations between successive residuals that whiteness is judged by."""
FAR = 4.0
"""Residuals beyond that many standard deviations are outliers."""
OPEN = 0.5
"""Relative standard error from which on a combination counts as not identifiable."""
PART = 0.1
"""Share of the largest from which on an unknown is part of a combination."""
TIED = 0.995
"""Correlation from which on two estimates are identifiable only together."""


@dataclass(frozen=True)
class Diagnostic:
    """One test.

    Attributes:
        name: "whiteness", "outliers", "stated_noise", "logs_agree".
        about: which readings.
        statistic: in its own unit.
        p_value: None where there is no distribution to compare with.
        passed: whether nothing speaks against the fit.
        message: in words.
        allowed_for: whether the standard errors in use allow for what it finds, None where they may.
    """

    name: str
    about: str
    statistic: float
    p_value: float | None
    passed: bool
    message: str
    allowed_for: bool | None = None


@dataclass(frozen=True)
class Expected:
    """By how much logs may differ.

    Attributes:
        drift: how fast the robot drifts, None where that is not known.
        degrees: degrees of freedom of what that makes the errors.
        any: whether standard errors allow for whatever whole logs differ by.
    """

    drift: DriftRates | None = None
    degrees: float = SUREST
    any: bool = False


BY_NOISE = Expected()
"""Logs differ by noise alone."""


def diagnostics(
    fit: Fit, specified: Mapping[str, Noise], expected: Expected = BY_NOISE
) -> tuple[Diagnostic, ...]:
    """All tests of a fit.

    Args:
        fit: of all logs.
        specified: noise that the study specifies, by the readings' kind; {} where it specifies none.
        expected: by how much logs may differ.
    """
    found = []
    for group in groups(fit.layout.quantities):
        places = places_of(group, fit.layout.quantities)
        found += [_whiteness(fit, group, places), _outliers(fit, group, places)]
        alone = fit.layout.relative or not fit.motions
        if group in specified and alone and not fit.innovations:
            found.append(_specified(fit, group, specified[group]))
    if len(fit.layout.logs) > 1:
        found.append(_agreement(fit, expected))
    return tuple(found)


def correlations(fit: Fit, places: list[int], lags: int = LAGS) -> tuple[Array, int]:
    """Correlations of residuals in units of the noise with those 1, 2, ... readings later, at most `lags` and
    a third of what there is in a row, and how many pairs of the first lag there are.

    What a segment's start takes out of white readings correlates their residuals: that is made good.

    Args:
        fit: of the logs.
        places: of the readings of one quantity.
        lags: how many.
    """
    z, left, valid = _in_turn(fit, places)
    scale = float((z[valid] ** 2).mean())
    share = float(left[valid].mean())
    if scale == 0 or share == 0:
        return np.zeros(1), 0
    found, pairs = [], 0
    for lag in range(1, max(1, min(lags, int(np.median(valid.sum(axis=1))) // 3)) + 1):
        both = valid[:, lag:] & valid[:, :-lag]
        # Starts take much the same from neighbours: what is taken of either stands for what both share.
        shared = np.sqrt((1 - left[:, lag:]) * (1 - left[:, :-lag])) / share
        alike = z[:, lag:] * z[:, :-lag] / scale
        found.append(float((alike + shared)[both].mean()) if both.any() else 0.0)
        pairs = pairs or int(both.sum())
    return np.array(found), pairs


def _in_turn(fit: Fit, places: list[int]) -> tuple[Array, Array, Bools]:
    # Residuals that follow each other, the shares of their variance that the fit leaves, and which there are:
    # those of a segment, or of all windows of a log.
    z, valid, owner = fit.white[..., places], fit.layout.valid[..., places], fit.layout.owner
    if not fit.motions:
        there, (z, left) = in_turn(valid, z, np.clip(fit.redundancy[..., places], 0.0, 1.0))
        return z, left, there
    each = [z[owner == log, -1] for log in np.unique(owner)]
    longest = max(map(len, each))
    rows = np.stack([np.pad(one, ((0, longest - len(one)), (0, 0))) for one in each])
    there = np.arange(longest) < np.array(list(map(len, each)))[:, None]
    return rows, np.ones(rows.shape), np.broadcast_to(there[..., None], rows.shape)


def _whiteness(fit: Fit, group: str, places: list[int]) -> Diagnostic:
    # Box and Pierce's statistic, pairs of all segments together.
    values, pairs = correlations(fit, places)
    statistic = pairs * float((values**2).sum())
    p_value = float(scipy.stats.chi2.sf(statistic, len(values)))
    if p_value > ALPHA:
        text = f"{group} residuals are white: nothing is left that the model could explain"
    else:
        text = (
            f"{group} residuals are not white (correlation {values[0]:.2f} from one reading to the next)"
            + _after_not_white(fit)
        )
    return Diagnostic("whiteness", group, statistic, p_value, p_value > ALPHA, text)


def _after_not_white(fit: Fit) -> str:
    if fit.innovations:
        return ": not all that errs is in the model, and F^-1 may be too small or too large"
    if fit.correlated is not None:
        return ", beside errors that last, which are allowed for"
    return ": F^-1 is too small; trust the bootstrap, the sandwich or drift"


def _outliers(fit: Fit, group: str, places: list[int]) -> Diagnostic:
    valid = fit.layout.valid[..., places]
    z, weights = fit.white[..., places][valid], fit.weights[..., places][valid]
    count, expected = int((np.abs(z) > FAR).sum()), z.size * 2 * scipy.stats.norm.sf(FAR)
    passed = bool(count <= max(5 * expected, 3))
    share = count / z.size
    text = f"{100 * share:.2f} % of the {group} residuals lie beyond {FAR:g} standard deviations"
    asked = "loss: huber, method: joint" if fit.innovations else "loss: huber"
    robust = "the loss" if (weights < 1).any() else f"a robust loss ({asked})"
    text += "" if passed else f": outliers; {robust} bounds what they do"
    return Diagnostic("outliers", group, share, None, passed, text)


def _specified(fit: Fit, group: str, specified: Noise) -> Diagnostic:
    # Chi-square of the residuals against the noise specified, at the speeds driven.
    places = places_of(group, fit.layout.quantities)
    valid = fit.layout.valid[..., places]
    found, wanted = (one.deviation(fit.speeds, fit.yaw_rates) for one in (fit.noises[group], specified))
    squares = float(((fit.white[..., places] * (found / wanted)[..., None])[valid] ** 2).sum())
    degrees = float(fit.redundancy[..., places][valid].sum())
    ratio = float(np.sqrt(squares / degrees))
    p_value = float(2 * min(scipy.stats.chi2.cdf(squares, degrees), scipy.stats.chi2.sf(squares, degrees)))
    passed = p_value > ALPHA
    text = f"{group} residuals are {ratio:.2f} times the noise that the study specifies"
    text += ", as they should be" if passed else ": specify what was found for the next design"
    return Diagnostic("stated_noise", group, ratio, p_value, passed, text)


def _agreement(fit: Fit, expected: Expected) -> Diagnostic:
    # Do the logs' own scores differ more than noise, and drift where it is known, would make them? Those of a
    # log are H d and what errs in it, with d common to all.
    drifts = expected.drift is not None and fit.by_start is not None
    scale, each = fit.unknowns.scale, []
    for log in np.unique(fit.layout.owner):
        own = fit.layout.owner == log
        matrix = fit.swing * fit.information[own].sum(axis=0)
        if expected.drift is not None and drifts:
            parts = drifting_scores(fit, own)
            matrix = matrix + np.tensordot(expected.drift.values, parts, axes=1)
        root = SquareRoot.of_matrix(matrix)
        white = root.factor[:, root.identifiable].T
        curvature, score = fit.curvature[own].sum(axis=0) * scale, fit.scores[own].sum(axis=0)
        each.append(white @ np.column_stack([curvature, score]))
    rows = np.vstack(each)
    slopes, scores = rows[:, :-1], rows[:, -1]
    common, _, rank, _ = np.linalg.lstsq(slopes, scores, rcond=None)
    statistic, degrees = float(((scores - slopes @ common) ** 2).sum()), max(len(rows) - int(rank), 1)
    ratio = float(np.sqrt(statistic / degrees))
    unsure = expected.degrees if drifts else SUREST
    p_value = float(scipy.stats.f.sf(statistic / degrees, degrees, unsure))
    passed = p_value > ALPHA
    what = "noise and drift would" if drifts else "the noise would"
    text = f"the logs differ from each other {ratio:.1f} times as much as {what} make them"
    text += "" if passed else _after_disagreement(len(fit.layout.logs), expected)
    return Diagnostic("logs_agree", "logs", ratio, p_value, passed, text, expected.any)


def _after_disagreement(logs: int, expected: Expected) -> str:
    if expected.any:
        return ", for which the error bars allow; look at the logs left out"
    if logs >= ENOUGH_LOGS:
        return ": F^-1 is too small; trust the bootstrap, and look at the logs left out"
    return (
        ": what differs lasts as long as a log (load, tyres, floor), and intervals are too narrow by that; "
        f"look at the logs left out, and log {ENOUGH_LOGS} runs or more, whose bootstrap allows for it"
    )


def weak_directions(fit: Fit, covariance: Array) -> tuple[str, ...]:
    """Sentences on what is not identifiable from the logs; () where everything is. See `not_identified`."""
    found = tuple(f"{what}: {remedy}" for what, remedy in not_identified(fit, covariance))
    return found or _tied(fit.unknowns.parameters, _relative(fit, covariance))


def not_identified(fit: Fit, covariance: Array, beyond: float = OPEN) -> tuple[tuple[str, str], ...]:
    """Combinations of parameters whose relative standard errors are larger than `beyond`, in words, and what
    helps, in words.

    Args:
        fit: of all logs.
        covariance: of all unknowns, (q, q), SI.
        beyond: standard error relative to the parameters' sizes.
    """
    names, found = fit.unknowns.parameters, []
    variances, vectors = np.linalg.eigh(_relative(fit, covariance))
    for index in np.flatnonzero(variances > beyond**2):
        vector = vectors[:, index]
        involved = np.flatnonzero(np.abs(vector) > PART * np.abs(vector).max())
        found.append(_sentence([names[place] for place in involved], vector[involved]))
    return tuple(found)


def _relative(fit: Fit, covariance: Array) -> Array:
    count = len(fit.unknowns.parameters)
    scale = fit.unknowns.scale[:count]
    return np.asarray(covariance[:count, :count] / np.outer(scale, scale))


def _sentence(names: list[str], shares: Array) -> tuple[str, str]:
    if len(names) == 1:
        return f"the logs do not identify {names[0]}", "fix it (leave it out of `estimate`) or give a `prior`"
    shares = shares / np.abs(shares).max()
    changes = ", ".join(f"{name} {10 * share:+.2g} %" for name, share in zip(names, shares, strict=True))
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    what = f"the logs do not identify {listed} separately (changing {changes} together hardly shows)"
    return what, "fix one of them, give a `prior`, or drive what separates them (`oed next`)"


def _tied(names: tuple[str, ...], relative: Array) -> tuple[str, ...]:
    sizes = np.sqrt(np.diag(relative))
    ties = relative / np.outer(sizes, sizes)
    return tuple(
        f"{words(names[first])} and {words(names[second])} are identifiable only together (correlation "
        f"{ties[first, second]:+.3f}): each alone is less sure than their combination"
        for first in range(len(names))
        for second in range(first + 1, len(names))
        if abs(ties[first, second]) > TIED
    )

"""Motions that sensors read of themselves, each a segment of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from oed.estimation.prediction.layout import GAP, SegmentLayout
from oed.estimation.setup.noise import groups, places_of, specified_noise
from oed.foundation.arrays import Array, Bools, Places
from oed.foundation.errors import FileIssue, LogError
from oed.kernel.measurement.measurement import Measurement
from oed.logs.log import Log
from oed.logs.motions import Motions
from oed.robots.sensors.logged import Noise

FINEST = 0.02
"""Shortest part that a motion is driven in [s]: the wheels' motion is taken to be even in each."""
MOST_PARTS, MOST_IN_ALL = 10_000, 2_000_000
"""Parts that one motion is driven in at most, and all of them together."""
LONG, FEW = 4.0, 10
"""Duration, in that of the usual motion, of those that a search does not begin with, if it has so many."""
CORRELATED = 1e-9
"""Correlation below which errors are independent but for rounding."""


def motion_segments(logs: Sequence[Log], offsets: Sequence[float]) -> SegmentLayout:
    """The motions of logs while their wheels are logged, each driven in parts as long as wheels are read.

    Args:
        logs: with motions.
        offsets: of each log's clocks, as far as known [s].

    Raises:
        LogError: no motion of any log is within its wheels' log, or only some logs give covariances.
    """
    each = [
        log.motions.rows(driven(log, offset))
        for log, offset in zip(logs, offsets, strict=True)
        if log.motions is not None
    ]
    owner = np.repeat(np.arange(len(logs)), [len(one) for one in each])
    if not len(owner):
        text = "no motion is read while the wheels are logged; are the two clocks together?"
        raise LogError([FileIssue(log.file, 0, 0, "", text) for log in logs])
    spans, values = (np.concatenate([getattr(one, name) for one in each]) for name in ("times", "values"))
    readings = np.stack([np.zeros_like(values), values], axis=1)
    valid = np.broadcast_to(np.array([[False], [True]]), readings.shape).copy()
    sizes, whitener = _errors(logs, each)
    return SegmentLayout(
        tuple(logs),
        owner,
        spans,
        readings,
        valid,
        math.inf,
        relative=True,
        sizes=sizes,
        whitener=whitener,
        parts=motion_parts(
            np.diff(spans)[:, 0], min(float(np.median(np.diff(log.input_times))) for log in logs)
        ),
    )


def motion_parts(lengths: Array, step: float) -> Places:
    """How many equal parts motions are driven in, (m,).

    Args:
        lengths: of the motions, (m,) [s].
        step: between readings of the inputs [s].
    """
    shortest = max(step, FINEST)
    shortest = max(shortest, float(lengths.clip(max=MOST_PARTS * shortest).sum()) / MOST_IN_ALL)
    return np.ceil(lengths / shortest - 1e-6).clip(1, MOST_PARTS).astype(np.intp)


def with_usual_motions(logs: Sequence[Log]) -> list[Log]:
    """Logs to begin with, without motions much longer than the usual one; [] where there are none of these,
    or few others. Over a long motion a wrong size turns the robot anywhere: from there no derivative leads
    back.
    """
    each = [log.motions for log in logs if log.motions is not None]
    lengths = np.concatenate([one.lengths for one in each])
    longest = LONG * float(np.median(lengths))
    if not FEW <= np.count_nonzero(lengths <= longest) < len(lengths):
        return []
    return [
        replace(log, motions=one.rows(one.lengths <= longest)) for log, one in zip(logs, each, strict=True)
    ]


def driven(log: Log, offset: float) -> Bools:
    """During which of a log's motions (m,) its wheels are logged without a gap, at the clocks' offset [s]."""
    assert log.motions is not None
    times = log.motions.times + offset
    clock = log.input_times
    inside = (times[:, 0] >= clock[0]) & (times[:, 1] <= clock[-1])
    steps = np.diff(clock)
    late = np.flatnonzero(steps > (GAP * float(np.median(steps)) if log.gap is None else log.gap))
    for index in late:
        inside &= (times[:, 0] >= clock[index + 1]) | (times[:, 1] <= clock[index])
    return np.asarray(inside)


def specified_errors(logs: Sequence[Log]) -> dict[str, Noise]:
    """The noise of a typical motion by the covariances that logs give, by its kind; {} without any."""
    given = [log.motions.covariances for log in logs if log.motions is not None]
    known = [one for one in given if one is not None]
    if not known:
        return {}
    variances, names = np.diagonal(np.concatenate(known), axis1=1, axis2=2), logs[0].quantities
    own = {group: variances[:, places_of(group, names)] for group in groups(names)}
    return {group: Noise(float(np.sqrt(np.median(each)))) for group, each in own.items()}


def noise_specified(measurement: Measurement, logs: Sequence[Log]) -> dict[str, Noise]:
    """The noise of logs' readings that they or a measurement specify, by kind of reading."""
    relative = logs[0].motions is not None
    return specified_errors(logs) or specified_noise(measurement, logs[0].averaged, relative=relative)


def _errors(logs: Sequence[Log], each: Sequence[Motions]) -> tuple[Array | None, Array | None]:
    # Sizes relative to a typical motion's, and what makes the correlated errors independent.
    typical, quantities = specified_errors(logs), logs[0].quantities
    if not typical:
        return None, None
    missing = [log for log, one in zip(logs, each, strict=True) if one.covariances is None]
    if missing:
        text = "gives no covariances of its motions, other logs do"
        raise LogError([FileIssue(log.file, 0, 0, "", text) for log in missing])
    given = np.concatenate([one.covariances for one in each if one.covariances is not None])
    own = np.sqrt(np.diagonal(given, axis1=1, axis2=2))
    usual = np.ones(len(quantities))
    for group, noise in typical.items():
        usual[places_of(group, quantities)] = noise.at_rest
    correlation = given / (own[:, :, None] * own[:, None, :])
    alone = np.abs(correlation - np.eye(len(usual))).max(initial=0.0) < CORRELATED
    return (own / usual)[:, None], None if alone else np.linalg.inv(np.linalg.cholesky(correlation))

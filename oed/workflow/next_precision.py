"""How precise an estimate will be after a drive that is designed, under the drift that logs show, or with
readings whose errors last as theirs do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.estimation.assessment.covariance import information
from oed.estimation.assessment.drift import drift
from oed.estimation.methods.drift_rates import DriftRates
from oed.estimation.methods.fitting import Fitting
from oed.estimation.methods.gauss_markov import GaussMarkov
from oed.estimation.methods.window_noise import drift_in_words
from oed.estimation.methods.windows import READ
from oed.estimation.prediction.layout import cut
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.setup.unknowns import Unknowns
from oed.foundation.arrays import Array
from oed.foundation.text import size_text
from oed.kernel.dynamics.trajectory import Trajectory
from oed.logs.log import Log
from oed.records.record import EstimateRecord, Record
from oed.robots.models.model import Model, robot_of
from oed.robots.sensors.logged import Noise
from oed.study.study import Study

MOST = 4000
"""Readings of the next drive that are looked at, at most."""


@dataclass(frozen=True)
class Predicted:
    """Standard errors after a drive, what is known before it included.

    Attributes:
        errors: by parameter, SI; {} where there is no drive.
        basis: what they rest on, in words.
    """

    errors: Mapping[str, float]
    basis: str = ""


def predicted(record: Record, found: EstimateRecord, study: Study) -> Predicted:
    """Those after a record's best drive.

    Args:
        record: of the next drive's design, which takes noise for white.
        found: the estimate so far.
        study: of the next drive: of the robot as it is known now.
    """
    best = record.best
    if best is None or not best.covariances:
        return Predicted({})
    known = np.array(found.covariance, dtype=float)
    lasts, drifts = found.lasting is not None, found.drift is not None
    by_white = found.covariance_kind == "information" and not lasts
    if by_white or best.drive is None or not (lasts or drifts):
        gained, base, basis = white_information(record, found), "information", _ratio_in_words(found)
    else:
        gained = planned_information(best.drive.trajectory, found, study)
        base, basis = (
            ("information", _lasting_in_words(found)) if lasts else ("drift", _drift_in_words(found))
        )
    # Where parts of the logs disagree more than that, so will those of the next drive.
    kind = found.covariance_kind or base
    pairs = ((one.error(kind), one.error(base)) for one in found.parameters)
    more = np.array([max(1.0, own / usual) if own and usual else 1.0 for own, usual in pairs])
    after = np.linalg.inv(np.linalg.inv(known) + gained / np.outer(more, more))
    errors = dict(zip(found.values, map(float, np.sqrt(np.diag(after))), strict=True))
    return Predicted(errors, f"standard errors after it: {basis}")


def _ratio_in_words(found: EstimateRecord) -> str:
    if found.covariance_kind == "information":
        return "the logs show no drift that matters, and readings are thought to be independent of each other"
    return "as much larger than F^-1 as those of the logs so far"


def _drift_in_words(found: EstimateRecord) -> str:
    assert found.drift is not None
    origin = "as robots usually do" if found.drift.seconds is None else "as the logs so far show"
    return f"the next drive is thought to drift {origin}, {drift_in_words(_rates(found).values)}"


def _lasting_in_words(found: EstimateRecord) -> str:
    assert found.lasting is not None
    seconds = size_text(found.lasting.seconds, "s", 2)
    return f"errors of the next drive's readings are thought to last for {seconds}, as the logs so far show"


def _rates(found: EstimateRecord) -> DriftRates:
    one = found.drift
    assert one is not None
    sizes = np.array([one.ahead, one.sideways, one.turn_by_path, one.turn_by_turning], dtype=float)
    return DriftRates(sizes**2, np.zeros((len(sizes), len(sizes))))


def white_information(record: Record, found: EstimateRecord) -> Array:
    """Information (p, p) that a design's best drive adds to what is known, by white noise."""
    names, known = list(found.values), np.array(found.covariance, dtype=float)
    gained = np.zeros_like(known)
    for one in record.best.covariances if record.best else ():
        places = [names.index(name) for name in one.parameters]
        own, then = np.ix_(places, places), np.array(one.covariance, dtype=float)
        gained[own] += np.linalg.inv(then) - np.linalg.inv(known[own])
    return gained


def planned_information(trajectory: Trajectory, found: EstimateRecord, study: Study) -> Array:
    """Information (p, p) that a fit like an estimate's will have of a drive, logged alike and erring alike.

    Args:
        trajectory: of the drive.
        found: the estimate, with the drift or the lasting errors of readings that it found.
        study: of the robot as it is known.
    """
    robot, names = robot_of(study.problem.system), tuple(found.values)
    fitting = Fitting(robot, names, study.problem.measurement, study.calibration)
    seconds = None if found.segments is None else found.segments.seconds
    noises = {one.about: _noise(one.at_rest, one.per_speed, one.per_yaw_rate) for one in found.noise}
    quantities = tuple(found.logs[0].quantities or READ)
    logs = planned_logs(robot, trajectory, _step(found, trajectory), quantities)
    lasting = _lasting(found, noises)
    fit = fitting.planned(logs, math.inf if seconds is None else seconds, noises, lasting)
    then = information(fit) if lasting else drift(fit, _rates(found))
    return np.asarray(np.linalg.inv(then.matrix[: len(names), : len(names)]))


def _lasting(found: EstimateRecord, noises: Mapping[str, Noise]) -> GaussMarkov | None:
    if found.lasting is None:
        return None
    white = {name: noise.at_rest for name, noise in noises.items()}
    return GaussMarkov(white, found.lasting.sizes, found.lasting.seconds)


def _noise(*parts: float | None) -> Noise:
    return Noise(*(float(part or 0.0) for part in parts))


def _step(found: EstimateRecord, trajectory: Trajectory) -> float:
    # Time between readings, as logged so far.
    readings = sum(one.poses or 0 for one in found.logs)
    usual = sum(one.seconds or 0.0 for one in found.logs) / max(readings, 1)
    return max(usual, trajectory.duration * trajectory.runs / MOST)


def planned_logs(
    robot: Model, trajectory: Trajectory, step: float, quantities: Sequence[str]
) -> tuple[Log, ...]:
    """Logs of a drive as it is planned, run by run, without any error.

    Args:
        robot: at the parameters that it has.
        trajectory: of all runs.
        step: time between readings, about [s].
        quantities: the states that are read.
    """
    return tuple(
        _planned(robot, run, step, tuple(quantities), f"run {number}")
        for number, run in enumerate(trajectory.each, 1)
    )


def _planned(robot: Model, run: Trajectory, step: float, quantities: tuple[str, ...], name: str) -> Log:
    parts = max(1, round(run.period / step))
    inputs, each = np.repeat(run.inputs, parts, axis=0), run.period / parts
    times = np.linspace(0.0, len(inputs) * each, len(inputs) + 1)
    turned = np.vstack([np.zeros((1, inputs.shape[1])), np.cumsum(inputs * each, axis=0)])
    log = Log(name, name, times, turned, times, np.zeros((len(times), len(quantities))), quantities)
    unknowns, start = Unknowns(robot, (), (), 0), np.reshape(run.start, (1, -1))
    readings = LoggedReadings(cut([log], math.inf, [0.0]), unknowns, np.zeros(1), quantities)
    return replace(log, poses=readings(np.zeros(0), start)[0])

"""How precise an estimate will be after a drive that is designed, under the drift that logs show, or with
readings whose errors last as theirs do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from oed.estimation.assessment.covariance import information
from oed.estimation.assessment.drift import drift
from oed.estimation.methods.drift_rates import DriftRates
from oed.estimation.methods.fitting import Fitting
from oed.estimation.methods.gauss_markov import GaussMarkov
from oed.estimation.methods.log_errors import DRIFT
from oed.estimation.methods.whole_logs import WholeLogs
from oed.estimation.methods.window_noise import drift_in_words
from oed.foundation.arrays import Array
from oed.foundation.text import size_text
from oed.kernel.dynamics.trajectory import Trajectory
from oed.records.record import EstimateRecord, Record
from oed.robots.models.model import robot_of
from oed.robots.sensors.logged import Noise
from oed.study.study import Study
from oed.workflow.planned_logs import Logging


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
    by_white = found.covariance_kind == "information" and not (lasts or found.log_errors)
    if by_white or best.drive is None or not (lasts or drifts):
        gained, base, basis = white_information(record, found), "information", _ratio_in_words(found)
    else:
        gained = planned_information(best.drive.trajectory, found, study)
        base = "information" if lasts or found.log_errors else "drift"
        basis = _lasting_in_words(found) if lasts else _drift_in_words(found)
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
    usual = found.drift.seconds is None and not found.log_errors
    origin = "as robots usually do" if usual else "as the logs so far show"
    return f"the next drive is thought to drift {origin}, {drift_in_words(_rates(found).values)}"


def _lasting_in_words(found: EstimateRecord) -> str:
    assert found.lasting is not None
    seconds = size_text(found.lasting.seconds, "s", 2)
    return f"errors of the next drive's readings are thought to last for {seconds}, as the logs so far show"


def _rates(found: EstimateRecord) -> DriftRates:
    one = found.drift
    assert one is not None
    sizes = np.array([getattr(one, name) for name in DRIFT], dtype=float)
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
    logging = Logging.of(found, study.problem.measurement, trajectory.duration)
    logs = logging.of_drive(robot, trajectory)
    lasting = _lasting(found, noises)
    if found.log_errors:
        sizes = {one.name: float(one.size or 0.0) for one in found.log_errors}
        whole = WholeLogs(fitting.planned(logs, math.inf, noises)).planned(sizes)
        return np.asarray(np.linalg.inv(whole[: len(names), : len(names)]))
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

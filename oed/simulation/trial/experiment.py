"""One simulated robot drives every path; every model is calibrated from each and predicts other drives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from oed.estimation.assessment.dead_reckoning import dead_reckoned
from oed.estimation.methods.fitting import Fitting
from oed.estimation.preprocessing.preprocess import preprocess
from oed.foundation.arrays import Array
from oed.foundation.errors import Failure, UserMistake
from oed.kernel.dynamics.trajectory import Trajectory
from oed.logs.log import Log
from oed.robots.models.model import Model
from oed.simulation.physics import Motion, PhysicsRobot, Sensing, Variation, drive
from oed.simulation.trial.attainable import ORIGIN, attainable_error

STREAM = 29
"""Of the random numbers that robots and noise are drawn from."""
DRAWS = 100
"""Of a robot that stands, before giving up."""
LEAST_RATE = 50.0
"""At which motion is logged at least, and dead reckoning reads the encoders [1/s]."""


@dataclass(frozen=True)
class Bench:
    """What every repeat does.

    Attributes:
        robot: the nominal one.
        variation: of the robots drawn.
        sensing: of the drives to calibrate from.
        drives: to calibrate from, by name.
        held_out: to predict.
        fits: how every model is calibrated, by name.
        seed: of every random draw.
    """

    robot: PhysicsRobot
    variation: Variation
    sensing: Sensing
    drives: Mapping[str, Trajectory]
    held_out: tuple[Trajectory, ...]
    fits: Mapping[str, Fitting]
    seed: int


@dataclass(frozen=True)
class Repeat:
    """One robot on one floor, by their numbers.

    Attributes:
        bench: what it does there.
        friction: of the floor.
        floor, number: what its random numbers follow from, besides the seed.
    """

    bench: Bench
    friction: float
    floor: int
    number: int


@dataclass(frozen=True)
class Found:
    """What came of a repeat; without a number where a calibration was refused.

    Attributes:
        values: estimates by (drive, fit), SI.
        end: distance from where the robot truly is to where dead reckoning has it, at the end of every
            held-out drive, (drives, fits, held-out drives) [m].
        along: root mean square of the same all along the drive [m].
        attainable: what the model of every fit could have at best of the root mean square over all held-out
            drives, (fits,) [m].
        misfit: mean square of the residuals in units of the specified noise, (drives, fits).
        paths: true x, y of the drives, each (n, 2) [m].
        friction: of the robot that was drawn.
    """

    values: Mapping[tuple[str, str], Array]
    end: Array
    along: Array
    attainable: Array
    misfit: Array
    paths: Mapping[str, Array]
    friction: float


def repeated(repeat: Repeat) -> Found | None:
    """Draw a robot, drive, calibrate, predict; None for a robot that tips over or whose simulation fails."""
    try:
        return _repeated(repeat)
    except Failure:
        return None


def _repeated(repeat: Repeat) -> Found:
    bench, numbers = repeat.bench, (repeat.bench.seed, STREAM, repeat.floor, repeat.number)
    robot = _drawn(bench, repeat.friction, np.random.default_rng(numbers))
    motions = {name: _driven(bench, robot, planned) for name, planned in bench.drives.items()}
    # Each drive has noise of its own, whichever others there are.
    logs = {
        name: bench.sensing.read(motion, np.random.default_rng([*numbers, crc32(name.encode())]), name)
        for name, motion in motions.items()
    }
    held_out = [exact_log(_driven(bench, robot, planned)) for planned in bench.held_out]
    shape = len(bench.drives), len(bench.fits)
    end, along = (np.full((*shape, len(held_out)), np.inf) for _ in range(2))
    misfit, values = np.full(shape, np.inf), dict[tuple[str, str], Array]()
    found_by = {label: list[Array]() for label in bench.fits}
    for row, (name, log) in enumerate(logs.items()):
        for column, (label, fitting) in enumerate(bench.fits.items()):
            found = _calibrated(fitting, log)
            if found is None:
                continue
            values[name, label], whole, misfit[row, column] = found
            found_by[label].append(whole)
            errors = [prediction_errors(fitting, one, whole) for one in held_out]
            end[row, column], along[row, column] = np.transpose(errors)
    paths = {name: motion.poses[:, :2] for name, motion in motions.items()}
    attainable = _attainable(bench, held_out, found_by)
    return Found(values, end, along, attainable, misfit, paths, robot.friction)


def _attainable(bench: Bench, held_out: list[Log], found: Mapping[str, list[Array]]) -> Array:
    # Fits of one model by several methods have the same.
    starts, best = dict[Model, list[Array]](), dict[Model, float]()
    for label, fitting in bench.fits.items():
        starts.setdefault(fitting.robot, []).extend(found[label])
    for fitting in bench.fits.values():
        if fitting.robot not in best:
            best[fitting.robot] = attainable_error(fitting, held_out, starts[fitting.robot])
    return np.array([best[fitting.robot] for fitting in bench.fits.values()])


def _drawn(bench: Bench, friction: float, rng: np.random.Generator) -> PhysicsRobot:
    # One that stands: those whose centre of mass lies beyond their wheels are drawn again.
    nominal = bench.robot.changed(friction=friction)
    for _ in range(DRAWS):
        try:
            return bench.variation.draw(nominal, rng)
        except ValueError:
            continue
    raise Failure(f"none of {DRAWS} robots drawn can stand: narrow the variation of the centre of mass")


def exact_log(motion: Motion) -> Log:
    """A motion logged without any error, the pose with every reading of the encoders."""
    name = "held-out drive"
    return Log(name, name, motion.times, motion.wheel_angles, motion.times, motion.poses)


def prediction_errors(fitting: Fitting, log: Log, parameters: Array) -> tuple[float, float]:
    """Dead reckoning from a log's first pose, by its encoders alone: how far off it ends, and the root mean
    square of that all along [m].

    Args:
        fitting: of the model that predicts.
        log: of the true motion.
        parameters: of the robot, all of them (p,), SI.
    """
    found = dead_reckoned(fitting.robot, log, parameters, ORIGIN, 0.0)
    assert found.end_position is not None
    assert found.rmse_position is not None
    return found.end_position, found.rmse_position


def _driven(bench: Bench, robot: PhysicsRobot, planned: Trajectory) -> Motion:
    readings = bench.sensing.pose_rate
    rate = readings * math.ceil(LEAST_RATE / readings - 1e-9)
    return drive(robot, planned.inputs, planned.period, start=planned.start[:3], rate=rate)


def _calibrated(fitting: Fitting, log: Log) -> tuple[Array, Array, float] | None:
    # Estimates, all of the robot's parameters with them, and the misfit; None where the log is refused.
    options = fitting.options
    try:
        usable = preprocess(fitting.robot, [log], compare_clocks=options.clock_offset)
        fit = fitting.fitted(usable).fit
    except (UserMistake, np.linalg.LinAlgError):
        return None
    estimates = fit.values[: len(fit.unknowns.parameters)]
    return np.array(estimates), fit.unknowns.parts(fit.values)[0], fit.misfit

"""What drives of the models on trial are designed for: the optimum, a task, noise that knows of slip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.estimation.assessment.residual_growth import growth
from oed.estimation.methods.fitting import Fitting
from oed.estimation.preprocessing.preprocess import preprocess
from oed.kernel.criteria import I, TaskDrive
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.measurement import measurement_of
from oed.kernel.problem import Problem
from oed.robots.sensors import Poses
from oed.robots.sensors.pose_noise import Discrepancy
from oed.simulation.physics import Sensing, drive
from oed.simulation.trial.candidates import Candidate
from oed.simulation.trial.options import Pilot, Trial, held_out_drives, paced_baseline

STREAM = 41
"""Of the random numbers of a pilot drive's noise."""
OPTIMAL, TASK, WITH_DISCREPANCY = "optimal", "for the task", "with discrepancy"
"""What drives of a model are designed for; names of drives begin with it."""


@dataclass(frozen=True)
class Aim:
    """A drive to design for a model.

    Attributes:
        name: what it is for.
        model: with the problem of designing it.
        discrepancy: that the noise there has; None without.
    """

    name: str
    model: Candidate
    discrepancy: Discrepancy | None = None


def sensing_of(problem: Problem) -> Sensing:
    """How simulated drives are read: as the study measures, with the sensor's own noise alone.

    Args:
        problem: the study's.
    """
    (sensor,) = problem.sensors
    assert isinstance(sensor, Poses)
    # What the model cannot say the simulated robot does by itself.
    return Sensing(pose_rate=1 / (problem.design.period * sensor.every), noise=sensor.noise.of_sensor)


def aims(problem: Problem, trial: Trial, model: Candidate, fitting: Fitting, seed: int) -> Iterator[Aim]:
    """Every drive that a trial designs for a model, the optimal one first.

    Args:
        problem: the study's.
        trial: what to try.
        model: to design for.
        fitting: how it is calibrated.
        seed: of every random draw.
    """
    yield Aim(OPTIMAL, model)
    aimed, name = model, OPTIMAL
    if trial.task:
        task = task_of(held_out_drives(problem, trial.held_out, seed))
        aimed, name = Candidate(model.name, replace(model.problem, criterion=task)), TASK
        yield Aim(name, aimed)
    if trial.discrepancy is not None:
        found = trial.discrepancy
        if isinstance(found, Pilot):
            found = pilot_discrepancy(problem, trial, fitting, found.pilot, seed)
        noisier = with_discrepancy(aimed.problem, found)
        yield Aim(f"{name} {WITH_DISCREPANCY}", Candidate(model.name, noisier), found)


def task_of(drives: Sequence[Trajectory]) -> I:
    """The criterion of drives that are to be predicted."""
    return I(task=[TaskDrive(inputs=one.inputs.tolist(), period=one.period) for one in drives])


def with_discrepancy(problem: Problem, found: Discrepancy) -> Problem:
    """A problem whose noise of poses has a discrepancy, too."""
    (sensor,) = problem.sensors
    assert isinstance(sensor, Poses)
    noise = sensor.noise.model_copy(update={"discrepancy": found})
    return replace(problem, measurement=measurement_of(sensor.model_copy(update={"noise": noise})))


def pilot_discrepancy(problem: Problem, trial: Trial, fitting: Fitting, pilot: str, seed: int) -> Discrepancy:
    """What a pilot drive's residuals say of a model: of the nominal robot, on a floor between the others.

    Args:
        problem: the study's.
        trial: whose robot drives.
        fitting: of the model.
        pilot: name of the baseline.
        seed: of its noise.
    """
    planned = paced_baseline(problem, pilot, seed)
    robot = trial.robot.changed(friction=float(np.mean(trial.frictions)))
    motion = drive(robot, planned.inputs, planned.period, start=planned.start[:3])
    log = sensing_of(problem).read(motion, np.random.default_rng([seed, STREAM]), "pilot")
    fit = fitting.fitted(preprocess(fitting.robot, [log], compare_clocks=False)).fit
    speeds, rates = fit.speeds.ravel(), fit.yaw_rates.ravel()
    x, y, heading = (fit.residuals[..., place].ravel() for place in range(3))
    _, along, turning = growth(np.concatenate([x, y]), np.tile(speeds, 2), np.tile(rates, 2))
    _, of_speed, of_rate = growth(heading, speeds, rates)
    return Discrepancy(
        position_per_speed=along,
        position_per_yaw_rate=turning,
        heading_per_speed=of_speed,
        heading_per_yaw_rate=of_rate,
    )

"""The least error that a model can have on drives, and what it has more from a calibration."""

from __future__ import annotations

import numpy as np
import pytest
from trials import study_of

from oed.simulation.physics import FourWheels, Motion, drive
from oed.simulation.trial.attainable import attainable_error, overall
from oed.simulation.trial.candidates import candidates
from oed.simulation.trial.experiment import exact_log, prediction_errors
from oed.simulation.trial.options import held_out_drives

TRUE = np.array([0.0484, 0.0493, 0.334])
"""Radii and track of a robot that obeys its model."""


def fitting_of(number: int = 0):
    study = study_of()
    model = candidates(study.problem, study.file.physics)[number]
    return study.problem, model.fitting(study.file.physics.calibration, "joint")


def ideal(planned) -> Motion:
    """The motion of a differential drive with `TRUE` constants, on arcs."""
    right, left, track = TRUE
    each, pose = 5, np.zeros(3)
    step, poses, angles = planned.period / each, [np.zeros(3)], [np.zeros(2)]
    for wheels in np.repeat(planned.inputs, each, axis=0):
        ahead = (right * wheels[0] + left * wheels[1]) / 2 * step
        turn = (right * wheels[0] - left * wheels[1]) / track * step
        chord = ahead * np.sinc(turn / 2 / np.pi)
        middle = pose[2] + turn / 2
        pose = pose + np.array([chord * np.cos(middle), chord * np.sin(middle), turn])
        poses.append(pose)
        angles.append(angles[-1] + step * wheels)
    times = step * np.arange(len(poses))
    return Motion(times, np.array(angles), np.array(poses), planned.inputs, planned.period)


@pytest.mark.slow
def test_a_model_that_is_right_leaves_nothing():
    problem, fitting = fitting_of()
    logs = [exact_log(ideal(one)) for one in held_out_drives(problem, 2, seed=3)]
    assert attainable_error(fitting, logs, []) < 1e-8
    errors = [prediction_errors(fitting, one, np.array(fitting.robot.nominal))[1] for one in logs]
    assert min(errors) > 1e-3


@pytest.mark.slow
def test_no_parameters_nearby_predict_slipping_drives_better():
    problem, fitting = fitting_of()
    plans = held_out_drives(problem, 2, seed=3)
    robot = FourWheels(step=0.001, friction=0.6)
    logs = [exact_log(drive(robot, one.inputs, one.period, rate=50.0)) for one in plans]
    least = attainable_error(fitting, logs, [])
    assert least > 1e-4
    rng = np.random.default_rng(0)
    for size in (1e-4, 1e-3, 1e-2, 3e-2):
        for number in range(5):
            values = np.array([0.049, 0.049, 0.325]) * (1 + size * rng.normal(size=3))
            found = overall(np.array([prediction_errors(fitting, one, values)[1] for one in logs]))
            assert found >= least * (1 - 1e-9)
            if number == 0:
                assert attainable_error(fitting, logs, [values]) == pytest.approx(least, rel=1e-4)

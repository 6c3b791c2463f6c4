"""Readings of a drive in units of the noise, and their derivatives by all that is unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, block_columns
from oed.foundation.errors import UserMistake
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.sensor import Moment, Sensor


@lru_cache(maxsize=64)
def reader(sensor: Sensor, system: System, signal: str = "") -> ca.Function:
    """Return the function (state, inputs, parameters, nuisances, period, error) -> a sensor's reading (q,)
    and its whitening (q, q), sparse.

    For a reading between two moments the state and inputs of the later one stand above those of the earlier,
    and the period is the time between them.

    Args:
        sensor: sensor that reads.
        system: system that is driven.
        signal: name of the system's signal that errs, by the error at the later moment; "" for none.
    """
    states, held, moments = (
        len(system.states),
        len(system.inputs),
        2 if sensor.when == "between samples" else 1,
    )
    state, inputs = ca.SX.sym("state", moments * states), ca.SX.sym("inputs", moments * held)
    parameters, period = ca.SX.sym("p", len(system.parameters)), ca.SX.sym("period")
    constants, error = ca.SX.sym("nuisances", len(sensor.nuisances)), ca.SX(0, 1)
    names = [nuisance.name for nuisance in sensor.nuisances]
    nuisances = dict(zip(names, ca.vertsplit(constants), strict=True))
    lasting = period if sensor.when == "in periods" else 0.0
    moment: Moment | None = None
    for place in reversed(range(moments)):
        at = state[place * states : (place + 1) * states, :]
        inputs_then = inputs[place * held : (place + 1) * held, :]
        signals = dict(system.signals(at, inputs_then, parameters, lasting))
        if signal and not place:
            error = ca.SX.sym("error", signals[signal].shape[0])
            signals[signal] = signals[signal] + error
        elapsed = period if moment else 0.0
        moment = Moment(system, at, inputs_then, signals, nuisances, moment, elapsed, lasting)
    assert moment is not None
    # Sparse: readings of many points are independent of each other.
    reading, whitening = sensor.reading(moment), ca.sparsify(ca.SX(sensor.whitening(moment)))
    if whitening.shape != 2 * (reading.numel(),):
        text = f"expected {2 * (reading.numel(),)}, as its reading has entries, got {whitening.shape}"
        raise UserMistake(f"measurement: the whitening of {sensor.kind}: {text}")
    return ca.Function("reader", [state, inputs, parameters, constants, period, error], [reading, whitening])


@lru_cache(maxsize=64)
def moment_reading(sensor: Sensor, system: System) -> ca.Function:
    """Return a sensor's reading as a function of (state, S, inputs, parameters, nuisances, period).

    S (states, p + states) are the state's derivatives by parameters and start; for a reading between two
    moments those of the later one stand above those of the earlier, see `reader`. The results are the reading
    (q,), its derivatives by parameters, start and nuisances (columns, q), its whitening (q, q), sparse, and
    the first two in units of the noise.
    """
    read, states = reader(sensor, system), len(system.states)
    state, inputs, parameters, constants, period, none = read.sx_in()
    carried = ca.SX.sym("S", state.shape[0], parameters.shape[0] + states)
    reading, whitening = read(state, inputs, parameters, constants, period, none)
    direct = ca.horzcat(ca.jacobian(reading, parameters), ca.SX(reading.shape[0], states))
    through = ca.jacobian(reading, state) @ carried + direct
    jacobian = ca.densify(ca.horzcat(through, ca.jacobian(reading, constants)))
    return ca.Function(
        "reading",
        [state, carried, inputs, parameters, constants, period],
        [reading, jacobian.T, whitening, whitening @ reading, (whitening @ jacobian).T],
    )


def reading_by_signal(sensor: Sensor, system: System, name: str) -> ca.Function:
    """Return the derivatives (n, q) of a sensor's reading by a signal (n,), as a function of (state, inputs,
    parameters, nuisances, period).

    Args:
        sensor: sensor that reads.
        system: system whose signal it is.
        name: name of the signal.
    """
    read = reader(sensor, system, name)
    *arguments, error = read.sx_in()
    slopes = ca.jacobian(read(*arguments, error)[0], error)
    slopes = ca.substitute(slopes, error, ca.SX.zeros(*error.shape))
    return ca.Function("by_signal", arguments, [ca.densify(slopes).T])


def readings(sensor: Sensor, drive: Drive) -> tuple[Expression, Expression]:
    """Return a sensor's readings of a drive, (rows,), and their derivatives, (rows, columns).

    Both are in units of the noise, with the nuisances at their nominal values; the columns are those of the
    parameters, the start states and the sensor's nuisances.
    """
    samples, runs = drive.samples, np.arange(drive.runs)[:, None]
    states, sensitivities, inputs = list[Expression](), list[Expression](), list[Expression]()
    for instants in sensor.instants(samples):
        places = (runs * (samples + 1) + instants).ravel()
        # At the last sample's instant the inputs are those held until then.
        held = (runs * samples + np.minimum(instants, samples - 1)).ravel()
        states.append(drive.states.T[:, places.tolist()])
        sensitivities.append(drive.sensitivities[:, block_columns(places, drive.columns)])
        inputs.append(drive.inputs.T[:, held.tolist()])
    function = moment_reading(sensor, drive.system).map(states[0].shape[1])
    response, transposed, _, white_response, white_transposed = function(
        ca.vertcat(*states),
        ca.vertcat(*sensitivities),
        ca.vertcat(*inputs),
        drive.parameters,
        ca.DM([nuisance.nominal for nuisance in sensor.nuisances]),
        sensor.lasting * drive.period,
    )
    joint = whole_whitening(sensor, response.numel() // drive.runs)
    if joint is not None:
        weights = ca.diagcat(*[ca.DM(joint)] * drive.runs)
        white_response, white_transposed = weights @ ca.vec(response), transposed @ weights.T
    return ca.vec(white_response), by_run(white_transposed, drive).T


def whole_whitening(sensor: Sensor, rows: int) -> Array | None:
    """Return `joint_whitening` of a run that gives so many numbers, (rows, rows); None without one.

    Raises:
        UserMistake: the deviation is for another number.
    """
    whitening = sensor.joint_whitening
    if whitening is not None and len(whitening) != rows:
        raise UserMistake(
            f"the covariance of all readings is for {len(whitening)} of them; this drive gives {rows}"
        )
    return whitening


def by_run(transposed: Expression, drive: Drive) -> Expression:
    """Return derivatives (columns, M) of readings run by run with rows for every run's start state.

    Args:
        transposed: derivatives by parameters, the own run's start states and nuisances, (rows, M).
        drive: drive with the runs.
    """
    if drive.runs == 1:
        return transposed
    size, states = len(drive.system.parameters), len(drive.system.states)
    starts = ca.horzsplit(transposed[size : size + states, :], transposed.shape[1] // drive.runs)
    return ca.vertcat(transposed[:size, :], ca.diagcat(*starts), transposed[size + states :, :])


def joint_readings(sensors: Sequence[Sensor], drive: Drive) -> tuple[Sequence[Expression], Expression]:
    """Return the readings of every sensor, (rows,) each, and the derivatives of all of them, (M, columns).

    Both are in units of the noise, with the nuisances at their nominal values; the columns are those of the
    parameters, the start states and all nuisances.
    """
    responses, jacobians = zip(*(readings(sensor, drive) for sensor in sensors), strict=True)
    # Parameters and start are common to all sensors; every nuisance belongs to a single one.
    common = len(drive.system.parameters) + drive.runs * len(drive.system.states)
    parts = (ca.horzsplit(jacobian, [0, common, jacobian.shape[1]]) for jacobian in jacobians)
    shared, separate = zip(*parts, strict=True)
    return responses, ca.horzcat(ca.vertcat(*shared), ca.diagcat(*separate))


def labelled_nuisances(sensors: Sequence[Sensor]) -> tuple[Nuisance, ...]:
    """Return the sensors' nuisances with unique names."""
    return tuple(
        replace(nuisance, name=f"{label}.{nuisance.name}")
        for sensor, label in zip(sensors, sensor_labels(sensors), strict=True)
        for nuisance in sensor.nuisances
    )


def constants_of(sensors: Sequence[Sensor]) -> dict[str, Nuisance]:
    """Return the sensors' nuisances by the names that `estimate` may use: with the sensor's label, and
    without it where that is clear.
    """
    nuisances = labelled_nuisances(sensors)
    short = [nuisance.name.partition(".")[2] for nuisance in nuisances]
    pairs = zip(short, nuisances, strict=True)
    clear = {name: nuisance for name, nuisance in pairs if short.count(name) == 1}
    return {**{nuisance.name: nuisance for nuisance in nuisances}, **clear}


def sensor_labels(sensors: Sequence[Sensor]) -> list[str]:
    """Return a name for every sensor: its kind, numbered from the second of a kind on."""
    labels: list[str] = []
    for index, sensor in enumerate(sensors):
        before = sum(earlier.kind == sensor.kind for earlier in sensors[:index])
        labels.append(f"{sensor.kind}_{before + 1}" if before else sensor.kind)
    return labels

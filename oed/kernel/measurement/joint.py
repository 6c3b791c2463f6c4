"""Estimation from all sensors together: one block of readings, with the start states as nuisances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import inf, isfinite

import casadi as ca
import numpy as np

from oed.foundation.errors import Issue
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.blocks import Block, Nuisance
from oed.kernel.measurement.filter import innovations, memories_of
from oed.kernel.measurement.measurement import Cuts, Measurement, Sensor, process_noise_of
from oed.kernel.measurement.readings import joint_readings, labelled_nuisances

FRAME = 1e-3
"""Standard deviation of start states that define the frame, SI. Its size does not matter: readings that do
not depend on the frame say the same about everything else."""


def blocks_of(measurement: Measurement, drive: Drive) -> tuple[Block, ...]:
    """Return the estimations that a measurement of `drive` allows, each with its own parameters."""
    sensors = measurement.joint_sensors
    return (joint_block(sensors, drive),) if sensors else measurement.blocks(drive)


def cuts_of(measurement: Measurement, samples: int) -> Cuts | None:
    """Return how drives of so many samples per run can be cut; None where they cannot."""
    sensors = measurement.joint_sensors
    return joint_cuts(sensors) if sensors else measurement.cuts(samples)


def joint_block(sensors: Sequence[Sensor], drive: Drive) -> Block:
    """Return the readings of all sensors as one estimation of the system's parameters."""
    system = drive.system
    size = len(system.parameters)
    responses, jacobian = joint_readings(sensors, drive)
    noise = process_noise_of(sensors)
    if noise is not None:
        # Readings share what the process did before them: their innovations do not.
        jacobian = innovations(sensors, drive, noise)
    start, constants = start_nuisances(sensors, system, drive.runs), labelled_nuisances(sensors)
    nuisances, columns = (*start, *constants), jacobian.shape[1]
    # A start that is known is no unknown.
    design = jacobian[:, [*range(size + len(start)), *range(columns - len(constants), columns)]]
    precisions = [0.0] * size + [(nuisance.deviation or np.inf) ** -2 for nuisance in nuisances]
    matrix = design.T @ design + ca.diag(ca.DM(precisions))
    return Block(
        name="joint",
        parameters=tuple(parameter.name for parameter in system.parameters),
        nominal=np.array(system.nominal, dtype=float),
        units=tuple(parameter.unit for parameter in system.parameters),
        response=ca.vertcat(*responses),
        design_matrix=design[:, :size],
        jacobian=design,
        information=lambda chosen: matrix[list(chosen), list(chosen)],
        noise=1.0,
        nuisances=nuisances,
        sizes=np.array([parameter.scale for parameter in system.parameters]),
    )


def joint_cuts(sensors: Sequence[Sensor]) -> Cuts | None:
    """Return how drives can be cut where all sensors read; None where they cannot.

    They cannot where the noise of a sensor is correlated over time, or where a sensor reads across several
    samples that no filter goes through.
    """
    if any(sensor.joint_whitening is not None for sensor in sensors):
        return None
    if process_noise_of(sensors) is None and memories_of(sensors):
        return None
    return Cuts()


def start_nuisances(sensors: Sequence[Sensor], system: System, runs: int = 1) -> tuple[Nuisance, ...]:
    """Return the start states, run by run, that are nuisances; () where they are known or do not matter.

    Args:
        sensors: sensors that say what is known about the start.
        system: system whose states they are.
        runs: number of runs, each with its own start.
    """
    placed = [sensor for sensor in sensors if sensor.start_known is not None]
    if not placed or placed[0].start_known == "known":
        return ()
    deviations = placed[0].start_known if isinstance(placed[0].start_known, Mapping) else {}
    frame = set.intersection(*(set(sensor.gauge) for sensor in placed))
    return tuple(
        Nuisance(
            f"{system.start_name}{f'_{run + 1}' if runs > 1 else ''}.{state}",
            0.0,
            unit,
            FRAME if state in frame and not run else _deviation(deviations, state, unit),
        )
        for run in range(runs)
        for state, unit in zip(system.states, system.state_units, strict=True)
    )


def _deviation(deviations: Mapping[str, float], state: str, unit: str) -> float | None:
    deviation = deviations.get(state, deviations.get(unit, inf))
    return deviation if isfinite(deviation) else None


def process_issues(sensors: Sequence[Sensor], system: System) -> Iterator[Issue]:
    """Yield why no filter can take in the process noise that sensors state, by key."""
    noise = process_noise_of(sensors)
    if noise is None:
        return
    yield from noise.issues(system)
    for place, sensor in enumerate(sensors):
        key: tuple[str | int, ...] = ("measurement",) if len(sensors) == 1 else ("measurement", place)
        if sensor.process_noise not in (None, noise):
            text = "differs from that of the sensors before; a system drifts in one way"
            yield Issue((*key, noise.key), text)
        if sensor.when == "in periods" and not noise.signal:
            text = f"readings of whole periods do not go with {noise.key}, which is left out within them"
            yield Issue((*key, "kind"), f"{text}: read at the samples, or leave out `{noise.key}`")
        if sensor.joint_whitening is not None:
            text = "one covariance of all readings does not go with drift, whose filter takes in one by one: "
            yield Issue((*key, "noise", "covariance"), f"{text}give that of one reading")

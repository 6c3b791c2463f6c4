"""The same programs as one would write them first: unrolled SX, differentiated as they stand by CasADi."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from benchmarks.forms import SEGMENTS
from oed.foundation.arrays import Places
from oed.kernel.dynamics.embedding import Embedding
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.problem import Problem
from oed.robots.sensors import Displacements

OPTIONS = {
    "print_time": False,
    "error_on_fail": False,
    "detect_simple_bounds": True,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
}


@dataclass(frozen=True)
class Plain:
    """A program, and a start for it.

    Attributes:
        solver: Ipopt.
        arguments: what it is called with.
    """

    solver: ca.Function
    arguments: dict[str, np.ndarray]


def single_shooting(problem: Problem, z: np.ndarray, scale: float, iterations: int) -> Plain:
    """The unknowns are the coefficients alone, `z` to begin with; information is divided by `scale`."""
    unknowns = ca.SX.sym("z", len(z))
    drive = _drive(problem, unknowns, ca.SX(ca.DM(problem.fixed_starts)), 1)
    return _plain(problem, drive, [unknowns], [z], ca.SX(0, 1), scale, iterations)


def multiple_shooting(
    problem: Problem, z: np.ndarray, scale: float, iterations: int, instants: Places | None = None
) -> Plain:
    """The poses between the segments are unknowns as well: runs that are made to follow each other.

    Args:
        problem: measured by segments, or by samples.
        z: coefficients to begin at.
        scale: that information is divided by.
        iterations: at most.
        instants: samples that limits on the path hold at; all by default.
    """
    unknowns, nodes = ca.SX.sym("z", len(z)), ca.SX.sym("nodes", 3, SEGMENTS - 1)
    fixed = ca.SX(ca.DM(problem.fixed_starts))
    drive = _drive(problem, unknowns, ca.densify(ca.vertcat(fixed, nodes.T)), SEGMENTS)
    first, last = drive.ends_of(drive.states)
    if instants is not None:
        # Of every run the pose that it begins with is a row more.
        rows = instants + (instants - 1) // (problem.design.samples // SEGMENTS)
        drive = replace(drive, path=drive.path[rows.tolist(), :])
    gaps = ca.vec(last[:-1, :] - first[1:, :])
    whole = _drive(problem, unknowns, fixed, 1)
    poses = np.array(ca.Function("poses", [unknowns], [whole.states])(z))
    between = poses[:: problem.design.samples // SEGMENTS][1:-1]
    # Each run of the drive in parts is one segment.
    measurement = problem.measurement
    if isinstance(measurement, Displacements) and measurement.segments != "samples":
        problem = replace(problem, measurement=measurement.model_copy(update={"segments": 1}))
    return _plain(problem, drive, [unknowns, ca.vec(nodes)], [z, between.ravel()], gaps, scale, iterations)


def _drive(problem: Problem, unknowns: ca.SX, start: ca.SX, runs: int) -> Drive:
    space, inputs = problem.design, len(problem.model.inputs)
    largest = np.abs(problem.input_bounds).max(axis=1)
    embedding = Embedding(space, inputs)
    scaled = unknowns * ca.DM(embedding.spread(largest))
    bounding = embedding.bounding(scaled)
    return roll_out(
        problem.system,
        inputs=embedding.held_inputs(scaled),
        start=start,
        parameters=ca.SX(ca.DM(problem.system.nominal)),
        period=ca.SX(space.period),
        input_values=bounding.values,
        input_rates=bounding.rates,
        runs=runs,
    )


def _plain(
    problem: Problem,
    drive: Drive,
    unknowns: list[ca.SX],
    values: list[np.ndarray],
    gaps: ca.SX,
    scale: float,
    iterations: int,
) -> Plain:
    matrices = [one.matrix / scale for one in problem.estimations(drive)]
    epigraph = problem.objective.epigraph(matrices)
    rows = problem.limit_rows(drive)
    begin = ca.Function("matrices", unknowns, matrices)
    numeric = [np.array(matrix) for matrix in begin.call(values)]
    equal = np.zeros(epigraph.equalities.shape[0] + gaps.shape[0])
    program = {
        "x": ca.vertcat(*unknowns, epigraph.variables),
        "f": -epigraph.objective,
        "g": ca.densify(ca.vertcat(epigraph.equalities, gaps, *(one.expression / one.size for one in rows))),
    }
    options = {**OPTIONS, "ipopt.max_iter": iterations}
    arguments = {
        "x0": np.concatenate([*values, epigraph.initial(numeric)]),
        "lbg": np.concatenate([equal, *(one.lower / one.size for one in rows)]),
        "ubg": np.concatenate([equal, *(one.upper / one.size for one in rows)]),
    }
    return Plain(ca.nlpsol("plain", "ipopt", program, options), arguments)

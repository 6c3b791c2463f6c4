"""robot-40 by Pyomo.DoE: a drive from every random start, printed as it is found."""

from __future__ import annotations

import math
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo
from pyomo.contrib.doe import DesignOfExperiments

from benchmarks.peers import task

OBJECTIVES = {"D": "determinant", "A": "trace", "E": "minimum_eigenvalue"}
"""Pyomo.DoE's names; E exists as a grey box only."""
GAUSS = ((0.5 - math.sqrt(0.15), 5 / 18), (0.5, 8 / 18), (0.5 + math.sqrt(0.15), 5 / 18))
"""Points and weights of the quadrature on [0, 1]."""


class Robot40:
    """The labelled model that Pyomo.DoE asks for, begun at wheel speeds (INTERVALS, 2).

    The heading changes linearly from reading to reading, so the way between is an integral that three
    Gauss points give to 1e-7. Pyomo.DAE's collocation needs seven times the unknowns, and more time.
    """

    def __init__(self, inputs: list[list[float]]) -> None:
        """Keep the start."""
        self.inputs = inputs

    def get_labeled_model(self) -> pyo.ConcreteModel:
        """The robot, with a first guess that satisfies it."""
        m = _robot()
        for index, row in enumerate(self.inputs):
            for wheel in range(2):
                m.speed[index, wheel].value = row[wheel]
        for state, step in ((m.heading, m.turn), (m.x, m.along_x), (m.y, m.along_y)):
            for k in m.readings:
                state[k].value = pyo.value(state[k - 1] + step[k])
        return _labelled(m)


def _robot() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.readings = pyo.RangeSet(task.READINGS)
    m.poses = pyo.RangeSet(0, task.READINGS)
    m.x, m.y, m.heading = pyo.Var(m.poses), pyo.Var(m.poses), pyo.Var(m.poses)
    m.speed = pyo.Var(range(task.INTERVALS), range(2), bounds=(0.0, task.FASTEST))
    for name, nominal in task.COEFFICIENTS.items():
        m.add_component(name, pyo.Var())
        getattr(m, name).fix(nominal)
    period, each = task.DURATION / task.READINGS, task.READINGS // task.INTERVALS

    def way(m: Any, k: int, direction: Any) -> Any:
        right, left = m.speed[(k - 1) // each, 0], m.speed[(k - 1) // each, 1]
        share = sum(w * direction(m.heading[k - 1] + s * m.turn[k]) for s, w in GAUSS)
        return period * (m.c21 * right + m.c22 * left) * share

    @m.Expression(m.readings)
    def turn(m: Any, k: int) -> Any:
        right, left = m.speed[(k - 1) // each, 0], m.speed[(k - 1) // each, 1]
        return period * (m.c11 * right + m.c12 * left)

    m.along_x = pyo.Expression(m.readings, rule=lambda m, k: way(m, k, pyo.cos))
    m.along_y = pyo.Expression(m.readings, rule=lambda m, k: way(m, k, pyo.sin))
    m.turning = pyo.Constraint(m.readings, rule=lambda m, k: m.heading[k] == m.heading[k - 1] + m.turn[k])
    m.moving_x = pyo.Constraint(m.readings, rule=lambda m, k: m.x[k] == m.x[k - 1] + m.along_x[k])
    m.moving_y = pyo.Constraint(m.readings, rule=lambda m, k: m.y[k] == m.y[k - 1] + m.along_y[k])
    for state in (m.x, m.y, m.heading):
        state[0].fix(0.0)
    return m


def _labelled(m: pyo.ConcreteModel) -> pyo.ConcreteModel:
    read = [state[k] for state in (m.x, m.y, m.heading) for k in m.readings]
    unknown = [getattr(m, name) for name in task.COEFFICIENTS]
    for name in ("experiment_outputs", "measurement_error", "experiment_inputs", "unknown_parameters"):
        m.add_component(name, pyo.Suffix(direction=pyo.Suffix.LOCAL))
    m.experiment_outputs.update((one, None) for one in read)
    m.measurement_error.update((one, task.DEVIATION) for one in read)
    m.experiment_inputs.update((one, None) for one in m.speed.values())
    m.unknown_parameters.update((one, pyo.value(one)) for one in unknown)
    return m


def main() -> int:
    """Search from each start by Pyomo.DoE's default settings, but for MA57, which is not free to ship."""
    options = task.parse(__doc__ or "")
    grey = options.criterion == "E"
    if grey and not pyo.SolverFactory("cyipopt").available():
        task.give_up("its E needs cyipopt and PyNumero's compiled AMPL library, which is not packaged")
        return 0
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder, "waste")
        log.touch()
        solver = _ipopt(Path(folder), log)
        for start in range(options.starts):
            inputs, said = _search(options.criterion, solver, start)
            task.answer(inputs, said, waste=sum(map(float, log.read_text().split())))
    return 0


def _search(criterion: str, solver: Any, start: int) -> tuple[list[list[float]], str]:
    begin = task.random_inputs(start)
    design = DesignOfExperiments(
        Robot40(begin),
        objective_option=OBJECTIVES[criterion],
        use_grey_box_objective=criterion == "E",
        scale_nominal_param_value=True,
        solver=solver,
    )
    if criterion == "E":
        design.grey_box_solver.config.options["linear_solver"] = "mumps"
    try:
        design.run_doe()
    except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
        return begin, f"failed: {str(error).splitlines()[0]}"
    found = np.reshape(design.results["Experiment Design"], (task.INTERVALS, 2))
    return found.tolist(), str(design.results["Termination Condition"])


def _ipopt(folder: Path, log: Path) -> Any:
    options: dict[str, Any] = {}
    if shutil.which("ipopt") is None:
        program, script = folder / "ipopt", Path(__file__).with_name("ipopt_by_casadi.py")
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{script}" "$@"\n')
        program.chmod(0o755)
        os.environ["OED_IPOPT_WASTE"] = str(log)
        options["executable"] = str(program)
    solver = pyo.SolverFactory("ipopt", **options)
    solver.options["linear_solver"] = "mumps"
    solver.options["halt_on_ampl_error"] = "yes"
    solver.options["max_iter"] = 3000
    return solver


if __name__ == "__main__":
    sys.exit(main())

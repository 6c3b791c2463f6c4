"""robot-40 by mopeds: a drive for criterion D or A from every random start, printed as it is found."""

from __future__ import annotations

import math
import sys

import casadi as ca
import mopeds
import numpy as np

from benchmarks.peers import scorer, task

SCALED = "scaled"
"""What an option ends with whose objective is 1 at the start.

Det of the covariances is 1e-25 here, which Ipopt takes for zero: unscaled, it stops far from the optimum.
"""


class _Design(mopeds.OptimalExperimentalDesign):
    """The controls switch at every second reading; mopeds by itself lets them switch at each."""

    def _initialize_from_settings(self) -> None:
        super()._initialize_from_settings()
        self.time_grid_control_switch = self.time_grid_control_switch[:: task.READINGS // task.INTERVALS]


def main() -> int:
    """Search from each start by mopeds' own optimiser settings."""
    options = task.parse(__doc__ or "")
    if options.criterion == "E":
        task.give_up("it has no E")
        return 0
    integrator, _, variant = options.option.partition(", ")
    if variant and options.criterion != "D":
        task.give_up("its A needs no scaling")
        return 0
    for start in range(options.starts):
        inputs, said = _search(options.criterion, integrator or "idas", start, scaled=variant == SCALED)
        task.answer(inputs, said)
    return 0


def _search(criterion: str, integrator: str, start: int, *, scaled: bool) -> tuple[list[list[float]], str]:
    model, variables = _robot()
    grid = np.linspace(0.0, task.DURATION, task.READINGS + 1)
    settings = mopeds.FixedGridSampling(num_control_switches=1, num_sampling_times=task.READINGS)
    design = _Design(model, [variables], grid, settings, integrator)
    # The decisions are the right wheel's speeds, then the left's.
    begin = task.random_inputs(start)
    design.guess = np.ravel(begin, order="F")
    if scaled:
        # By mopeds' own factor on what it minimises.
        design.objective_scaling = math.exp(scorer.value("D", begin))
    design.solver_settings = {**design.solver_settings, "print_time": False}
    design.solver_settings["ipopt"] = {**design.solver_settings["ipopt"], "print_level": 0, "sb": "yes"}
    result = design.optimize(objective_function=criterion)
    found = np.array(list(result["x_dict"].values())).reshape((task.INTERVALS, 2), order="F")
    return found.tolist(), str(design.solver.stats()["return_status"])


def _robot() -> tuple[mopeds.Model, mopeds.VariableList]:
    variables = mopeds.VariableList()
    for name in ("x", "y", "heading"):
        state = mopeds.VariableState(name, 0.0)
        state.variance = task.DEVIATION**2
        variables.add_variable(state)
    for name in ("right", "left"):
        wheel = mopeds.VariableControlPiecewiseConstant(name, task.FASTEST / 2, 0.0, task.FASTEST)
        wheel.fixed = False
        variables.add_variable(wheel)
    for name, nominal in task.COEFFICIENTS.items():
        parameter = mopeds.VariableParameter(name, nominal)
        parameter.fixed = False
        variables.add_variable(parameter)
    model = mopeds.Model(variables)
    of = {name: variable.casadi_var for name, variable in model.varlist_all.items()}
    speed = of["c21"] * of["right"] + of["c22"] * of["left"]
    yaw_rate = of["c11"] * of["right"] + of["c12"] * of["left"]
    model.add_equations_differential([speed * ca.cos(of["heading"]), speed * ca.sin(of["heading"]), yaw_rate])
    return model, variables


if __name__ == "__main__":
    sys.exit(main())

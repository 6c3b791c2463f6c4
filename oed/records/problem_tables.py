"""What a record says of a problem: inputs and states of its robot, what is estimated, and what with it."""

from __future__ import annotations

from typing import Any

from oed.kernel.problem import Problem


def parameter_table(problem: Problem) -> list[dict[str, Any]]:
    """The estimated parameters: name, nominal value, SI unit, the block that tells it, its noise, and
    whether the criterion judges it.
    """
    return [
        {
            "name": name,
            "nominal": float(nominal),
            "unit": unit,
            "block": one.block.name,
            "noise": one.block.noise,
            "judged": name in one.judged,
        }
        for one in problem.any_estimations
        for name, nominal, unit in zip(one.parameters, one.nominal, one.units, strict=True)
    ]


def input_table(problem: Problem) -> list[dict[str, Any]]:
    """The robot's inputs: name, quantity, SI unit."""
    return [
        {"name": entry.name, "quantity": entry.quantity, "unit": entry.unit} for entry in problem.model.inputs
    ]


def state_table(problem: Problem) -> list[dict[str, Any]]:
    """The robot's states: name, SI unit."""
    model = problem.model
    return [{"name": name, "unit": unit} for name, unit in zip(model.states, model.state_units, strict=True)]


def nuisance_table(problem: Problem) -> list[dict[str, Any]]:
    """What is estimated along: name, SI unit, the block, and the deviation known beforehand (or None)."""
    return [
        {"name": entry.name, "unit": entry.unit, "block": one.block.name, "deviation": entry.deviation}
        for one in problem.any_estimations
        for entry in one.block.nuisances
    ]

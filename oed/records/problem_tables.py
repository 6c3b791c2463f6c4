"""What a record says of a problem: inputs and states of its robot, what is estimated, and what with it."""

from __future__ import annotations

from oed.kernel.problem import Problem
from oed.records.stored.study_record import StoredInput, StoredNuisance, StoredParameter, StoredState


def parameter_table(problem: Problem) -> list[StoredParameter]:
    """The estimated parameters."""
    return [
        StoredParameter.of(
            one.block, name=name, nominal=nominal, unit=unit, block=one.block.name, judged=name in one.judged
        )
        for one in problem.any_estimations
        for name, nominal, unit in zip(one.parameters, one.nominal, one.units, strict=True)
    ]


def input_table(problem: Problem) -> list[StoredInput]:
    """The robot's inputs."""
    return [StoredInput.of(entry) for entry in problem.model.inputs]


def state_table(problem: Problem) -> list[StoredState]:
    """The robot's states."""
    model = problem.model
    return [
        StoredState.of(name=name, unit=unit)
        for name, unit in zip(model.states, model.state_units, strict=True)
    ]


def nuisance_table(problem: Problem) -> list[StoredNuisance]:
    """The nuisance parameters."""
    return [
        StoredNuisance.of(entry, block=one.block.name)
        for one in problem.any_estimations
        for entry in one.block.nuisances
    ]

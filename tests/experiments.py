"""Experiments with systems given by equations, and the same readings written without the package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import oed

NONE = np.zeros((1, 0))
POND = {"birth": "1 1/s", "loss": "1 1/s", "gain": "1 1/s", "death": "1 1/s"}
BEGIN = (0.5, 0.7)
TERMS = 24
"""Of the series of both kinds in a pond: the last of them are rounding."""


@dataclass(frozen=True)
class Experiment:
    """A problem with a trajectory, and what is read of it.

    Attributes:
        problem: of the package.
        trajectory: what is done.
        read: readings (M,) of the unknowns (q,), parameters before start states, in the package's order; of
            many sets of them (q, n) side by side (M, n).
        deviations: of the readings, (M,).
    """

    problem: oed.Problem
    trajectory: oed.Trajectory
    read: Callable[[np.ndarray], np.ndarray]
    deviations: np.ndarray


def points(count: int, runs: int = 1) -> oed.SignalSpace:
    """So many settings of the inputs in each run, each for itself."""
    spline = oed.Spline(degree=0, coefficients=count)
    return oed.SignalSpace(duration=count, samples=count, spline=spline, rest_to_rest=False, runs=runs)


def response(
    parameters: Mapping[str, str | float],
    output: str,
    read: Callable[..., np.ndarray],
    times: list[float],
    noise: float,
    *,
    runs: int = 1,
    **parts: Any,
) -> Experiment:
    """Readings of `output` at `times` [s], as `read(times, *parameters)` says."""
    system = oed.Equations(parameters=parameters, inputs={"t": "s"}, outputs={"y": output})
    column = np.array(times)[:, None]
    problem = oed.Problem(
        model=system,
        design=points(len(times) // runs, runs),
        measurement=oed.Responses(noise={"y": noise}),
        limits=[oed.InputRange(input="t", range=("0 s", "4000 s"))],
        criterion="D",
        **parts,
    )
    trajectory = problem.design.trajectory(column, np.zeros((runs, 0)))

    def read_of(values: np.ndarray) -> np.ndarray:
        return read(column if np.ndim(values) > 1 else column[:, 0], *values)

    return Experiment(problem, trajectory, read_of, np.full(len(times), noise))


def box_and_lucas(noise: float) -> Experiment:
    """Two reactions one after the other, at the D-optimal times."""
    return response(
        {"k1": "0.7 1/min", "k2": "0.2 1/min"},
        "k1 / (k1 - k2) * (exp(-k2 * t) - exp(-k1 * t))",
        lambda t, k1, k2: k1 / (k1 - k2) * (np.exp(-k2 * t) - np.exp(-k1 * t)),
        [60 * 1.2295, 60 * 6.8577],
        noise,
    )


def compartmental(noise: float, runs: int = 1) -> Experiment:
    """Theophylline in a horse, at the D-optimal times in every run."""
    return response(
        {"out": "0.05884 1/min", "into": "4.298 1/min", "size": "21.80"},
        "size * (exp(-out * t) - exp(-into * t))",
        lambda t, out, into, size: size * (np.exp(-out * t) - np.exp(-into * t)),
        [60 * 0.2288, 60 * 1.3886, 60 * 18.417] * runs,
        noise,
        runs=runs,
    )


RB_TIMES = [1.0, 2.0, 3.0, 4.0, 5.0, 7.0]


def rooney_and_biegler(noise: float, *, prior: bool = True) -> Experiment:
    """A reading at 10 s after those at `RB_TIMES`, which are a prior or are read again."""
    known = np.array(RB_TIMES)
    rows = np.column_stack([1 - np.exp(-0.5 * known), 15 * known * np.exp(-0.5 * known)])
    covariance = np.linalg.inv(rows.T @ rows / noise**2)
    before = oed.Prior(parameters=("asymptote", "rate"), covariance=tuple(map(tuple, covariance.tolist())))
    return response(
        {"asymptote": "15", "rate": "0.5 1/s"},
        "asymptote * (1 - exp(-rate * t))",
        lambda t, asymptote, rate: asymptote * (1 - np.exp(-rate * t)),
        [10.0] if prior else [*RB_TIMES, 10.0],
        noise,
        **({"prior": before} if prior else {}),
    )


def pond(
    noise: float,
    *,
    start: Any = "known",
    inputs: np.ndarray | None = None,
    runs: int = 1,
    substeps: int = 4,
    prior: oed.Prior | None = None,
) -> Experiment:
    """Prey and predators [Lotka and Volterra], read 48 times after the start in each of runs of 12 s.

    `inputs` (runs * 48, 1) is how they are fished; by default there is no such input at all.
    """
    fished = inputs is not None
    prey, predators = (" - 0.4 * fishing", " - 0.2 * fishing") if fished else ("", "")
    system = oed.Equations(
        inputs={"fishing": "1/s"} if fished else {},
        states={"prey": "", "predators": ""},
        parameters=POND,
        derivatives={
            "prey": f"(birth - loss * predators{prey}) * prey",
            "predators": f"(gain * prey - death{predators}) * predators",
        },
        outputs={"prey": "prey", "predators": "predators"},
        substeps=substeps,
    )
    spline = oed.Spline(degree=0, coefficients=48)
    space = oed.SignalSpace(
        duration=12.0, samples=48, runs=runs, spline=spline, rest_to_rest=False
    ).model_copy(update={"start": BEGIN})
    problem = oed.Problem(
        model=system,
        design=space,
        measurement=oed.Outputs(noise={"prey": noise, "predators": 2 * noise}, start=start),
        limits=[oed.InputRange(input="fishing", range=("0 1/s", "1 1/s"))] if fished else [],
        criterion="D",
        prior=prior,
    )
    held = np.zeros((48 * runs, 0)) if inputs is None else inputs
    trajectory = space.trajectory(held, np.tile(BEGIN, (runs, 1)))
    catches = np.zeros((48, runs)) if inputs is None else inputs.reshape(runs, 48).T

    def read(values: np.ndarray) -> np.ndarray:
        # Runs and sets of values are integrated side by side.
        many = np.reshape(values, (len(values), -1))
        begins = np.tile(BEGIN, runs)[:, None] if start == "known" else many[4:]
        states = np.broadcast_to(begins, (2 * runs, many.shape[1])).reshape(runs, 2, -1)
        found = _pond(many[:4], catches, states.swapaxes(0, 1))
        return found.transpose(2, 0, 1, 3).reshape(-1, *np.shape(values)[1:])

    return Experiment(problem, trajectory, read, np.tile([noise, 2 * noise], 49 * runs))


def _pond(parameters: np.ndarray, catches: np.ndarray, begin: np.ndarray) -> np.ndarray:
    # Both kinds at 49 times, (49, 2, runs, n), of parameters (4, n), catches (48, runs), states (2, runs, n).
    birth, loss, gain, death = parameters
    found, terms = [begin], np.empty((TERMS, *begin.shape))
    for catch in catches[..., None]:
        # Terms of the Taylor series over a quarter of a second follow from those before.
        growth, decay = birth - 0.4 * catch, death + 0.2 * catch
        terms[0] = found[-1]
        for order in range(1, TERMS):
            prey, predators = terms[order - 1]
            met = (terms[:order, 0] * terms[order - 1 :: -1, 1]).sum(axis=0)
            terms[order] = growth * prey - loss * met, gain * met - decay * predators
            terms[order] *= 0.25 / order
        found.append(terms.sum(axis=0))
    return np.array(found)

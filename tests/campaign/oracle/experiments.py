"""The score of an experiment with a system given by equations: what its readings say, weighted and alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from .criteria import steps_of, value
from .equations import STEP, Equations
from .limits import Excess
from .readings import Block
from .score import SHAKEN, Estimate, Score, sort_of, steady

Array = npt.NDArray[Any]

NODES = 12
"""Points in each period by which budgets are integrated."""


@dataclass(frozen=True)
class Trial:
    """An experiment that was drawn: trials of equal length, one after the other.

    Attributes:
        held: inputs (trials, N, inputs).
        starts: (trials, states).
        duration: of one trial [s].
        weights: of every reading, (n,), or None.
    """

    held: Array
    starts: Array
    duration: float
    weights: Array | None = None

    @property
    def trials(self) -> int:
        """How many."""
        return self.held.shape[0]

    @property
    def samples(self) -> int:
        """Of one trial."""
        return self.held.shape[1]

    @property
    def period(self) -> float:
        """Of a sample [s]."""
        return self.duration / self.samples


@dataclass(frozen=True)
class Rows:
    """Readings of one sensor, a row for each number that is read.

    Attributes:
        slopes: by parameters, then by every trial's start states, in units of the noise, (rows, k).
        by_state: by the states at that time, alike, (rows, states).
        trial, column: of which trial and sample each is, (rows,).
        reading: which reading of the sensor, (rows,).
        sizes: how much of a budget each reading is, (readings,).
        response: what is read, (rows,), in units of the noise.
    """

    slopes: Array
    by_state: Array
    trial: Array
    column: Array
    reading: Array
    sizes: Array
    response: Array


class Experiment:
    """A trial of a study, SI, followed once."""

    def __init__(self, study: Mapping[str, Any], trial: Trial) -> None:
        self.study, self.trial = study, trial
        self.system = Equations(study["system"])
        self.copies = 1 + len(self.system.parameters) + len(self.system.states)
        nominal = np.tile(self.system.nominal[:, None, None], (1, self.copies, 1)).astype(complex)
        for place in range(len(nominal)):
            nominal[place, 1 + place] += 1j * STEP
        self.p = list(nominal)

    def weighted(self, weights: Array | None) -> Experiment:
        """The same, its readings weighted otherwise."""
        # What they say is asked for once.
        assert self.rows
        found = copy(self)
        found.trial = replace(self.trial, weights=weights)
        return found

    @cached_property
    def states(self) -> Array:
        """(states, copies, trials, N + 1)."""
        trial, system = self.trial, self.system
        x = np.tile(trial.starts.T[:, None, :], (1, self.copies, 1)).astype(complex)
        for place in range(len(system.states)):
            x[place, 1 + len(system.parameters) + place] += 1j * STEP
        found = [x]
        for column in range(trial.samples if system.states else 0):
            x = system.step(x, list(trial.held[:, column].T), self.p, trial.period)
            found.append(x)
        return np.stack(found if system.states else found * (trial.samples + 1), axis=-1)

    @property
    def inputs(self) -> Array:
        """At every sample, (inputs, trials, N + 1): the last held until then."""
        held = self.trial.held
        return np.concatenate([held, held[:, -1:]], axis=1).transpose(2, 0, 1)

    def columns(self, sensor: Mapping[str, Any]) -> Array:
        """Samples or periods that are read."""
        last = self.trial.samples + (sensor["kind"] == "outputs")
        return np.arange(0, last, sensor.get("every", 1))

    def read(self, sensor: Mapping[str, Any]) -> Rows:
        """Everything that a sensor reads."""
        system, trial, columns = self.system, self.trial, self.columns(sensor)
        shape = (len(system.states), self.copies, -1)
        x = self.states[..., columns].reshape(shape) if system.states else self._stateless(columns)
        u = list(self.inputs[..., columns].reshape(len(system.inputs), trial.trials * len(columns)))
        if sensor["kind"] == "rates":
            x = system.step(x, u, self.p, trial.period / 2)
        scale = np.sqrt(trial.period) if sensor["kind"] == "rates" else 1.0
        each, slopes = self._slopes(x, u, sensor, scale)
        count = trial.trials * len(columns)
        places = np.repeat(np.arange(count), len(each))
        size = trial.period if sensor["kind"] == "rates" else 1.0
        return Rows(
            self._by_start(slopes, places // len(columns)),
            self._by_state(x, u, sensor, scale),
            places // len(columns),
            columns[places % len(columns)],
            places,
            np.full(count, size),
            np.real(np.stack([one[0] for one in each])).T.ravel(),
        )

    def _stateless(self, columns: Array) -> Array:
        return np.zeros((0, self.copies, self.trial.trials * len(columns)), dtype=complex)

    def _slopes(self, x: Array, u: Any, sensor: Mapping[str, Any], scale: float) -> tuple[list[Array], Array]:
        found = self.system.outputs(x, u, self.p)
        each = [scale / size * found[name] for name, size in sensor["noise"].items()]
        # (rows, copies), reading by reading.
        table = np.stack(each).transpose(2, 0, 1).reshape(-1, self.copies)
        return each, np.imag(table[:, 1:]) / STEP

    def _by_start(self, slopes: Array, trial: Array) -> Array:
        size, states = len(self.system.parameters), len(self.system.states)
        wide = np.zeros((len(slopes), size + self.trial.trials * states))
        wide[:, :size] = slopes[:, :size]
        for place in range(states):
            wide[np.arange(len(slopes)), size + trial * states + place] = slopes[:, size + place]
        return wide

    def _by_state(self, x: Array, u: Any, sensor: Mapping[str, Any], scale: float) -> Array:
        size = len(x)
        moved = np.real(x[:, :1]) + 1j * STEP * np.eye(size)[:, :, None]
        if not size:
            return np.zeros((x.shape[2] * len(sensor["noise"]), 0))
        found = self.system.outputs(moved, u, [np.real(one[:1]) for one in self.p])
        each = [scale / noise * np.imag(found[name]) / STEP for name, noise in sensor["noise"].items()]
        return np.stack(each).transpose(2, 0, 1).reshape(-1, size)

    @cached_property
    def rows(self) -> list[Rows]:
        """Of all sensors."""
        return [self.read(sensor) for sensor in sensors_of(self.study)]

    def jacobian(self) -> Array:
        """White rows, weighted."""
        table = np.concatenate([one.slopes for one in self.rows])
        rates = sensors_of(self.study)[0].get("diffusion", {})
        if rates:
            return np.linalg.solve(np.linalg.cholesky(self._covariance(rates)), table)
        if self.trial.weights is None:
            return table
        return np.sqrt(self.trial.weights)[self.reading_of_row][:, None] * table

    @property
    def reading_of_row(self) -> Array:
        """The place of each row's reading among all sensors'."""
        firsts = np.cumsum([0, *(len(one.sizes) for one in self.rows)])
        return np.concatenate([one.reading + first for one, first in zip(self.rows, firsts, strict=False)])

    def _covariance(self, rates: Mapping[str, float]) -> Array:
        # Of all readings in units of their noise: half of a period's error at its begin, half at its end.
        states, periods = len(self.system.states), self.trial.samples
        noise = np.zeros(states)
        noise[[self.system.states.index(name) for name in rates]] = np.square(list(rates.values()))
        half = np.diag(noise) * self.trial.period / 4
        steps = self._transitions()
        trial, column = (
            np.concatenate([getattr(one, name) for one in self.rows]) for name in ("trial", "column")
        )
        by_state = np.concatenate([one.by_state for one in self.rows])
        whole = np.eye(len(by_state))
        for number in range(self.trial.trials):
            # Errors of period k move the state after it by (A + 1) / 2 of one draw.
            moved = np.zeros((periods + 1, states, periods * states))
            for k in range(periods):
                moved[k + 1] = steps[number, k] @ moved[k]
                moved[k + 1][:, k * states : (k + 1) * states] += steps[number, k] + np.eye(states)
            own = np.flatnonzero(trial == number)
            table = np.einsum("rs,rsk->rk", by_state[own], moved[column[own]])
            whole[np.ix_(own, own)] += table @ np.kron(np.eye(periods), half) @ table.T
        return whole

    def _transitions(self) -> Array:
        # Derivatives (trials, N, states, states) of the state after each period by that before.
        trial, size = self.trial, len(self.system.states)
        before = np.real(self.states[:, :1, :, :-1]).reshape(size, 1, -1)
        moved = before + 1j * STEP * np.eye(size)[:, :, None]
        u = list(trial.held.transpose(2, 0, 1).reshape(len(self.system.inputs), trial.trials * trial.samples))
        after = self.system.step(moved, u, [np.real(one[:1]) for one in self.p], trial.period)
        return (np.imag(after) / STEP).transpose(2, 0, 1).reshape(trial.trials, trial.samples, size, size)

    def block(self) -> Block:
        """All readings as one estimation."""
        begins = self.study["system"].get("states", {})
        unknown = [one for one in begins.values() if isinstance(one, Mapping) and "unknown" in one]
        size, names = len(self.system.parameters), tuple(self.system.parameters)
        table = self.jacobian()
        known = np.zeros(0)
        if unknown or sensors_of(self.study)[0].get("start") == "unknown":
            own = [_deviation(one, bool(unknown)) for one in begins.values()]
            known = np.tile(own, self.trial.trials)
        # Starts that are known exactly are no unknowns.
        columns = size + np.flatnonzero(known > 0)
        rows = table[:, [*range(size), *columns]]
        return Block(names, self.system.nominal, np.abs(self.system.nominal), rows, 1.0, known[known > 0])

    def estimate(self) -> Estimate:
        """What is estimated of it."""
        return Estimate(self.study, self.block())

    def excesses(self, points: int = 32) -> list[Excess]:
        """How far each limit is exceeded at most; `points` looked at in each period."""
        found = [Excess(*one) for one in self._of_inputs()]
        for limit in self.study.get("limits", ()):
            low, high = limit.get("range", (-np.inf, limit.get("most")))
            values = self.limited(limit, points)
            size = max(abs(one) for one in (low, high) if np.isfinite(one)) or 1.0
            found.append(Excess(limit["name"], float(max((values - high).max(), (low - values).max())), size))
        return found

    def _of_inputs(self) -> Any:
        for place, (name, keys) in enumerate(self.study["experiment"].get("inputs", {}).items()):
            held, (low, high) = self.trial.held[..., place], keys["range"]
            amount = float(max((held - high).max(), (low - held).max()))
            yield name, amount, max(abs(low), abs(high))
            if "rate" in keys:
                rate = keys["rate"]
                low, high = rate if isinstance(rate, list) else (-rate, rate)
                # What is held begins and ends as it is held first and last.
                rates = np.pad(np.diff(held, axis=1) / self.trial.period, ((0, 0), (1, 1)))
                amount = float(max((rates - high).max(), (low - rates).max()))
                yield f"rate_of_{name}", amount, max(abs(low), abs(high))

    def limited(self, limit: Mapping[str, Any], points: int) -> Array:
        system, trial = self.system, self.trial
        p = [np.real(one[:1]) for one in self.p]
        done = self.carried_out
        states, counts = np.real(self.states[:, :1])[:, :, done], self.counts[done]
        trials = int(done.sum())

        def value_of(x: Array, u: Array) -> Array:
            # Of (states, 1, ...) and (inputs, ...).
            count = int(np.prod(u.shape[1:]))
            found = system.value(limit["of"], x.reshape(len(x), 1, count), list(u.reshape(len(u), count)), p)
            return np.real(np.broadcast_to(found, (1, count))).reshape(1, *u.shape[1:])

        held = trial.held.transpose(2, 0, 1)[:, done]
        if limit["kind"] == "budget" and not system.states:
            return np.array([(counts * value_of(states[..., :-1], held)[0]).sum()])
        u = list(held.reshape(len(system.inputs), trials * trial.samples))
        begin = states[..., :-1].reshape(len(states), 1, trials * trial.samples)
        if limit["kind"] == "budget":
            # The integral, by Gauss's rule in every period.
            spent = 0.0
            for node, weight in zip(*np.polynomial.legendre.leggauss(NODES), strict=True):
                x = system.step(begin, u, p, (1 + node) / 2 * trial.period)
                spent += weight / 2 * (counts * value_of(x, held)[0]).sum()
            return np.array([spent * trial.period])
        nothing = 0 * self.inputs[:, done]
        if limit["kind"] == "end":
            return value_of(states[..., -1:], nothing[..., -1:])
        found = [value_of(begin, nothing[..., :-1]).ravel(), value_of(states, nothing).ravel()]
        for share in np.arange(1, points) / points:
            found.append(value_of(system.step(begin, u, p, share * trial.period), nothing[..., :-1]).ravel())
        return np.concatenate(found)

    @property
    def counts(self) -> Array:
        """How often each period is carried out by the weights, (trials, N)."""
        trial = self.trial
        found = np.ones((trial.trials, trial.samples))
        if trial.weights is None or (self.system.states and self.study["weights"].get("of") != "trials"):
            return found
        found[:] = 0.0
        places = [np.unique(one.reading, return_index=True)[1] for one in self.rows]
        trials = np.concatenate([one.trial[first] for one, first in zip(self.rows, places, strict=True)])
        if self.system.states:
            np.maximum.at(found, trials, trial.weights[:, None])
            return found
        columns = np.concatenate([one.column[first] for one, first in zip(self.rows, places, strict=True)])
        np.maximum.at(found, (trials, columns), trial.weights)
        return found

    @property
    def carried_out(self) -> Array:
        """Mask of the trials that are carried out: not candidates whose readings do not count, (trials,)."""
        counted = self.counts.any(axis=1)
        if "candidates" in self.study["experiment"] and counted.any():
            return counted
        return np.ones(len(counted), dtype=bool)

    def spent(self) -> list[tuple[float, float]]:
        """Of each budget of weights what is spent, and its total."""
        chosen = self.study["weights"]
        given = chosen.get("total", chosen.get("readings"))
        sizes = np.concatenate([one.sizes for one in self.rows])
        weights = np.ones(len(sizes)) if self.trial.weights is None else self.trial.weights
        if chosen.get("of") == "trials":
            trial = np.concatenate(
                [one.trial[np.unique(one.reading, return_index=True)[1]] for one in self.rows]
            )
            return [
                (float(sum(weights[trial == number].mean() for number in np.unique(trial))), float(given))
            ]
        if not isinstance(given, Mapping):
            return [(float(weights @ sizes), float(given))]
        parts = np.split(weights * sizes, np.cumsum([len(one.sizes) for one in self.rows])[:-1])
        return [(float(part.sum()), float(total)) for part, total in zip(parts, given.values(), strict=True)]


def sensors_of(study: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """A study's sensors."""
    found = study["measurement"]
    return found if isinstance(found, list) else [found]


def _deviation(begin: Any, said: bool) -> float:
    # Of a start; 0 where it is known.
    if not said:
        return np.inf
    return float(begin.get("deviation", np.inf)) if isinstance(begin, Mapping) and "unknown" in begin else 0.0


def score(experiment: Experiment, shaken: Experiment) -> Score:
    """Score an experiment by its study, SI.

    Args:
        experiment: that was followed.
        shaken: the same with inputs and starts that are changed by next to nothing.
    """
    study = experiment.study
    found, other = experiment.estimate(), shaken.estimate()
    told, criterion = found.judged_information(), study["criterion"]
    sort = sort_of([told])
    if sort == "well" and not steady([told], [other.judged_information()]):
        sort = "unclear"
    if found.standing:
        # What a settled fast state leaves of its rate is rounding, whoever is asked about.
        sort = "unclear"
    objective, deviations = np.nan, {}
    if sort == "well":
        deviations = found.deviations()
        rows = (
            [predicted(study, found, _longest(study, experiment.trial))] if criterion["kind"] in "GI" else ()
        )
        objective = value(criterion["kind"], [told], rows)
    return Score(objective, float(told.eigenvalues[-1]), float(told.eigenvalues[0]), deviations, 0.0, sort)


def shaken(experiment: Experiment) -> Experiment:
    """The same with inputs and starts that are changed by next to nothing."""
    rng, trial = np.random.default_rng(0), experiment.trial
    held, starts = (
        one + SHAKEN * np.abs(one).max(initial=0.0) * rng.uniform(-1, 1, one.shape)
        for one in (trial.held, trial.starts)
    )
    return Experiment(experiment.study, replace(trial, held=held, starts=starts))


def _longest(study: Mapping[str, Any], trial: Trial) -> float:
    # A sample of the longest trial that may be chosen.
    given = study["experiment"].get("duration")
    return float(np.max(given)) / trial.samples if given is not None else trial.period


def _usual(begin: Any) -> float:
    # What a state begins at: of chosen values the middle.
    if isinstance(begin, Mapping):
        return float(begin["unknown"] if "unknown" in begin else np.mean(begin["design"]))
    return float(begin)


def predicted(study: Mapping[str, Any], found: Estimate, longest: float) -> Array:
    """Derivatives (legs, 1, p) of the predicted state by the scaled judged parameters, in steps of at most
    so long [s].
    """
    criterion = study["criterion"]
    legs, start = criterion.get("test_drive"), None
    if legs is None:
        (task,) = criterion["task"]
        legs = [{"inputs": row, "duration": task["period"]} for row in task["inputs"]]
        start = task.get("start")
    system = Equations(study["system"])
    usual = [_usual(one) for one in study["system"]["states"].values()]
    first = np.array([usual if start is None else start])
    own = Experiment(study, Trial(np.zeros((1, 1, len(system.inputs))), first, 1.0))
    x, rows = own.states[..., 0], []
    for leg in legs:
        count = steps_of(leg["duration"], longest)
        for _ in range(count):
            x = system.step(x, [np.array([one]) for one in leg["inputs"]], own.p, leg["duration"] / count)
        rows.append(np.imag(x[system.states.index(criterion["quantity"]), 1:, 0]) / STEP)
    places = [system.parameters.index(name) for name in found.judged]
    return (np.array(rows)[:, places] * found.scales)[:, None, :]

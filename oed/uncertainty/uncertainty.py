"""Uncertainty of a system's parameters and starts: distributions and their ranges."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import Issue
from oed.foundation.quantities import Size, parse_quantity, parse_size
from oed.foundation.text import did_you_mean
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.prior import Prior
from oed.kernel.tightening import ParameterUncertainty, Scenarios, UncertainSystem

STREAM = 11
"""Random stream of simulated robots, independent of all streams with different numbers."""
LIKELY = 3.0
"""Number of standard deviations within which every system has to be possible."""
CORNERS = 4
"""Largest number of quantities whose corners are enumerated; beyond it, only the ends of each range are."""


class Uncertainty(ParameterUncertainty):
    """Distribution of a system's parameters and start about their nominal values.

    A drive has to be feasible for it; unlike a prior it adds no information.

    Attributes:
        within: half-widths ("5 %" of the nominal value, "1 cm") or ranges [low, high] by parameter or state
            of the start. YAML omits this key: `uncertainty: {track: 5 %}`.
        distribution: "uniform" over the range, or "normal" with these as standard deviations.
    """

    within: Annotated[dict[str, Size | tuple[Size, Size]], Field(min_length=1)]
    distribution: Literal["uniform", "normal"] = "uniform"

    @model_validator(mode="before")
    @classmethod
    def _bare_amounts(cls, value: Any) -> Any:
        if not isinstance(value, dict) or "within" in value:
            return value
        amounts = {key: amount for key, amount in value.items() if key != "distribution"}
        return {"within": amounts, **{key: value[key] for key in ("distribution",) if key in value}}

    def issues(self, system: UncertainSystem) -> list[Issue]:
        """Return the unknown names, the invalid ranges, and the impossible systems."""
        issues = self._own_issues(_base(tuple(self.within), system))
        spread = None if issues else spread_of(system)
        text = "" if spread is None else impossible_system_message(spread, system)
        return [*issues, Issue(("uncertainty",), text)] if text else issues

    def _own_issues(self, base: System) -> list[Issue]:
        quantities = _quantities(base)
        issues = []
        for key in self.within:
            path = ("uncertainty", key)
            names = base.long_names(key)
            if names[0] not in quantities:
                last = f"of the start the last {len(_start_units(base))}"
                expected = f"expected one of {', '.join(quantities)} ({last})"
                text = f"{expected}, got {key!r}{did_you_mean(key, quantities)}"
                issues.append(Issue(path, text))
                continue
            if len(names) > 1 and set(names) & set(self.within):
                issues.append(Issue(path, f"says twice what is uncertain of {' and '.join(names)}"))
                continue
            try:
                for name in names:
                    self._range(key, *quantities[name])
            except ValueError as error:
                issues.append(Issue(path, str(error)))
        return issues

    def ranges(self, base: System) -> dict[str, tuple[float, float]]:
        """Return the ends of every quantity's range, SI; a standard deviation away for normal quantities."""
        quantities = _quantities(base)
        return {
            name: self._range(key, *quantities[name]) for key in self.within for name in base.long_names(key)
        }

    def without(self, names: Iterable[str], model: System) -> Uncertainty | None:
        """Return the uncertainty of all parameters but these; None if nothing remains."""
        excluded = set(names)
        within = {
            name: self.within[key]
            for key in self.within
            for name in model.long_names(key)
            if name not in excluded
        }
        return self.model_copy(update={"within": within}) if within else None

    def _range(self, key: str, nominal: float, unit: str) -> tuple[float, float]:
        amount = self.within[key]
        if isinstance(amount, tuple):
            if self.distribution == "normal":
                raise ValueError(f"expected a standard deviation, got the range {list(amount)}")
            low, high = (parse_quantity(end, unit) for end in amount)
            if not low <= nominal <= high or low == high:
                raise ValueError(
                    f"expected a range around the nominal {nominal:g} {unit}, got {list(amount)}"
                )
            return low, high
        size = parse_size(amount, nominal, unit)
        return nominal - size, nominal + size


@dataclass(frozen=True, eq=False)
class UncertainQuantities:
    """Uncertain quantities as numbers, SI: parameters first, then every run's start.

    Attributes:
        names: names of the q quantities.
        units: units of the quantities.
        nominal: nominal values, (q,).
        low, high: ends of the ranges, (q,); a standard deviation away for normal quantities.
        covariance: second moments about the nominal values, (q, q).
        uniform: True for quantities that are uniform over their range, (q,).
        system: system with the uncertain parameters.
        runs: number of runs of a drive.
        parameters: number of quantities that are parameters.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    nominal: Array
    low: Array
    high: Array
    covariance: Array
    uniform: Bools
    system: System
    runs: int
    parameters: int

    def draws(self, count: int, seed: int, stream: int = 0) -> Array:
        """Return random values (count, q); a larger count only appends rows.

        Args:
            count: number of draws.
            seed: seed of the draws.
            stream: stream of the draws; streams of a seed are independent.
        """
        uniform_generator, normal_generator = (
            np.random.default_rng([seed, STREAM, stream, kind]) for kind in (0, 1)
        )
        values = uniform_generator.uniform(self.low, self.high, (count, len(self.names)))
        factor, normal = np.linalg.cholesky(self.covariance), ~self.uniform
        errors = normal_generator.standard_normal((count, len(self.names))) @ factor.T
        values[:, normal] = (self.nominal + errors)[:, normal]
        return np.asarray(values)

    def extremes(self, reach: float) -> Array:
        """Return the corners of the ranges, or for more than `CORNERS` quantities their `ends`, (K, q).

        Normal quantities are taken `reach` standard deviations away, by the covariance's square root.
        """
        size = len(self.names)
        if size > CORNERS:
            return self.ends(reach)
        return self._along(np.array(list(product((-1.0, 1.0), repeat=size))), reach)

    def ends(self, reach: float) -> Array:
        """Return each quantity at either end of its range with all others nominal, (2 q, q)."""
        return self._along(_signed_unit_vectors(len(self.names)), reach)

    def _along(self, signs: Array, reach: float) -> Array:
        uniform = np.select([signs > 0, signs < 0], [self.high, self.low], self.nominal)
        normal = self.nominal + reach * signs @ _square_root(self.covariance).T
        return np.asarray(np.where(self.uniform, uniform, normal))

    def moments(self) -> Array:
        """Return equally likely values (2 q, q) with the quantities' nominal mean and covariance.

        [Julier and Uhlmann, Unscented filtering and nonlinear estimation, 2004]
        """
        size = len(self.names)
        return np.asarray(
            self.nominal + np.sqrt(size) * _signed_unit_vectors(size) @ _square_root(self.covariance).T
        )

    def parameter_values(self, values: Array) -> Array:
        """Return the system's parameters (K, p) for values (K, q)."""
        names = [parameter.name for parameter in self.system.parameters]
        table = np.tile(np.array(self.system.nominal), (len(values), 1))
        table[:, [names.index(name) for name in self.names[: self.parameters]]] = values[:, : self.parameters]
        return table

    def scenarios(self, values: Array) -> Scenarios:
        """Return the scenarios of values (K, q)."""
        return Scenarios(self.system, self.parameter_values(values), self.shifts(values))

    def shifts(self, values: Array) -> Array:
        """Return the shifts of the start states, (K, runs, states), for values (K, q)."""
        states = len(self.system.states)
        offsets = (values - self.nominal)[:, self.parameters :]
        table = np.zeros((len(values), self.runs, states))
        columns = self._start_columns
        table[:, :, columns] = offsets.reshape(len(values), self.runs, len(columns))
        return table

    @property
    def _start_columns(self) -> list[int]:
        count = (len(self.names) - self.parameters) // self.runs
        first = self.names[self.parameters : self.parameters + count]
        return [self.system.states.index(name.split(",")[0]) for name in first]

    @property
    def parameter_slopes(self) -> Array:
        """Derivatives of the system's parameters by the quantities, (p, q)."""
        names = [parameter.name for parameter in self.system.parameters]
        chosen = np.zeros((len(names), len(self.names)))
        for column, name in enumerate(self.names[: self.parameters]):
            chosen[names.index(name), column] = 1.0
        return chosen

    def start_slopes(self, run: int) -> Array:
        """Return the derivatives (states, q) of a run's start state by the quantities."""
        slopes = np.zeros((len(self.system.states), len(self.names)))
        columns = self._start_columns
        for place, state in enumerate(columns):
            slopes[state, self.parameters + run * len(columns) + place] = 1.0
        return slopes


@lru_cache(maxsize=32)
def spread_of(system: UncertainSystem) -> UncertainQuantities | None:
    """Return the quantities of an uncertainty, and those of a prior alone; None without any."""
    prior, runs = system.prior, system.runs
    uncertainty = system.uncertainty if isinstance(system.uncertainty, Uncertainty) else None
    within = tuple(uncertainty.within) if uncertainty is not None else ()
    base = _base((*within, *(prior.names if prior is not None else ())), system)
    quantities = _quantities(base)
    ranges = uncertainty.ranges(base) if uncertainty is not None else {}
    named = tuple(ranges)
    prior_names, covariance = _of_prior(prior, base, named)
    for name, square in zip(prior_names, np.diag(covariance), strict=True):
        middle, _ = quantities[name]
        ranges[name] = middle - square**0.5, middle + square**0.5
    parameter_names = [parameter.name for parameter in base.parameters if parameter.name in ranges]
    starts = [name for name in _start_units(base) if name in ranges]
    all_names = [*parameter_names, *starts * runs]
    if not all_names:
        return None
    ends = np.array([ranges[name] for name in all_names])
    nominal, units = zip(*(quantities[name] for name in all_names), strict=True)
    is_uniform = uncertainty is not None and uncertainty.distribution == "uniform"
    uniform = np.array([is_uniform and name in named for name in all_names])
    square = np.ptp(ends, axis=1) ** 2 / 12 + (ends.mean(axis=1) - nominal) ** 2
    moments = np.diag(np.where(uniform, square, (ends[:, 1] - nominal) ** 2))
    places = [all_names.index(name) for name in prior_names]
    moments[np.ix_(places, places)] = covariance
    return UncertainQuantities(
        names=(*parameter_names, *(_start_name(name, run) for run in range(runs) for name in starts)),
        units=units,
        nominal=np.array(nominal),
        low=ends[:, 0],
        high=ends[:, 1],
        covariance=moments,
        uniform=uniform,
        system=base,
        runs=runs,
        parameters=len(parameter_names),
    )


def require_spread(system: UncertainSystem) -> UncertainQuantities:
    """Return the uncertain quantities.

    Raises:
        ValueError: the problem has neither an uncertainty nor a prior.
    """
    spread = spread_of(system)
    if spread is None:
        raise ValueError("the problem has neither an uncertainty nor a prior")
    return spread


def impossible_system_message(spread: UncertainQuantities, system: UncertainSystem) -> str:
    """Return a message about an impossible system within the ranges or three standard deviations.

    It is "" if all systems are possible, as with coefficients, which may have any values.
    """
    if spread.system != system.model:
        return ""
    names = spread.names[: spread.parameters]
    for row in np.vstack([spread.ends(LIKELY), spread.extremes(LIKELY), spread.moments()]):
        values = {name: float(value) for name, value in zip(names, row, strict=False)}
        if not spread.system.allows(values):
            text = ", ".join(f"{name} {value:.3g}" for name, value in values.items())
            return f"a {spread.system.noun} of {text} cannot be: narrow the ranges"
    return ""


def _start_name(name: str, run: int) -> str:
    return name if run == 0 else f"{name}, run {run + 1}"


def _of_prior(prior: Prior | None, base: System, besides: Sequence[str]) -> tuple[list[str], Array]:
    # Names and covariance of the base's parameters that have a prior only.
    names = [parameter.name for parameter in base.parameters if prior and parameter.name in prior.names]
    if prior is None or not names:
        return [], np.zeros((0, 0))
    values, units = zip(*(_quantities(base)[name] for name in names), strict=True)
    covariance = np.linalg.inv(prior.precision(names, np.array(values), units))
    indices = [index for index, name in enumerate(names) if name not in besides]
    return [names[index] for index in indices], np.asarray(covariance[np.ix_(indices, indices)])


def _base(names: Sequence[str], system: UncertainSystem) -> System:
    # The system with its own parameters, unless the names exist among those to estimate only.
    starts = set(_start_units(system.model))
    own_names = {parameter.name for parameter in system.model.parameters} | starts
    estimated = {parameter.name for parameter in system.estimated.parameters} | starts
    return system.estimated if not set(names) <= own_names and set(names) <= estimated else system.model


def _start_units(base: System) -> dict[str, str]:
    # Units of the states that a start chooses; they are uncertain only if named.
    return dict(zip(base.states[: base.chosen_states], base.state_units, strict=False))


def _quantities(base: System) -> dict[str, tuple[float, str]]:
    # Nominal values and units of all quantities that can be uncertain.
    parameters = {parameter.name: (parameter.nominal, parameter.unit) for parameter in base.parameters}
    return parameters | {state: (0.0, unit) for state, unit in _start_units(base).items()}


def _signed_unit_vectors(size: int) -> Array:
    return np.vstack([np.eye(size), -np.eye(size)])


def _square_root(covariance: Array) -> Array:
    # Symmetric square root, whose columns keep independent quantities apart; scaled for invariance to units.
    sizes = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sizes, sizes))
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return np.asarray(sizes[:, None] * root)

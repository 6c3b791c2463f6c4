"""What is not known of a system before the drive: parameters and starts, within which ranges."""

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
"""Of simulated robots: their draws are independent of all others of a seed."""
LIKELY = 3.0
"""Standard deviations within which every system has to be possible."""
CORNERS = 4
"""Uncertain quantities up to which all corners of their ranges are driven; beyond, their ends one by one."""


class Uncertainty(ParameterUncertainty):
    """How far a system may be from its nominal parameters, and from its start.

    It says what a drive has to survive; unlike a prior it adds no information.

    Attributes:
        within: by parameter (or state of the start): half-widths ("5 %" of the nominal value,
            "1 cm") or ranges [low, high]. In YAML these stand alone: `uncertainty: {track: 5 %}`.
        distribution: "uniform" over the range, or "normal" with these as standard deviations.
    """

    within: Annotated[dict[str, Size | tuple[Size, Size]], Field(min_length=1)]
    distribution: Literal["uniform", "normal"] = "uniform"

    @model_validator(mode="before")
    @classmethod
    def _bare_amounts(cls, value: Any) -> Any:
        if not isinstance(value, dict) or "within" in value:
            return value
        own = {key: amount for key, amount in value.items() if key != "distribution"}
        return {"within": own, **{key: value[key] for key in ("distribution",) if key in value}}

    def issues(self, system: UncertainSystem) -> list[Issue]:
        """Names that the system does not have; amounts that are no ranges around the nominal value, or of
        systems that cannot be.
        """
        issues = self._own_issues(_base(tuple(self.within), system))
        spread = None if issues else spread_of(system)
        text = "" if spread is None else impossible(spread, system)
        return [*issues, Issue(("uncertainty",), text)] if text else issues

    def _own_issues(self, base: System) -> list[Issue]:
        known = _known(base)
        issues = []
        for given in self.within:
            key = ("uncertainty", given)
            names = base.long_names(given)
            if names[0] not in known:
                last = f"of the start the last {len(_starts(base))}"
                text = (
                    f"expected one of {', '.join(known)} ({last}), got {given!r}{did_you_mean(given, known)}"
                )
                issues.append(Issue(key, text))
                continue
            if len(names) > 1 and set(names) & set(self.within):
                issues.append(Issue(key, f"says twice what is uncertain of {' and '.join(names)}"))
                continue
            try:
                for name in names:
                    self._range(given, *known[name])
            except ValueError as error:
                issues.append(Issue(key, str(error)))
        return issues

    def ranges(self, base: System) -> dict[str, tuple[float, float]]:
        """Low and high end of every quantity's range, SI; of a normal one a standard deviation away."""
        known = _known(base)
        return {
            name: self._range(given, *known[name]) for given in self.within for name in base.long_names(given)
        }

    def without(self, names: Iterable[str], model: System) -> Uncertainty | None:
        """What it says of other parameters than these; None where that is nothing."""
        known = set(names)
        within = {
            name: self.within[given]
            for given in self.within
            for name in model.long_names(given)
            if name not in known
        }
        return self.model_copy(update={"within": within}) if within else None

    def _range(self, key: str, nominal: float, unit: str) -> tuple[float, float]:
        given = self.within[key]
        if isinstance(given, tuple):
            if self.distribution == "normal":
                raise ValueError(f"expected a standard deviation, got the range {list(given)}")
            low, high = (parse_quantity(end, unit) for end in given)
            if not low <= nominal <= high or low == high:
                raise ValueError(f"expected a range around the nominal {nominal:g} {unit}, got {list(given)}")
            return low, high
        size = parse_size(given, nominal, unit)
        return nominal - size, nominal + size


@dataclass(frozen=True, eq=False)
class Spread:
    """Uncertain quantities as numbers: parameters first, then every run's start; all SI.

    Attributes:
        names: of the q quantities.
        units: theirs.
        nominal: (q,).
        low, high: ends of their ranges, (q,); of normal ones a standard deviation away.
        covariance: second moments about the nominal values, (q, q).
        uniform: whether each lies within its range for certain, (q,).
        system: that has the uncertain parameters.
        runs: of a drive.
        parameters: how many of the quantities are parameters.
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
        """Random values (count, q); the first of more, and independent of those of another stream.

        Args:
            count: how many.
            seed: of the draws.
            stream: independent of other streams of the seed.
        """
        flat, bell = (np.random.default_rng([seed, STREAM, stream, kind]) for kind in (0, 1))
        values = flat.uniform(self.low, self.high, (count, len(self.names)))
        factor, normal = np.linalg.cholesky(self.covariance), ~self.uniform
        errors = bell.standard_normal((count, len(self.names))) @ factor.T
        values[:, normal] = (self.nominal + errors)[:, normal]
        return np.asarray(values)

    def extremes(self, reach: float) -> Array:
        """The corners of the ranges (of many quantities their ends one by one), (K, q).

        Normal quantities are taken `reach` standard deviations away, by the covariance's square root.
        """
        size = len(self.names)
        if size > CORNERS:
            return self.ends(reach)
        return self._along(np.array(list(product((-1.0, 1.0), repeat=size))), reach)

    def ends(self, reach: float) -> Array:
        """Each quantity at either end of its range with the others nominal, (2 q, q)."""
        return self._along(_both_ways(len(self.names)), reach)

    def _along(self, signs: Array, reach: float) -> Array:
        uniform = np.select([signs > 0, signs < 0], [self.high, self.low], self.nominal)
        normal = self.nominal + reach * signs @ _axes(self.covariance).T
        return np.asarray(np.where(self.uniform, uniform, normal))

    def moments(self) -> Array:
        """Equally likely values (2 q, q) with the quantities' nominal mean and covariance.

        [Julier and Uhlmann, Unscented filtering and nonlinear estimation, 2004]
        """
        size = len(self.names)
        return np.asarray(self.nominal + np.sqrt(size) * _both_ways(size) @ _axes(self.covariance).T)

    def parameter_values(self, values: Array) -> Array:
        """Parameters of the system (K, p) for values (K, q)."""
        known = [parameter.name for parameter in self.system.parameters]
        table = np.tile(np.array(self.system.nominal), (len(values), 1))
        table[:, [known.index(name) for name in self.names[: self.parameters]]] = values[:, : self.parameters]
        return table

    def scenarios(self, values: Array) -> Scenarios:
        """The system with values (K, q)."""
        return Scenarios(self.system, self.parameter_values(values), self.shifts(values))

    def shifts(self, values: Array) -> Array:
        """What start states are off by (K, runs, states) for values (K, q)."""
        states = len(self.system.states)
        offsets = (values - self.nominal)[:, self.parameters :]
        table = np.zeros((len(values), self.runs, states))
        wanted = self._start_columns
        table[:, :, wanted] = offsets.reshape(len(values), self.runs, len(wanted))
        return table

    @property
    def _start_columns(self) -> list[int]:
        count = (len(self.names) - self.parameters) // self.runs
        first = self.names[self.parameters : self.parameters + count]
        return [self.system.states.index(name.split(",")[0]) for name in first]

    @property
    def parameter_slopes(self) -> Array:
        """Derivatives (p, q) of the system's parameters by the quantities."""
        known = [parameter.name for parameter in self.system.parameters]
        chosen = np.zeros((len(known), len(self.names)))
        for column, name in enumerate(self.names[: self.parameters]):
            chosen[known.index(name), column] = 1.0
        return chosen

    def start_slopes(self, run: int) -> Array:
        """Derivatives (states, q) of a run's start state by the quantities."""
        slopes = np.zeros((len(self.system.states), len(self.names)))
        columns = self._start_columns
        for place, state in enumerate(columns):
            slopes[state, self.parameters + run * len(columns) + place] = 1.0
        return slopes


@lru_cache(maxsize=32)
def spread_of(system: UncertainSystem) -> Spread | None:
    """The quantities that an uncertainty names, and those that only a prior says something about.

    None where nothing is said of it.
    """
    said, prior, runs = system.uncertainty, system.prior, system.runs
    uncertainty = said if isinstance(said, Uncertainty) else None
    given = tuple(uncertainty.within) if uncertainty is not None else ()
    base = _base((*given, *(prior.names if prior is not None else ())), system)
    quantities = _known(base)
    ranges = uncertainty.ranges(base) if uncertainty is not None else {}
    named = tuple(ranges)
    low, high = ({name: ends[side] for name, ends in ranges.items()} for side in (0, 1))
    known, covariance = _of_prior(prior, base, named)
    for name, square in zip(known, np.diag(covariance), strict=True):
        middle, _ = quantities[name]
        low[name], high[name] = middle - square**0.5, middle + square**0.5
    own = [parameter.name for parameter in base.parameters if parameter.name in low]
    begun = [name for name in _starts(base) if name in low]
    every = [*own, *begun * runs]
    if not every:
        return None
    ends = np.array([[low[name], high[name]] for name in every])
    nominal, units = zip(*(quantities[name] for name in every), strict=True)
    flat = uncertainty is not None and uncertainty.distribution == "uniform"
    uniform = np.array([flat and name in named for name in every])
    square = np.ptp(ends, axis=1) ** 2 / 12 + (ends.mean(axis=1) - nominal) ** 2
    moments = np.diag(np.where(uniform, square, (ends[:, 1] - nominal) ** 2))
    places = [every.index(name) for name in known]
    moments[np.ix_(places, places)] = covariance
    return Spread(
        names=(*own, *(_start_name(name, run) for run in range(runs) for name in begun)),
        units=units,
        nominal=np.array(nominal),
        low=ends[:, 0],
        high=ends[:, 1],
        covariance=moments,
        uniform=uniform,
        system=base,
        runs=runs,
        parameters=len(own),
    )


def given_spread(system: UncertainSystem) -> Spread:
    """The quantities of which something is said.

    Raises:
        ValueError: nothing is said of any.
    """
    spread = spread_of(system)
    if spread is None:
        raise ValueError("the problem has neither an uncertainty nor a prior")
    return spread


def impossible(spread: Spread, system: UncertainSystem) -> str:
    """Which system within three standard deviations, or the ranges, cannot be; "" where all can, as those of
    any coefficients.
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
    # Names and covariance of what a prior says of the base's other parameters.
    names = [parameter.name for parameter in base.parameters if prior and parameter.name in prior.names]
    if prior is None or not names:
        return [], np.zeros((0, 0))
    values, units = zip(*(_known(base)[name] for name in names), strict=True)
    whole = np.linalg.inv(prior.precision(names, np.array(values), units))
    kept = [index for index, name in enumerate(names) if name not in besides]
    return [names[index] for index in kept], np.asarray(whole[np.ix_(kept, kept)])


def _base(names: Sequence[str], system: UncertainSystem) -> System:
    # The system's own parameters, unless only those to estimate have these names.
    starts = set(_starts(system.model))
    own = {parameter.name for parameter in system.model.parameters} | starts
    estimated = {parameter.name for parameter in system.estimated.parameters} | starts
    return system.estimated if not set(names) <= own and set(names) <= estimated else system.model


def _starts(base: System) -> dict[str, str]:
    # Where it begins: units of the states that a start chooses, uncertain as well where they are named.
    return dict(zip(base.states[: base.chosen_states], base.state_units, strict=False))


def _known(base: System) -> dict[str, tuple[float, str]]:
    # Nominal values and units of what may be uncertain.
    parameters = {one.name: (one.nominal, one.unit) for one in base.parameters}
    return parameters | {state: (0.0, unit) for state, unit in _starts(base).items()}


def _both_ways(size: int) -> Array:
    return np.vstack([np.eye(size), -np.eye(size)])


def _axes(covariance: Array) -> Array:
    # Its symmetric square root, columns: what is independent stays so. Scaled, so that units do not matter.
    sizes = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sizes, sizes))
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return np.asarray(sizes[:, None] * root)

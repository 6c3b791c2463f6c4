"""Prior knowledge of the parameters before the drive: it adds to the information."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.quantities import Size, parse_size, require_covariance
from oed.foundation.text import did_you_mean


class Prior(Component):
    """Knowledge from before, e.g. from an earlier drive; parameters it does not name are unknown.

    Attributes:
        standard_deviations: sizes by parameter, with a unit ("1 mm") or a share of the nominal value ("2 %").
        parameters, covariance: or names, and their covariance matrix in SI units.
        logs: names of the logs that it was estimated from, by a fingerprint of their content: given again,
            they would count twice.
    """

    standard_deviations: dict[str, Size] = Field(default_factory=dict)
    parameters: tuple[str, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()
    logs: dict[str, str] = Field(default_factory=dict)

    @model_serializer(mode="wrap")
    def _as_before_without_logs(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data = plain(self)
        return data if self.logs else {key: value for key, value in data.items() if key != "logs"}

    @model_validator(mode="after")
    def _one_way_to_give_it(self) -> Prior:
        if bool(self.standard_deviations) == bool(self.covariance):
            raise ValueError("expected either standard_deviations, or parameters and their covariance")
        size = len(self.parameters)
        if not self.covariance:
            if size:
                raise ValueError("parameters name the rows of a covariance; there is none")
            return self
        if len(set(self.parameters)) < size:
            raise ValueError("a parameter is listed twice")
        if len(self.covariance) != size or any(len(row) != size for row in self.covariance):
            raise ValueError(f"expected a {size} x {size} covariance for {size} parameters")
        require_covariance(self.covariance)
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters it says something about."""
        return self.parameters or tuple(self.standard_deviations)

    def issues(self, known: Sequence[str], nominal: Array, units: Sequence[str]) -> list[Issue]:
        """Names that are not estimated, and deviations that are not positive quantities of the right unit.

        Args:
            known: names of parameters that are estimated.
            nominal: nominal values of the parameters, SI.
            units: SI units of the parameters.
        """
        issues, by_deviations = [], bool(self.standard_deviations)
        for name in self.names:
            key = ("prior", "standard_deviations", name) if by_deviations else ("prior", "parameters")
            if name not in known:
                hint = did_you_mean(name, known)
                text = f"{name} is not estimated here; the parameters are {', '.join(known)}{hint}"
                issues.append(Issue(key, text))
            elif by_deviations:
                index = list(known).index(name)
                try:
                    self._deviation(name, nominal[index], units[index])
                except ValueError as error:
                    issues.append(Issue(key, str(error)))
        return issues

    def precision(self, names: Sequence[str], nominal: Array, units: Sequence[str]) -> Array:
        """Information (p, p) on the parameters `names`, SI; zero for those it does not name.

        Args:
            names: names of p parameters.
            nominal: nominal values of the parameters, (p,), SI.
            units: SI units of the parameters.
        """
        matrix = np.zeros((len(names), len(names)))
        if self.standard_deviations:
            for index, name in enumerate(names):
                if name in self.standard_deviations:
                    matrix[index, index] = self._deviation(name, nominal[index], units[index]) ** -2
            return matrix
        # Of parameters that are estimated apart, each block has its own part of the covariance.
        members = [index for index, name in enumerate(self.parameters) if name in names]
        places = [list(names).index(self.parameters[index]) for index in members]
        matrix[np.ix_(places, places)] = np.linalg.inv(np.array(self.covariance)[np.ix_(members, members)])
        return matrix

    def _deviation(self, name: str, nominal: float, unit: str) -> float:
        return parse_size(self.standard_deviations[name], nominal, unit, "standard deviation")

"""Options of the search by Ipopt, and the budget of iterations that the searches of a study share."""

from __future__ import annotations

from abc import ABC
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, PositiveInt, ValidationInfo, field_validator

from oed.foundation.quantities import Duration
from oed.optimize.solver import Solver

BUDGET = 1200
"""Default budget of iterations that the searches of a study share."""


class IpoptOptions(Solver, ABC):
    """Options of the search; see `Ipopt`."""

    refines: ClassVar[bool] = True

    kind: Literal["ipopt"] = "ipopt"
    starts: Annotated[int, Field(ge=1, le=1_000_000)] | Literal["auto"] = "auto"
    perturbations: Annotated[int, Field(ge=0)] = 8
    iterations: Annotated[int, Field(ge=1, le=1_000_000_000)] | None = None
    second_stage: Literal["logdet", "shortest_path", "none"] = "none"
    second_stage_share: Annotated[float, Field(gt=0, lt=1)] = 0.999
    start_from: str | None = None
    search_samples: PositiveInt | None = None
    max_iterations: PositiveInt = 500
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-8
    time_limit: Annotated[Duration, Field(gt=0)] | None = None

    @field_validator("perturbations", "iterations")
    @classmethod
    def _fits_starts(cls, value: int | None, info: ValidationInfo) -> int | None:
        auto = info.data.get("starts") == "auto"
        if auto and info.field_name == "perturbations":
            raise ValueError(
                "goes with a number of `starts`: `starts: auto`, the default, perturbs designs within its "
                "budget, `iterations`"
            )
        if info.field_name == "iterations" and value is not None and "starts" in info.data and not auto:
            raise ValueError("is the budget of `starts: auto`: leave one of the two out")
        return value

    def as_data(self) -> dict[str, Any]:
        """Return the options as plain data, without options that `starts` makes meaningless."""
        unused = "perturbations" if self.starts == "auto" else ""
        return {key: value for key, value in super().as_data().items() if key != unused}

    @property
    def budget(self) -> int:
        """Budget of iterations of `starts: auto`."""
        return BUDGET if self.iterations is None else self.iterations

    @property
    def for_ipopt(self) -> dict[str, Any]:
        """Options of Ipopt, by its names."""
        options: dict[str, Any] = {"ipopt.max_iter": self.max_iterations, "ipopt.tol": self.tolerance}
        if self.time_limit is not None:
            options["ipopt.max_wall_time"] = self.time_limit
        return options

    def again(self, *, quick: bool = True) -> Self:
        """Return options that start from the earlier design, alone or instead of the first start."""
        fewer = {"starts": 1, "perturbations": 0, "iterations": None} if quick else {}
        return self.model_copy(update={**fewer, "start_from": self.label})


def with_shared_budget(solvers: Sequence[Solver]) -> tuple[Solver, ...]:
    """Return the solvers of a study with equal shares of `BUDGET` for `starts: auto` without `iterations`.

    Iterations that a search does not spend are not passed on, so that no search depends on earlier ones.

    Args:
        solvers: solvers of the study.
    """
    sharing = [
        isinstance(solver, IpoptOptions) and solver.starts == "auto" and solver.iterations is None
        for solver in solvers
    ]
    share = max(BUDGET // max(sum(sharing), 1), 1)
    return tuple(
        solver.model_copy(update={"iterations": share}) if shares else solver
        for solver, shares in zip(solvers, sharing, strict=True)
    )

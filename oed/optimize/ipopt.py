"""Search by Ipopt: from many starts, perturbed and solved again, with a second stage among equal optima."""

from __future__ import annotations

import time
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, PositiveInt, ValidationInfo, field_validator

from oed.foundation.quantities import Duration
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution
from oed.optimize.exploration import BUDGET
from oed.optimize.multi_start import MultiStart
from oed.optimize.solver import Context, Solver


class Ipopt(Solver):
    """Multi-start interior-point search with exact Hessians.

    Attributes:
        starts: "auto" for as many local searches, from varied starts and perturbed designs, as `iterations`
            allow; or their number, half from screened random drives, half from small random coefficients.
        perturbations: with a number of starts, further searches from perturbed copies of the best design.
        iterations: budget of "auto": Ipopt's iterations on 200 samples; one on n samples (of all runs and
            robots) counts n/200. It ends sooner where the best is found again and again. By default 1200,
            of which the searches of one study that leave it out have equal shares.
        second_stage: what decides among designs of practically equal objective: "logdet" (most
            information in all directions), "shortest_path", or "none", which gives nothing of the objective
            away.
        second_stage_share: share of the best objective that the second stage has to keep.
        start_from: name of an earlier search of the study whose design takes the place of the first start.
        search_samples: samples per run that searches look at, corrected to agree with all of them; by
            default all up to 400, else at most 400 or 12 per spline coefficient.
        max_iterations, tolerance: of Ipopt, per local search.
        time_limit: of the whole search [s]; None for none. A search that it ends depends on the machine.
    """

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
    def _of_its_starts(cls, given: int | None, info: ValidationInfo) -> int | None:
        auto = info.data.get("starts") == "auto"
        if auto and info.field_name == "perturbations":
            raise ValueError(
                "goes with a number of `starts`: `starts: auto`, the default, perturbs designs within its "
                "budget, `iterations`"
            )
        if info.field_name == "iterations" and given is not None and "starts" in info.data and not auto:
            raise ValueError("is the budget of `starts: auto`: leave one of the two out")
        return given

    def as_data(self) -> dict[str, Any]:
        """The options as plain data, without those that mean nothing here."""
        unused = "perturbations" if self.starts == "auto" else ""
        return {key: one for key, one in super().as_data().items() if key != unused}

    @property
    def budget(self) -> int:
        """Iterations that "auto" may spend."""
        return BUDGET if self.iterations is None else self.iterations

    def again(self, *, quick: bool = True) -> Ipopt:
        """From the earlier design, alone or in the place of the first start."""
        fewer = {"starts": 1, "perturbations": 0, "iterations": None} if quick else {}
        return self.model_copy(update={**fewer, "start_from": self.label})

    def search(self, problem: Problem, context: Context) -> Solution:
        """The best design of all starts; interrupted, the best so far."""
        return MultiStart(self, problem, context).run()

    def refine(self, problem: Problem, context: Context, spent: float) -> Solution:
        """The best design of a solve that stays near the earlier one, and one that does not."""
        return MultiStart(self, problem, context, time.perf_counter() - spent, further=True).run()

"""A criterion of the user's own, named in a study by where its class stands."""

from __future__ import annotations

from typing import Literal

from oed.foundation.component import Component
from oed.foundation.own.part import OwnPart
from oed.kernel.criteria.criterion import Criterion


class CriterionDescription(Component):
    """Description of a criterion of the user's own."""

    kind: str | None = None
    number: str | None = None
    definition: str | None = None
    share: str | None = None
    asks_about: str | None = None
    conceded: str | None = None
    proportional: bool | None = None


class PythonCriterion(OwnPart, Criterion, extra="allow"):
    """The criterion that `object` ("my_module:MyCriterion") makes of all further keys."""

    noun = "criterion"
    kind: Literal["python"] = "python"
    described: CriterionDescription | None = None

    def efficiency(self, value: float, best: float, size: int) -> float | None:
        """Return the repetitions of the best design that are worth one of this; None unless repetitions add
        up.
        """
        return super().efficiency(value, best, size) if self.proportional else None

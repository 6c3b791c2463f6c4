"""Parts of a study file that belong to it alone: paths and records of other files, and what is simulated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from oed.estimation.methods import EstimatorName, Heading
from oed.estimation.setup.options import Loss
from oed.foundation.component import Component, OneOf
from oed.foundation.text import NAME
from oed.kernel.measurement.prior import Prior
from oed.robots.baselines import Baseline, BaselineName, PythonBaseline
from oed.simulation.monte_carlo import ALPHA


class PathFile(Component):
    """A path of the user's own to compare with: a trajectory CSV, found from the study's folder."""

    file: str
    name: Annotated[str, Field(pattern=NAME)] | None = None

    @property
    def label(self) -> str:
        """The result's name."""
        return self.name or Path(self.file).stem


def _baseline_form(value: Any) -> str:
    # By what is given, so that mistakes are those of the form that was meant.
    given = value if isinstance(value, dict) else {}
    if isinstance(value, Baseline) or given.get("kind") == "python" or "object" in given:
        return "of one's own"
    return "a path" if isinstance(value, PathFile | dict) and "kind" not in given else "by name"


AnyBaseline = Annotated[
    Annotated[BaselineName, Tag("by name")]
    | Annotated[PathFile, Tag("a path")]
    | Annotated[Baseline, OneOf((PythonBaseline,)), Tag("of one's own")],
    Discriminator(_baseline_form),
]


class PriorRecord(Component):
    """A prior from an earlier study: the covariance that its record predicts for a drive.

    Attributes:
        record: the earlier study's folder (or record file), found from this study's folder.
        result: name of the drive that was driven; the record's best by default.
    """

    record: str
    result: str | None = None


class PriorReadings(Component):
    """A prior from readings that were taken before, of a system without states, as the study measures.

    Attributes:
        readings: settings of every input, reading by reading.
    """

    readings: dict[str, tuple[float | str, ...]]


def _prior_form(value: Any) -> str:
    # By what is given, so that mistakes are those of the form that was meant.
    forms = {"record": (PriorRecord, "from a record"), "readings": (PriorReadings, "from readings")}
    for key, (kind, form) in forms.items():
        if key in value if isinstance(value, dict) else isinstance(value, kind):
            return form
    return "as numbers"


AnyPrior = Annotated[
    Annotated[Prior, Tag("as numbers")] | Annotated[PriorRecord, Tag("from a record")],
    Discriminator(_prior_form),
]
AnySystemPrior = Annotated[
    Annotated[Prior, Tag("as numbers")]
    | Annotated[PriorRecord, Tag("from a record")]
    | Annotated[PriorReadings, Tag("from readings")],
    Discriminator(_prior_form),
]


class ValidationOptions(Component):
    """Simulated experiments to compare the predicted covariance with; see `oed.validate`."""

    replicates: Annotated[int, Field(ge=100, le=100_000_000)] = 10_000
    estimators: Annotated[tuple[EstimatorName, ...], Field(min_length=1)] | None = None
    heading: Heading = "known"
    loss: Loss = "linear"
    alpha: Annotated[float, Field(gt=0, lt=1)] = ALPHA

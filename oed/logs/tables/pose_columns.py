"""Where the reference poses are: columns of the log, or of a file beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag

from oed.foundation.component import Component
from oed.foundation.errors import Flaw
from oed.kernel.dynamics.system import System
from oed.logs.form import Repeats
from oed.logs.tables.columns import PoseColumn, Short, TimeColumn, unit_reason


def _pose_column(value: Any) -> str:
    return "none" if value == "none" else "column"


AnyPoseColumn = Annotated[
    Annotated[Literal["none"], Tag("none")] | Annotated[PoseColumn, Short("column"), Tag("column")],
    Discriminator(_pose_column),
]


class PoseColumns(Component):
    """Where the reference poses are; further states of the robot are keys by their own names.

    Attributes:
        x, y, heading: their columns, or "none" for what was not measured.
        time: column of their own clock, where it is not that of the inputs.
        file: they are in a file of their own, beside the log; "{stem}" stands for the log's stem.
        form: of that file: "tum" (timestamp, position, quaternion) or "csv"; by its ending by default.
        held: "drop" rows that repeat a pose while the wheels turn, as a slower sensor's do, or "keep" them.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, AnyPoseColumn] = Field(init=False)

    x: AnyPoseColumn = PoseColumn(column="x")
    y: AnyPoseColumn = PoseColumn(column="y")
    heading: AnyPoseColumn = PoseColumn(column="heading")
    time: Annotated[TimeColumn, Short("column")] | None = None
    file: str | None = None
    form: Literal["tum", "csv"] | None = None
    held: Repeats = "drop"

    @property
    def is_tum(self) -> bool:
        """Whether the poses are in a TUM file."""
        by_ending = (self.file or "").lower().endswith((".tum", ".txt"))
        return self.file is not None and (self.form == "tum" or (self.form is None and by_ending))

    @property
    def columns(self) -> dict[str, PoseColumn]:
        """What was measured, by the state's name."""
        plain = {"x": self.x, "y": self.y, "heading": self.heading}
        further = self.__pydantic_extra__ or {}
        return {name: one for name, one in (plain | further).items() if isinstance(one, PoseColumn)}

    def beside(self, log: Path) -> Path | None:
        """Where the poses of a log are; None where they are in the log itself."""
        return None if self.file is None else log.parent / self.file.replace("{stem}", log.stem)

    def flaws(self, model: System) -> list[Flaw]:
        """States the robot does not have, units of another kind, nothing measured."""
        key, flaws = ("log", "poses"), []
        units = dict(zip(model.states, model.state_units, strict=True))
        for name, column in self.columns.items():
            if name not in units:
                text = f"the robot has no state {name}; it has {', '.join(model.states)}"
                flaws.append(Flaw((*key, name), text))
            elif reason := unit_reason(column.unit, units[name]):
                flaws.append(Flaw((*key, name, "unit"), reason))
        if not self.columns:
            flaws.append(Flaw(key, "nothing of the robot's pose was measured"))
        if self.form is not None and self.file is None:
            flaws.append(Flaw((*key, "form"), "is that of a file of its own; add `file`"))
        return flaws

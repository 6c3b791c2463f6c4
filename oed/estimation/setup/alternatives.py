"""Other robots that the same logs may be explained by: the key `models` of a study's `calibration`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Any

from pydantic import Field, GetJsonSchemaHandler, model_serializer, model_validator
from pydantic_core import CoreSchema

from oed.foundation.component import Component, OneOf
from oed.foundation.errors import Flaw
from oed.robots.models import MODELS, Model


class Alternative(Component):
    """A robot that is fitted for comparison: the same keys as the study's `robot`, and these.

    Attributes:
        robot: with nominal values to start from.
        name: in tables; its kind by default.
        estimate: the parameters that are fitted, all of its own by default; the others are nominal.
    """

    robot: Annotated[Model, OneOf(MODELS)]
    name: Annotated[str, Field(min_length=1)] | None = None
    estimate: Annotated[tuple[str, ...], Field(min_length=1)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _own_keys(cls, given: Any) -> Any:
        # In a study the robot's keys stand beside the others.
        if isinstance(given, Model):
            return {"robot": given}
        if not isinstance(given, dict) or "robot" in given:
            return given
        own = {key: given[key] for key in ("name", "estimate") if key in given}
        return {**own, "robot": {key: value for key, value in given.items() if key not in own}}

    @model_serializer(mode="plain")
    def _as_given(self) -> dict[str, Any]:
        own: dict[str, Any] = {} if self.name is None else {"name": self.name}
        if self.estimate is not None:
            own["estimate"] = list(self.estimate)
        return {**OneOf(MODELS).as_data(self.robot), **own}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """A robot's keys, for editors: which there are depends on its kind."""
        kinds = [kind.model_fields["kind"].default for kind in MODELS]
        return {
            "type": "object",
            "description": "A robot to compare with: the keys of `robot`, and name and estimate.",
            "properties": {
                "kind": {"enum": kinds},
                "name": {"type": "string"},
                "estimate": {"type": "array", "items": {"type": "string"}, "minItems": 1},
            },
        }

    @property
    def label(self) -> str:
        """Its name in tables."""
        return self.name or str(self.robot.kind)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of those that are fitted."""
        return self.estimate or tuple(parameter.name for parameter in self.robot.parameters)

    @property
    def fitted_robot(self) -> Model:
        """The robot with these parameters: itself, or the same in terms of its coefficients."""
        return self.robot.estimating(self.parameters)

    def flaws(self, inputs: Sequence[str]) -> list[str]:
        """Why it cannot be fitted to logs of those inputs; [] where it can."""
        missing = [name for name in self.robot.input_names if name not in inputs]
        if missing:
            return [f"{self.label} needs the inputs {', '.join(missing)}; logged are {', '.join(inputs)}"]
        own = [parameter.name for parameter in self.robot.parameters]
        coefficients = [name for row in self.robot.coefficient_names for name in row]
        wanted = self.parameters
        if len(set(wanted)) < len(wanted):
            return [f"{self.label}: a parameter to estimate is listed twice"]
        if set(wanted) <= set(own) or set(wanted) <= set(coefficients):
            return []
        choices = ", ".join(own) + (f", or {', '.join(coefficients)}" if coefficients else "")
        return [f"{self.label}: expected some of its parameters ({choices}), got {', '.join(wanted)}"]


def alternative_flaws(robot: Model, models: Iterable[Alternative]) -> list[Flaw]:
    """Why robots cannot be compared with a study's own.

    Args:
        robot: the study's own, to whose inputs the logs belong.
        models: the others.
    """
    known, flaws = {str(robot.kind)}, []
    for index, one in enumerate(models):
        place = ("calibration", "models", index)
        if one.label in known:
            text = f"a second model named {one.label}; give each a `name` of its own"
            flaws.append(Flaw((*place, "name") if one.name else place, text))
        known.add(one.label)
        flaws += [Flaw(place, text) for text in one.flaws(robot.input_names)]
    return flaws

"""What the parts of a problem have in common: frozen, checked, chosen in YAML by `kind` or by key.

The class that a study file configures is the class that does the work: there is no second
"configuration" twin of a robot, a sensor, a limit or a solver.
"""

from __future__ import annotations

import operator
from functools import reduce
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema


class Component(BaseModel):
    """Base of every configurable part: immutable, unknown keys refused, numbers SI."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", arbitrary_types_allowed=True, ser_json_inf_nan="null", defer_build=True
    )


class OneOf:
    """Pydantic annotation for a part chosen by its `kind`: `Annotated[Model, OneOf(MODELS)]`.

    In YAML the kinds listed are known; in Python any instance of the annotated class is taken, so that
    a user's own part joins without being listed.
    """

    def __init__(self, members: tuple[type[Component], ...]) -> None:
        """Keep the listed classes."""
        self.members = members

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """A tagged union over the listed kinds, passed by for ready instances."""
        union = reduce(operator.or_, self.members)
        listed = handler(Annotated[union, Field(discriminator="kind")] if len(self.members) > 1 else union)

        def take(value: Any, validate: core_schema.ValidatorFunctionWrapHandler) -> Any:
            return value if isinstance(value, source) else validate(value)

        return core_schema.no_info_wrap_validator_function(
            take, listed, serialization=core_schema.plain_serializer_function_ser_schema(_dump)
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """The tagged union's schema."""
        return handler(schema["schema"])


def _dump(value: Component) -> Any:
    return value.model_dump(mode="json", exclude_none=True)

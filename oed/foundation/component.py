"""What the parts of a problem have in common: frozen, checked, chosen in YAML by `kind` or by key.

The class that a study file configures is the class that does the work: there is no second
"configuration" twin of a robot, a sensor, a limit or a solver.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial, reduce
from math import inf
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
)
from pydantic_core import CoreSchema, InitErrorDetails, core_schema

from oed.foundation.arguments import WrongKind, count_issue
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean
from oed.foundation.tidy import Tidy, TidyKind
from oed.foundation.wording import part_error


class _Worded(TidyKind):
    # Of parts that are made in Python: what is wrong with their arguments is said as in a study.
    if not TYPE_CHECKING:

        def __call__(self, *arguments: Any, **keys: Any) -> Any:
            if arguments and self.__init__ is BaseModel.__init__:
                names = ", ".join(name for name in self.model_fields if name != "kind") or "none"
                came = written(arguments[0])
                raise WrongKind(f"{self.__name__}: expected arguments by name ({names}), got {came}")
            try:
                return super().__call__(*arguments, **keys)
            except ValidationError as error:
                raise part_error(error, self, keys) from None


class Before:
    """Pydantic annotation: what makes another value of one that comes, before that is looked at.

    Pydantic's own `BeforeValidator` finds out anew, for each of a thousand fields, what functions take.
    """

    def __init__(self, function: Callable[[Any], Any]) -> None:
        """Keep the function, of the value alone."""
        self.function = function

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The function, then the field's own validation."""
        return core_schema.no_info_before_validator_function(self.function, handler(source))


def _short(value: Any) -> Any:
    reason = count_issue(value, None) if isinstance(value, int) else ""
    if reason:
        raise ValueError(f"{reason}, got {written(value)}")
    return value


Seed = Annotated[int, Field(ge=0), Before(_short)]
"""Of random draws."""


class Component(Tidy, metaclass=_Worded):
    """Base of every configurable part: immutable, unknown keys refused, numbers SI, and true is no number."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", arbitrary_types_allowed=True, ser_json_inf_nan="null", defer_build=True
    )

    names_code: ClassVar[bool] = False
    """Whether it is the name of a class of the user's own, in place of a part."""

    def resolved(self, context: Any, family: type[Component]) -> Component:
        """The part itself.

        Args:
            context: Pydantic's, in which it is read.
            family: the class that parts of this place inherit from.
        """
        return self

    def as_data(self) -> dict[str, Any]:
        """The part as plain data, defaults filled in."""
        return self.model_dump(mode="json", exclude_none=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **keywords: Any) -> None:
        """Have every field but the kind, by which classes are known, look out for true and false."""
        for name, field in cls.model_fields.items():
            if name != "kind":
                field.metadata = [*field.metadata, Before(partial(_no_truth_for_a_number, cls, name))]


def _no_truth_for_a_number(part: type[Component], field: str, value: Any) -> Any:
    # To Python, and so to Pydantic, true is the number 1.
    if isinstance(value, bool | list | tuple | Mapping):
        entries = [
            InitErrorDetails(
                type="value_error",
                loc=keys,
                input=truth,
                ctx={"error": ValueError(f"true and false mean nothing here, got {truth!r}")},
            )
            for keys, truth in _truths(value, _levels(part, field))
        ]
        if entries:
            raise ValidationError.from_exception_data(part.__name__, entries)
    return value


_PLAIN = frozenset((float, int, str, type(None)))
"""What needs no look at each entry of a long table."""


def _truths(value: Any, levels: float, keys: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], bool]]:
    # True and false among what numbers are read from, with the keys that lead to them.
    if isinstance(value, bool) and levels >= 0:
        yield keys, value
    elif isinstance(value, Mapping) and levels > 0:
        for key, entry in value.items():
            yield from _truths(entry, levels - 1, (*keys, key))
    elif isinstance(value, list | tuple) and not _PLAIN.issuperset(map(type, value)):
        for place, entry in enumerate(value):
            yield from _truths(entry, levels, (*keys, place))


@cache
def _levels(part: type[Component], field: str) -> float:
    # Levels of mappings in which a field looks out for true and false: none (-1) where they mean something to
    # it, alone or in a list; not those of parts, whose own fields look out.
    annotation = part.model_fields[field].rebuild_annotation()
    if _mentions(annotation, lambda kind: kind in (bool, Any)):
        return -1
    if not _mentions(annotation, lambda kind: isinstance(kind, type) and issubclass(kind, Component)):
        return inf
    return int(_mentions(annotation, lambda kind: get_origin(kind) in (dict, Mapping)))


def _mentions(annotation: Any, test: Callable[[Any], bool]) -> bool:
    inner = get_args(annotation)
    return test(annotation) or any(_mentions(kind, test) for kind in inner if not isinstance(kind, bool))


class OneOf:
    """Pydantic annotation for a part chosen by its `kind`: `Annotated[Model, OneOf(MODELS)]`.

    In YAML the kinds listed are known; in Python any instance of the annotated class is taken, so that
    a user's own part joins without being listed. It is saved by its class's name where one of those listed
    stands for such names.
    """

    def __init__(self, members: tuple[type[Component], ...]) -> None:
        """Keep the listed classes."""
        self.members = members
        kinds = (one.model_fields["kind"].default for one in members if "kind" in one.model_fields)
        self.kinds = tuple(kind for kind in kinds if isinstance(kind, str) and kind != "python")
        self.own: Any = next((one for one in members if one.names_code), None)

    def as_data(self, part: Component) -> dict[str, Any]:
        """A part as plain data that a study may hold."""
        return part.as_data() if self.own is None or type(part) in self.members else self.own.named(part)

    def _named(self, value: Any) -> Any:
        # A kind by its name alone: of what needs no further keys.
        if not isinstance(value, str) or not self.kinds:
            return value
        if value not in self.kinds:
            hint = did_you_mean(value, self.kinds)
            raise ValueError(f"expected one of {', '.join(self.kinds)}, got {written(value)}{hint}")
        return {"kind": value}

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """A tagged union over the listed kinds, passed by for instances."""
        union = reduce(operator.or_, self.members)
        listed = handler(Annotated[union, Field(discriminator="kind")] if len(self.members) > 1 else union)

        def take(
            value: Any, validate: core_schema.ValidatorFunctionWrapHandler, info: core_schema.ValidationInfo
        ) -> Any:
            part = value if isinstance(value, source) else validate(self._named(value))
            return part.resolved(info.context, source)

        return core_schema.with_info_wrap_validator_function(
            take, listed, serialization=core_schema.plain_serializer_function_ser_schema(self.as_data)
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """The tagged union's schema."""
        whole = handler(schema["schema"])
        return {"anyOf": [whole, {"enum": list(self.kinds)}]} if self.kinds else whole

"""Pydantic's classes as people meet them: completion, `help` and signatures show what is a class's own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import BaseModel

if TYPE_CHECKING:
    from collections.abc import Iterable
    from inspect import Signature

    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)

GIVEN = (
    "model_",
    "_abc_",
    *(f"__{one}" for one in ("pydantic", "class_vars", "private_attributes", "fields")),
)
"""How names begin that every class of pydantic's is given."""


class TidyKind(ModelMetaclass):
    """A class whose completion and `help` leave out what pydantic is made of.

    Arguments are read ("4.9 cm", a list, a mapping), not taken as they are: type checkers compare them with
    the types of the fields where a class has pydantic's own metaclass, but not where it has an heir of it.
    """

    def __dir__(self) -> list[str]:
        """The names without pydantic's."""
        return [name for name in type.__dir__(self) if not _of_pydantic(self, name)]

    if not TYPE_CHECKING:

        @property
        def __signature__(self) -> Signature:
            """The fields by name, but the kind, which the class is."""
            return _signature(self)

        @__signature__.setter
        def __signature__(self, pydantics: object) -> None:
            # Of thousands of characters, and nothing before the class is first used.
            pass


def _of_pydantic(kind: type, name: str) -> bool:
    owner = next((one for one in kind.__mro__ if name in vars(one)), kind)
    return name.startswith(GIVEN) or owner.__module__.startswith("pydantic")


def _signature(kind: type[BaseModel]) -> Signature:
    # Loaded by those who ask.
    from inspect import Parameter, Signature

    defaults = {
        name: Parameter.empty if field.is_required() else field.get_default(call_default_factory=True)
        for name, field in kind.model_fields.items()
        if name != "kind"
    }
    return Signature([Parameter(name, Parameter.KEYWORD_ONLY, default=one) for name, one in defaults.items()])


class Tidy(BaseModel, metaclass=TidyKind):
    """An object of such a class: completion lists its fields as well."""

    def __dir__(self) -> Iterable[str]:
        """The names without pydantic's."""
        return {*vars(self), *dir(type(self))}

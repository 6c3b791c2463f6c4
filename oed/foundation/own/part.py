"""Parts of the user's own in a study: robots, sensors, criteria and limits by where their classes stand.

A file names a part's class, `{kind: python, object: "module:Class", ...}`, and gives its fields. Read as data
it stays that name, and no code is run; read to be used it becomes the part itself.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, cached_property
from pathlib import Path
from types import FunctionType
from typing import Any, ClassVar, NoReturn, Self

from pydantic import ConfigDict, model_validator

from oed.foundation.component import Component
from oed.foundation.errors import Issue, OedError, PartError, UserMistake
from oed.foundation.own.code import class_at, in_words, lent_streams, place_of

UNMADE = {"code": "is not run"}
"""Pydantic's context in which parts of the user's own are read as the names they are."""


class OwnDescription(Component):
    """What a part of the user's own says of itself."""

    kind: str | None = None


class OwnPart(Component):
    """A part by its class's name; all keys but these are the class's fields.

    Subclasses inherit from the family's class as well, take further keys (`extra="allow"`) and may have a
    field `described`, whose keys are what the family says of itself: saved, for readers who run no code.

    Attributes:
        object: module and class, "my_module:MySensor".
        folder: where the module's file stands, a study's folder by default; a module that is not there is
            one that Python has installed.
    """

    model_config = ConfigDict(extra="allow")

    names_code: ClassVar[bool] = True
    noun: ClassVar[str]
    """What parts of the family are, for errors."""
    object: str
    folder: str | None = None

    @classmethod
    def __pydantic_init_subclass__(cls, **keywords: Any) -> None:
        """Answer what was saved; whatever else a family's class does not say needs the code."""
        super().__pydantic_init_subclass__(**keywords)
        for name in cls._saved_names():
            if name != "kind":
                setattr(cls, name, _Saved(cls, name))
        for name in cls.__abstractmethods__:
            setattr(
                cls, name, property(_needs_code) if isinstance(getattr(cls, name), property) else _needs_code
            )
        cls.__abstractmethods__ = frozenset()

    @classmethod
    def _saved_names(cls) -> tuple[str, ...]:
        # The fields of what `described` holds, where the family has any.
        field = cls.model_fields.get("described")
        return () if field is None else tuple(field.annotation.__args__[0].model_fields)  # type: ignore[union-attr]

    @model_validator(mode="after")
    def _of_its_own_kind(self) -> Self:
        # As it calls itself, by which reports know it.
        kind = getattr(getattr(self, "described", None), "kind", None)
        if kind is not None:
            self.__dict__["kind"] = kind
        return self

    @property
    def module_file(self) -> str:
        """Where its code is looked for first."""
        path = Path(self.folder or ".", *self.object.partition(":")[0].split("."))
        return f"{path}.py"

    def resolved(self, context: Any, family: type[Component]) -> Component:
        """The part itself, made and tried; in the context `UNMADE` this name of it.

        Raises:
            ValueError: no such module or class, keys that it does not take, or a part that does not work.
        """
        return self if context == UNMADE else self.made(family)

    def made(self, family: type[Component]) -> Any:
        """The part itself, of a class that inherits from `family`, made and tried.

        Raises:
            ValueError: no such module or class, keys that it does not take, or a part that does not work.
        """
        named = class_at(self.object, self.folder, family, self.noun)
        named_here = set(OwnPart.model_fields) | {"kind", "described"}
        own = {name: getattr(self, name) for name in self.model_fields_set - named_here}
        try:
            with lent_streams():
                self.try_out(named(**own))
                return guarded(named)(**own)
        except PartError as error:
            reasons = (str(Issue(one.key[1:], one.message)) for one in error.issues)
            raise ValueError(f"{self.object} cannot be made: {'; '.join(reasons)}") from None
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            # Whatever it is, even one that ends programs without a word.
            raise ValueError(f"{self.object} cannot be made: {in_words(error)}") from None

    def try_out(self, part: Any) -> None:
        """Ask a part of this family all that can be asked of it alone; by default nothing.

        Raises:
            ValueError: it does not work.
        """

    @classmethod
    def named(cls, part: Component) -> dict[str, Any]:
        """A part of a class that no study lists, as a study names it."""
        place, folder = place_of(type(part))
        said = {name: _asked(part, name) for name in cls._saved_names()}
        data = {"kind": "python", "object": place, "folder": folder, "described": said or None}
        given = {name: one for name, one in data.items() if one is not None}
        return {**part.model_dump(mode="json", exclude_none=True), **given}

    def as_data(self) -> dict[str, Any]:
        """This name as plain data."""
        return {**super().as_data(), "kind": "python"}


def _asked(part: Component, name: str) -> Any:
    try:
        return getattr(part, name)
    except Exception:
        # What a part cannot say of itself is not saved: it must not take all else with it.
        return None


def _needs_code(part: OwnPart, *_: object) -> NoReturn:
    raise UserMistake(f"{part.object} is code, of {part.module_file}, and was not run")


class _Saved:
    """An attribute that a part was saved with; the family's own where it was not."""

    def __init__(self, owner: type[OwnPart], name: str) -> None:
        """Keep the class that has it, and its name."""
        self.owner, self.name = owner, name

    def __get__(self, part: OwnPart | None, owner: type | None = None) -> Any:
        """What was saved."""
        if part is None:
            return self
        said = getattr(getattr(part, "described", None), self.name, None)
        return getattr(super(self.owner, part), self.name) if said is None else said


@cache
def guarded(named: type[Component]) -> type[Component]:
    """A class of the user's own whose errors name it, and whose parts other processes find."""
    members: dict[str, Any] = {}
    for one in reversed(named.__mro__):
        if one.__module__.partition(".")[0] not in ("oed", "pydantic", "builtins", "abc", "typing"):
            found = ((name, value) for name, value in vars(one).items() if not name.startswith("_"))
            members |= {name: _guard(named, name, value) for name, value in found if _runs(value)}
    frame = {"__module__": named.__module__, "__qualname__": named.__qualname__, "__doc__": named.__doc__}
    namespace = {**members, **frame, "__reduce__": _reduced, "__own__": True}
    return types.new_class(named.__name__, (named,), exec_body=lambda body: body.update(namespace))


def is_own(part: object) -> bool:
    """Whether a part was made of code that a study names."""
    return "__own__" in vars(type(part))


def _runs(member: object) -> bool:
    return isinstance(member, FunctionType | property | cached_property)


def _guard(named: type, name: str, member: object) -> Any:
    # Looked up when it is used, as it would be without a guard.
    if isinstance(member, FunctionType):

        def method(self: Any, *arguments: Any, **keywords: Any) -> Any:
            with named_errors(self, name):
                return getattr(named, name)(self, *arguments, **keywords)

        return method

    def value(self: Any) -> Any:
        with named_errors(self, name):
            found: Any = getattr(named, name)
            read: Any = found.fget if isinstance(found, property) else found.func
            return read(self)

    if isinstance(member, cached_property):
        kept = cached_property(value)
        kept.__set_name__(named, name)
        return kept
    return property(value)


@contextmanager
def named_errors(part: object, name: str) -> Iterator[None]:
    """The user's code may fail later as well, with what it was not tried with.

    Raises:
        OwnCodeError: it does.
    """
    try:
        with lent_streams():
            yield
    except (KeyboardInterrupt, OedError):
        raise
    except BaseException as error:
        place = place_of(type(part))[0]
        raise OwnCodeError(place, f"{name}: {in_words(error)}") from None


class OwnCodeError(UserMistake):
    """Code of the user's own that fails; `object` is its module and class."""

    def __init__(self, place: str, reason: str) -> None:
        """Keep what failed, and why."""
        self.object, self.reason = place, reason
        super().__init__(f"{place}: {reason}")

    def __reduce__(self) -> tuple[type[OwnCodeError], tuple[str, str]]:
        """What pickles it by its parts, from the worker that met it."""
        return OwnCodeError, (self.object, self.reason)


def _reduced(part: Any) -> tuple[Callable[..., Any], tuple[Any, ...], Any]:
    return _blank, place_of(type(part)), part.__getstate__()


def _blank(place: str, folder: str | None) -> Any:
    # In another process, which finds the class where it stands.
    made = guarded(class_at(place, folder, Component, "part"))
    return made.__new__(made)

"""A robot of the user's own, named in a study by where its class stands."""

from __future__ import annotations

import importlib
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

from pydantic import ConfigDict, ValidationError, ValidationInfo, model_validator

from oed.foundation.errors import UserMistake
from oed.foundation.quantities import parse_quantity
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter
from oed.robots.models.model import Model
from oed.robots.models.own_code import in_words, lent_streams
from oed.robots.models.own_module import own_module
from oed.robots.models.tryout import try_out

UNMADE = {"robots": "unmade"}
"""Pydantic's context in which robots of the user's own are read as the names they are: no code is run."""


class PythonRobot(Model):
    """The robot that `object` ("my_module:MyRobot") makes of all further keys; a `Model` of the user's own.

    Attributes:
        object: module and class.
        folder: where the module's file stands, a study's folder by default; a module that is not there is
            one that Python has installed.
    """

    model_config = ConfigDict(extra="allow")

    kind: Literal["python"] = "python"
    object: str
    folder: str | None = None

    @model_validator(mode="after")
    def _made(self, info: ValidationInfo) -> PythonRobot:
        # Data may name a robot without its code being run.
        if info.context != UNMADE:
            _ = self.robot
        return self

    @property
    def module_file(self) -> str:
        """Where its code is looked for first."""
        path = Path(self.folder or ".", *self.object.partition(":")[0].split("."))
        return f"{path}.py"

    @cached_property
    def robot(self) -> Model:
        """The robot itself.

        Raises:
            ValueError: no such module or class, keys that it does not take, or a robot that does not work.
        """
        found = _class_of(self.object, self.folder)
        own = {"body_radius": self.body_radius} if "body_radius" in self.model_fields_set else {}
        try:
            with lent_streams():
                made = found(**own, **(self.model_extra or {}))
                try_out(made)
        except ValidationError as error:
            reasons = (f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors())
            raise ValueError(f"{self.object} cannot be made: {'; '.join(reasons)}") from None
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            # Whatever it is, even one that ends programs without a word.
            raise ValueError(f"{self.object} cannot be made: {in_words(error)}") from None
        return made

    @property
    def body_width(self) -> float:
        """Its `track` [m], if it is given one; no code is run for it."""
        try:
            return parse_quantity((self.model_extra or {}).get("track", 0.0), "m")
        except ValueError:
            return 0.0

    @property
    def short_forms(self) -> tuple[str, ...]:  # type: ignore[override]
        """The robot's own."""
        return tuple(self._asked("short_forms"))

    @property
    def inputs(self) -> tuple[Input, ...]:  # type: ignore[override]
        """The robot's inputs."""
        return tuple(self._asked("inputs"))

    @property
    def states(self) -> tuple[str, ...]:  # type: ignore[override]
        """The robot's states."""
        return tuple(self._asked("states"))

    @property
    def state_units(self) -> tuple[str, ...]:  # type: ignore[override]
        """Their units."""
        return tuple(self._asked("state_units"))

    @property
    def coefficient_names(self) -> tuple[tuple[str, ...], ...]:  # type: ignore[override]
        """The robot's coefficient names."""
        return tuple(self._asked("coefficient_names"))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The robot's parameters."""
        return tuple(self._asked("parameters"))

    def coefficients(self, parameters: Expression) -> Expression:
        """The robot's matrix c."""
        return self._asked("coefficients", parameters)

    def effective_inputs(self, inputs: Expression, parameters: Expression) -> Expression:
        """The robot's own."""
        return self._asked("effective_inputs", inputs, parameters)

    def mean_twist(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The robot's own."""
        return self._asked("mean_twist", state, twist, parameters, period)

    def internal_step(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The robot's own."""
        return self._asked("internal_step", state, twist, parameters, period)

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """The robot's own."""
        return self._asked("twist", inputs, parameters)

    def _asked(self, name: str, *arguments: Expression) -> Any:
        # The user's code may fail later as well, with what it was not tried with.
        try:
            with lent_streams():
                found = getattr(self.robot, name)
                return found(*arguments) if arguments else found
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise UserMistake(f"{self.object}: {name}: {in_words(error)}") from None

    def __eq__(self, other: Any) -> bool:
        """By the robot that is made: its class may have changed since."""
        return isinstance(other, PythonRobot) and super().__eq__(other) and self.robot == other.robot

    def __hash__(self) -> int:
        """By the robot that is made."""
        return hash((self.object, self.body_radius, self.robot))

    def __getstate__(self) -> dict[Any, Any]:
        """Without the robot, which a worker makes again where it finds the module."""
        state = super().__getstate__()
        kept = {key: value for key, value in state["__dict__"].items() if key != "robot"}
        return {**state, "__dict__": kept}


def _class_of(place: str, folder: str | None) -> type[Model]:
    module_name, colon, name = place.partition(":")
    if not colon or not module_name or not name:
        raise ValueError(f"expected module:Class, got {place!r}")
    found = getattr(_module(module_name, folder), name, None)
    if found is None:
        raise ValueError(f"{module_name} has no {name}")
    if not isinstance(found, type) or not issubclass(found, Model):
        raise ValueError(f"{place} is no robot: expected a class that inherits from oed.Model")
    return found


def _module(name: str, folder: str | None) -> ModuleType:
    try:
        with lent_streams():
            own = None if folder is None else own_module(Path(folder), name)
            return importlib.import_module(name) if own is None else own
    except ModuleNotFoundError as error:
        if error.name != name.partition(".")[0]:
            raise ValueError(f"{name} cannot be imported: {error}") from None
        where = f"in {folder} and " if folder is not None else ""
        raise ValueError(f"no module {name} {where}on Python's path") from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        # A module that ends the program must not end this one as if all were well.
        raise ValueError(f"{name} cannot be imported: {in_words(error)}") from None

"""A robot of the user's own, named in a study by where its class stands.

It is tried where it is named: all that is ever asked of robots is asked once.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any, Literal

import casadi as ca
import numpy as np

from oed.foundation.files import identifier_issue
from oed.foundation.own.part import OwnDescription, OwnPart
from oed.foundation.quantities import LARGEST, parse_quantity
from oed.foundation.shown import shown, written
from oed.kernel.dynamics.system import Input, Parameter, follows_state, stepper
from oed.robots.models.coefficients import nominal_coefficients
from oed.robots.models.model import Model

MOST_NAMES = 200
"""Inputs, states or parameters of a robot, and its coefficients; real ones have a tenth of it."""
POSE, POSE_UNITS = Model.states, Model.state_units
"""What every robot's states begin with."""
COLUMNS = ("t", "run")
"""What else stands in the files of drives, beside inputs and states."""
UNIT = 40
"""Characters of a unit."""
EXPRESSIONS: tuple[Any, ...] = (ca.SX, ca.DM, np.ndarray, int, float)


class PythonRobot(OwnPart, Model, extra="allow"):
    """The robot that `object` ("my_module:MyRobot") makes of all further keys."""

    noun = "robot"
    kind: Literal["python"] = "python"
    described: OwnDescription | None = None

    def try_out(self, part: Any) -> None:
        """Ask the robot for everything.

        Raises:
            ValueError: what it says of itself is not what it is to be, or does not fit together.
            BaseException: whatever its own methods raise.
        """
        _try_inputs(part)
        _try_parameters(part)
        _try_states(part)
        _require(part.short_forms, str, "short_forms", "texts", least=0)
        _try_motion(part)
        _try_coefficients(part)

    @property
    def body_width(self) -> float:
        """Its `track` [m], if it is given one; no code is run for it."""
        try:
            return parse_quantity((self.model_extra or {}).get("track", 0.0), "m")
        except ValueError:
            return 0.0


def _try_inputs(robot: Model) -> None:
    _require(robot.inputs, Input, "inputs", "oed.Input")
    _require_names("inputs", [entry.name for entry in robot.inputs])
    for entry in robot.inputs:
        _require_names(f"quantity of {entry.name}", [entry.quantity])
        _require_unit(entry.name, entry.unit)
        if not entry.below > 0:
            raise ValueError(f"{entry.name}: expected `below` more than 0, got {written(entry.below)}")


def _try_parameters(robot: Model) -> None:
    _require(robot.parameters, Parameter, "parameters", "oed.Parameter")
    _require_names("parameters", [entry.name for entry in robot.parameters])
    for entry in robot.parameters:
        _require_unit(entry.name, entry.unit)
        if not abs(float(entry.nominal)) <= LARGEST:
            text = f"expected a finite nominal value of at most {LARGEST:g}"
            raise ValueError(f"{entry.name}: {text}, got {written(entry.nominal)}")
        if not 0 <= float(entry.size) <= LARGEST:
            text = f"expected a size of at least 0 and at most {LARGEST:g}"
            raise ValueError(f"{entry.name}: {text}, got {written(entry.size)}")


def _try_states(robot: Model) -> None:
    states, units = robot.states, robot.state_units
    _require(states, str, "states", "texts")
    _require(units, str, "state_units", "texts")
    if tuple(states[:3]) != POSE:
        raise ValueError(f"states: expected {', '.join(POSE)} first, got {written(states)}")
    if len(units) != len(states):
        raise ValueError(f"state_units: expected {len(states)}, one of each state, got {len(units)}")
    if tuple(units[:3]) != POSE_UNITS:
        raise ValueError(f"state_units: expected {', '.join(POSE_UNITS)} first, got {written(units)}")
    _require_names("states", states)
    _require_names("inputs and states", [*COLUMNS, *states, *(entry.name for entry in robot.inputs)])
    for name, unit in zip(states, units, strict=True):
        _require_unit(name, unit)


def _try_motion(robot: Model) -> None:
    inputs, parameters, state, period = _symbols(robot)
    issues = robot.issues()
    if issues:
        raise ValueError(issues[0].message)
    twist = ca.SX(robot.twist(inputs, parameters))
    _require_shape("mean_twist", robot.mean_twist(state, twist, parameters, period), 3)
    following = robot.internal_step(state, twist, parameters, period)
    _require_shape("internal_step", following, len(robot.states) - 3)
    found = robot.motion(state, inputs, parameters, period)
    if not isinstance(found, tuple) or len(found) != 2:
        raise ValueError(f"motion: expected a pair, of a twist and further states, got {written(found)}")
    _require_shape("motion", found[0], 3)
    _require_shape("motion", found[1], len(robot.states) - 3)
    stepper(robot)(len(robot.states) * [0.0], len(robot.inputs) * [0.0], robot.nominal, 0.1)
    follows_state(robot)


def _try_coefficients(robot: Model) -> None:
    inputs, parameters, *_ = _symbols(robot)
    rows, effective = robot.coefficient_names, robot.effective_inputs(inputs, parameters)
    _require(rows, tuple, "coefficient_names", "tuples of texts", least=0)
    _require_shape("effective_inputs", effective, len(rows[0]) if rows else None)
    if not rows:
        return
    names = list(chain.from_iterable(rows))
    _require(names, str, "coefficient_names", "tuples of texts")
    if len(rows) not in (2, 3) or len({len(row) for row in rows}) > 1:
        raise ValueError(f"coefficient_names: expected 2 or 3 rows of one length, got {written(rows)}")
    _require_names("coefficient_names", names)
    _require_shape("coefficients", robot.coefficients(parameters), len(rows), len(rows[0]))
    if not np.isfinite(nominal_coefficients(robot)).all():
        raise ValueError("coefficients: expected finite ones of the nominal parameters")


def _symbols(robot: Model) -> tuple[Any, ...]:
    counts = (len(robot.inputs), len(robot.parameters), len(robot.states), 1)
    names = ("inputs", "parameters", "state", "period")
    return tuple(ca.SX.sym(name, count) for name, count in zip(names, counts, strict=True))


def _require(entries: Any, kind: type, what: str, expected: str, least: int = 1) -> None:
    # Counted first: to look at far too many takes long.
    if not isinstance(entries, tuple | list) or len(entries) < least:
        raise ValueError(f"{what}: expected a tuple of {expected}, got {written(entries)}")
    if len(entries) > MOST_NAMES:
        raise ValueError(f"{what}: expected at most {MOST_NAMES}, got {len(entries)}")
    if not all(isinstance(entry, kind) for entry in entries):
        raise ValueError(f"{what}: expected a tuple of {expected}, got {written(entries)}")


def _require_names(what: str, names: Sequence[str]) -> None:
    issue = next(filter(None, map(identifier_issue, names)), "")
    if issue:
        raise ValueError(f"{what}: {issue}")
    for place, name in enumerate(names):
        if name in names[:place]:
            raise ValueError(f"{what}: a second one named {name!r}")


def _require_unit(name: str, unit: object) -> None:
    if not isinstance(unit, str) or shown(unit) != unit or len(unit) > UNIT:
        text = f"expected a unit of at most {UNIT} characters, '' for a ratio"
        raise ValueError(f"{name}: {text}, got {written(unit)}")


def _require_shape(what: str, value: Any, rows: int | None, columns: int = 1) -> None:
    # Any number of rows for None.
    came = ca.SX(value).shape if isinstance(value, EXPRESSIONS) else None
    if came is None or came != (came[0] if rows is None else rows, columns):
        expected = ("n" if rows is None else rows, columns)
        raise ValueError(f"{what}: expected {expected}, got {came or written(value)}")

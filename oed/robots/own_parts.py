"""Sensors and limits of the user's own, named in a study by where their classes stand. Parts are tried there:
each is asked once for all that it will be asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import BaseModel

from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.own.code import in_words, lent_streams, place_of
from oed.foundation.own.part import OwnCodeError, OwnPart, is_own
from oed.foundation.shown import written
from oed.kernel.criteria import CRITERIA, Criterion, Epigraph
from oed.kernel.dynamics.rollout import drive_shape
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System, signaller
from oed.kernel.limit import Limit, Rows
from oed.kernel.measurement.blocks import Block
from oed.kernel.measurement.measurement import Measurement, measurement_of
from oed.kernel.measurement.readings import moment_reading
from oed.kernel.measurement.sensor import Moment, Sensor
from oed.kernel.problem import Problem

Key = tuple[str | int, ...]


class SensorDescription(Component):
    """What a sensor of the user's own says of itself."""

    kind: str | None = None
    when: Literal["at samples", "in periods"] | None = None
    subject: str | None = None
    units: tuple[str, ...] | None = None
    noise_text: str | None = None
    remark: str | None = None


class PythonSensor(OwnPart, Sensor, extra="allow"):
    """The sensor that `object` ("my_module:MySensor") makes of all further keys."""

    noun = "sensor"
    kind: Literal["python"] = "python"
    described: SensorDescription | None = None


class PythonLimit(OwnPart, Limit, extra="allow"):
    """The limit that `object` ("my_module:MyLimit") makes of all further keys."""

    name: ClassVar[str] = "own"
    noun = "limit"
    kind: Literal["python"]


def components(part: Any, key: Key = ()) -> Iterator[tuple[Key, BaseModel]]:
    """A part of a study, and all parts that it has in turn, with their keys."""
    if isinstance(part, BaseModel):
        yield key, part
        for name in type(part).model_fields:
            yield from components(getattr(part, name), (*key, name))
    elif isinstance(part, tuple | list):
        for place, one in enumerate(part):
            yield from components(one, (*key, place))


def measurement_issues(file: Any) -> list[Issue]:
    """What is wrong with measurements of the user's own, before a problem is made of them.

    Args:
        file: the study, its system and design space sound.
    """
    space = file.space
    system = space.driving(file.model)
    return _issues(file, Sensor, lambda one: _try_sensor(one, system)) or _issues(
        file, (Sensor, Measurement), lambda one: _try_measurement(measurement_of(one), system, space)
    )


def judge_issues(file: Any, problem: Problem) -> list[Issue]:
    """What is wrong with criteria and limits of the user's own.

    Args:
        file: the study.
        problem: the one made of it.
    """
    return [
        *_issues(file, Criterion, lambda one: _try_criterion(one, problem)),
        *_issues(file, Limit, lambda one: _try_limit(one, problem)),
    ]


def code_issue(file: Any, error: OwnCodeError) -> Issue:
    """Code of the user's own that failed, by the key that names it."""
    keys = [key for key, part in components(file) if is_own(part) and place_of(type(part))[0] == error.object]
    return Issue(keys[0] if keys else (), str(error))


def _issues(file: Any, family: type | tuple[type, ...], trial: Callable[[Any], None]) -> list[Issue]:
    found = []
    for key, part in components(file):
        if is_own(part) and isinstance(part, family):
            try:
                with lent_streams():
                    trial(part)
            except KeyboardInterrupt:
                raise
            except OwnCodeError as error:
                found.append(Issue(key, str(error)))
            except BaseException as error:
                # Whatever it is, even one that ends programs without a word.
                found.append(Issue(key, f"{place_of(type(part))[0]} does not work: {in_words(error)}"))
    return found


def _try_sensor(sensor: Sensor, system: System) -> None:
    own = {one.name: ca.SX.sym(one.name) for one in sensor.nuisances}
    state, inputs = ca.SX.sym("state", len(system.states)), ca.SX.sym("inputs", len(system.inputs))
    function = signaller(system)
    signals = {name: ca.SX.sym(name, function.size1_out(name)) for name in function.name_out()}
    moment = Moment(system, state, inputs, signals, own)
    if sensor.when == "between samples":
        moment = replace(moment, earlier=moment, elapsed=ca.SX.sym("elapsed"))
    rows = _shape("reading", sensor.reading(moment), (None, 1))[0]
    _shape("whitening", sensor.whitening(moment), (rows, rows))
    if len(sensor.units) not in (0, rows):
        raise ValueError(f"units: expected {rows}, one of each entry of a reading, got {len(sensor.units)}")
    for text in (sensor.subject, sensor.noise_text, sensor.remark, sensor.brief(1), sensor.sentence(1)):
        _require("what it says of itself", text, str)
    moment_reading(sensor, system)


def _try_measurement(measurement: Measurement, system: System, space: Space) -> None:
    drive = drive_shape(system, samples=space.samples, runs=space.runs, period=space.period)
    blocks = measurement.blocks(drive)
    _require("blocks", blocks, tuple)
    for block in blocks:
        _require("blocks", block, Block)


def _try_criterion(criterion: Criterion, problem: Problem) -> None:
    if criterion.kind in [one.model_fields["kind"].default for one in CRITERIA]:
        raise ValueError(f"kind: expected a name of its own, got {criterion.kind!r}, which is another one's")
    sizes = [len(one.judged) for one in problem.any_estimations]
    about = problem.judging(criterion)
    value = np.asarray(about.value([np.eye(size) for size in sizes]), dtype=float)
    if value.shape != () or np.isnan(value):
        raise ValueError(f"value: expected one number for one matrix of each block, got {written(value)}")
    smooth = about.epigraph([ca.SX.sym("M", size, size) for size in sizes])
    _require("epigraph", smooth, Epigraph)
    _shape("epigraph's objective", smooth.objective, (1, 1))
    _require("meaning", about.meaning, str)


def _try_limit(limit: Limit, problem: Problem) -> None:
    space = problem.design
    drive = drive_shape(problem.system, samples=space.samples, runs=space.runs, period=space.period)
    _require("rows", limit.rows(drive), Rows)


def _shape(what: str, value: Any, expected: tuple[int | None, int]) -> tuple[int, int]:
    # Any number for None.
    shape: tuple[int, int] = ca.SX(value).shape
    if any(want is not None and want != came for want, came in zip(expected, shape, strict=True)):
        text = ", ".join("n" if want is None else str(want) for want in expected)
        raise ValueError(f"{what}: expected ({text}), got {shape}")
    return shape


def _require(what: str, value: Any, kind: type) -> None:
    if not isinstance(value, kind):
        raise ValueError(f"{what}: expected {kind.__name__}, got {written(value)}")

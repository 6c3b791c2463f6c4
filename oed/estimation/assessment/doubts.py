"""Doubts of single estimates: a sign or a size that no robot has, or far from what is known beforehand."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from oed.estimation.methods.beforehand import LOOSE
from oed.estimation.methods.fit import Fit
from oed.estimation.preprocessing.motion_checks import MANY_STRAYS
from oed.estimation.setup.options import Loss
from oed.foundation.arrays import Array
from oed.foundation.text import count, listing, size_text, words
from oed.kernel.dynamics.system import Parameter
from oed.logs.log import Log
from oed.robots.models.model import Model

ODD_WHEEL = 1.3
"""Factor between a wheel's radius and its nominal value that looks like a mistake."""
ODD_LENGTH = 1.5
"""The same of other lengths of a robot that does not skid: they are measured with a ruler."""
ODD_ZERO = 0.5
"""Size of a steering angle's zero [rad] that looks like one of another place: 29 degrees."""
ODD = 3.0
"""The same of everything else: a robot that skids turns as if it were two or three times as wide."""
SURELY = 3.0
"""How many standard errors an estimate has to be off for its size to be doubted."""
CONTRADICTS = 4.0
"""How many standard deviations off what is known beforehand an estimate contradicts it."""
REMEDY = "check units, gains and the nominal value, or whether the logs drive what identifies it"


@dataclass(frozen=True)
class Doubt:
    """Why an estimate may not be what it seems.

    Attributes:
        parameter: its name; "" where it is about all of them.
        name: "sign", "size", "prior", "input_noise", "odd_point", "short_logs", "few_blocks",
            "stray_motions" or "exact".
        message: a sentence with the size, and what to do.
    """

    parameter: str
    name: str
    message: str


def stray_doubts(logs: Sequence[Log], loss: Loss) -> tuple[Doubt, ...]:
    """A word on logs of which very many motions are far off, where a fit takes each for a measurement."""
    names = [log.name for log in logs if any(one.name == MANY_STRAYS for one in log.findings)]
    if not names or loss != "linear":
        return ()
    text = (
        f"so many relative poses of {listing(names)} are bad matches that the estimates are theirs: give "
        "`calibration: {loss: cauchy}`, which bounds what they do"
    )
    return (Doubt("", "stray_motions", text),)


def plausibility_doubts(fit: Fit, covariance: Array, lost: Collection[str] = ()) -> tuple[Doubt, ...]:
    """Estimates of another sign or order of magnitude than a robot's parameters have, or that contradict the
    study's prior; the gravest of each parameter.

    Args:
        fit: of all logs.
        covariance: of all unknowns, (q, q), SI.
        lost: parameters whose information may be noise of the inputs alone, which explains any sign and size.
    """
    robot, names = fit.unknowns.robot, fit.unknowns.parameters
    table = {parameter.name: parameter for parameter in robot.parameters}
    apart = _off_the_prior(fit, covariance)
    found: list[Doubt] = []
    for place, name in enumerate(names):
        value, error = float(fit.values[place]), float(np.sqrt(covariance[place, place]))
        each: list[Doubt] = []
        if name not in lost:
            each += [*_sign(robot, table[name], value, error), *_size(robot, table[name], value, error)]
        each += _prior(name, apart[place])
        found += each[:1]
    return tuple(found)


def _sign(robot: Model, parameter: Parameter, value: float, error: float) -> Iterator[Doubt]:
    # What is nominally of one sign, and not of a size around 0.
    name, nominal = parameter.name, parameter.nominal
    known = parameter.scale > 0 and not parameter.size
    impossible = robot.allows({name: nominal}) and not robot.allows({name: value})
    if not impossible and not (known and value * nominal < 0):
        return
    what = "no robot of this kind has that" if impossible else f"its nominal value is {_text(parameter)}"
    text = (
        f"{words(name)} is {_with_error(parameter, value, error)}, and {what}: the logs do not identify it, "
        "or wheels, signs or axes are not what the study says; cut logs into segments (`segment`), look at "
        "their columns, or give a `prior`"
    )
    yield Doubt(name, "sign", text)


def _size(robot: Model, parameter: Parameter, value: float, error: float) -> Iterator[Doubt]:
    name, nominal, wheel = parameter.name, parameter.nominal, parameter.name.startswith("wheel_radius")
    if abs(value - nominal) < SURELY * error:
        return
    if parameter.unit == "rad" and abs(value - nominal) > ODD_ZERO:
        text = f"{words(name)} is {_with_error(parameter, value, error)}, far from its nominal value"
        remedy = "say in the log's `zero` what the encoder shows straight ahead, and look at its unit"
        yield Doubt(name, "size", f"{text} of {_text(parameter)}: {remedy}")
        return
    if parameter.size:
        most = ODD * max(parameter.size, abs(nominal))
        if abs(value) > most:
            text = f"{words(name)} is {_with_error(parameter, value, error)}, more than {ODD:g} times"
            whole = size_text(most / ODD, parameter.unit)
            yield Doubt(name, "size", f"{text} what it is compared with ({whole}): {REMEDY}")
        return
    length = parameter.unit == "m" and not robot.skids
    factor = ODD_WHEEL if wheel else ODD_LENGTH if length else ODD
    ratio = value / nominal if parameter.scale else 1.0
    if not ratio > 0 or 1 / factor <= ratio <= factor:
        return
    off = f"{ratio - 1:+.0%} off" if ratio < ODD else f"{ratio:.2g} times"
    sure = f", {abs(value - nominal) / error:.0f} standard errors" if error > 0 else ""
    remedy = "check ticks_per_turn, gear and units" if wheel else REMEDY
    yield Doubt(name, "size", f"{name} is {off} its nominal value{sure}: {remedy}")


def _prior(name: str, apart: float) -> Iterator[Doubt]:
    if apart > CONTRADICTS:
        off = count(round(apart), "standard deviation")
        text = f"{words(name)} is {off} off what the study's prior knows of it: logs and prior contradict"
        yield Doubt(name, "prior", f"{text} each other; look at both")


def _off_the_prior(fit: Fit, covariance: Array) -> Array:
    # How far estimates moved from what is known beforehand, in standard deviations of that move, (p,). What
    # only keeps a search in bounds is no knowledge.
    size = len(fit.unknowns.parameters)
    bounds = (LOOSE * fit.unknowns.scale[:size]) ** -2.0
    known = np.diag(fit.knowledge)[:size] > bounds * (1 + 1e-6)
    if not known.any():
        return np.zeros(size)
    before, after = np.diag(np.linalg.inv(fit.knowledge))[:size], np.diag(covariance)[:size]
    moved = np.abs(fit.values - fit.unknowns.nominal)[:size]
    known &= before > after
    return np.where(known, moved / np.sqrt(np.where(known, before - after, 1.0)), 0.0)


def _text(parameter: Parameter) -> str:
    return size_text(parameter.nominal, parameter.unit)


def _with_error(parameter: Parameter, value: float, error: float) -> str:
    return f"{size_text(value, parameter.unit)} (standard error {size_text(error, parameter.unit, 2)})"

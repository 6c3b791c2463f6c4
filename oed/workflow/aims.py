"""What is wanted of drives still to be designed: standard errors of parameters, and another duration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from oed.foundation.errors import UserMistake
from oed.foundation.quantities import parse_quantity
from oed.foundation.text import did_you_mean
from oed.study.study import Study


@dataclass(frozen=True)
class Aim:
    """A standard error that is wanted.

    Attributes:
        number: SI, or a share of the parameter's value.
        relative: whether it is such a share.
    """

    number: float
    relative: bool

    def size(self, value: float) -> float:
        """The standard error [SI] wanted of a parameter of such a value [SI]."""
        return self.number * abs(value) if self.relative else self.number


def aims_of(study: Study, targets: Mapping[str, str], option: str) -> dict[str, Aim]:
    """What is wanted, by the parameters' names.

    Args:
        study: that estimates them.
        targets: sizes by name, with a unit ("0.2 mm") or relative ("0.1 %"); the name of a pair of wheels
            stands for both.
        option: of the command line by which they were given.

    Raises:
        UserMistake: unknown parameters, and sizes that are none.
    """
    units = {
        name: unit
        for one in study.problem.any_estimations
        for name, unit in zip(one.parameters, one.units, strict=True)
    }
    aims = {}
    for given, text in targets.items():
        relative = text.strip().endswith("%")
        for name in _meant(given, list(units), option):
            try:
                aims[name] = Aim(parse_quantity(text, "" if relative else units[name]), relative)
            except ValueError as error:
                raise UserMistake(f"{option} {given}: {error}") from None
            if not aims[name].number > 0:
                raise UserMistake(f"{option} {given}: expected more than 0, got {text!r}")
    return aims


def _meant(given: str, known: Sequence[str], option: str) -> list[str]:
    if given in known:
        return [given]
    sides = [name for name in known if name.startswith(f"{given}_")]
    if not sides:
        hint = did_you_mean(given, known)
        raise UserMistake(f"{option} {given}: expected one of {', '.join(known)}{hint}")
    return sides


def stretch(trajectory: dict[str, Any], duration: float) -> None:
    """Give a study's drives another duration [s], with as many samples and spline spans a second as before;
    spans that a search chooses are left to it.

    Args:
        trajectory: the study's key, as plain data, SI; changed in place.
        duration: of a run [s].
    """
    longer = duration / trajectory["duration"]
    spline = trajectory["spline"]
    trajectory["duration"] = duration
    trajectory["samples"] = max(1, round(longer * trajectory["samples"]))
    if spline["coefficients"] == "auto":
        return
    spans = spline["coefficients"] - spline["degree"]
    spline["coefficients"] = spline["degree"] + max(1, round(longer * spans))

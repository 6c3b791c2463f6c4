"""Robots that can be bought, with their published geometry and limits. A new one is a YAML file here."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from functools import cache
from importlib import resources
from typing import Any

import yaml

from oed.foundation.errors import ProblemError
from oed.foundation.text import did_you_mean


@cache
def preset_names() -> tuple[str, ...]:
    """Names of all presets."""
    files = resources.files(__package__).iterdir()
    return tuple(sorted(file.name.removesuffix(".yaml") for file in files if file.name.endswith(".yaml")))


def preset(name: str) -> dict[str, dict[str, Any]]:
    """The keys `robot` and `limits` of a study, as a preset has them.

    Raises:
        ProblemError: an unknown name.
    """
    if name not in preset_names():
        hint = did_you_mean(str(name), preset_names())
        text = f"expected one of {', '.join(preset_names())}, got {name!r}{hint}"
        raise ProblemError.about(("robot", "preset"), text)
    # A copy: what is made of it is no other study's.
    return deepcopy(_read(name))


@cache
def _read(name: str) -> dict[str, dict[str, Any]]:
    text = resources.files(__package__).joinpath(f"{name}.yaml").read_text(encoding="utf-8")
    data: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return data


def with_preset(study: Mapping[str, Any]) -> dict[str, Any]:
    """A study's keys with its robot's preset filled in: every key given overrides the preset's, and one
    given as null leaves it out.

    Raises:
        ProblemError: an unknown preset.
    """
    robot = study.get("robot")
    if not isinstance(robot, dict) or "preset" not in robot:
        return dict(study)
    known = preset(robot["preset"])
    own = {key: value for key, value in robot.items() if key != "preset"}
    if "wheel_radius_right" in own or "wheel_radius_left" in own:
        own.setdefault("wheel_radius", None)
    limits = study.get("limits")
    if limits is not None and not isinstance(limits, dict):
        # Said to be wrong where the study is checked.
        return {**study, "robot": _merged(known["robot"], own)}
    return {
        **study,
        "robot": _merged(known["robot"], own),
        "limits": _merged(known["limits"], limits or {}),
    }


def _merged(known: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in {**known, **own}.items() if value is not None}

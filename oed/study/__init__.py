"""The study file: its keys, checked, and written for a robot."""

from typing import TYPE_CHECKING, Any

from oed.foundation.lazy import loader

if TYPE_CHECKING:
    from oed.study.study import Study as Study
    from oed.study.study import json_schema as json_schema

_HOMES = {"oed.study.study": ("Study", "json_schema")}
_MOVED = ("load_study", "parse_study")
_load = loader(__name__, _HOMES)


def __getattr__(name: str) -> Any:
    if name in _MOVED:
        raise ImportError(f"oed.study.{name} is now oed.{name}")
    return _load(name)

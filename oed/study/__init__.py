"""The study file: read, checked, written."""

from typing import TYPE_CHECKING

from oed.foundation.lazy import loader

if TYPE_CHECKING:
    from oed.study.study import Study as Study
    from oed.study.study import json_schema as json_schema
    from oed.study.study import load_study as load_study
    from oed.study.study import parse_study as parse_study

_HOMES = {"oed.study.study": ("Study", "json_schema", "load_study", "parse_study")}
__getattr__ = loader(__name__, _HOMES)

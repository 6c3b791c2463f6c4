"""Logs of real drives: read from files, checked, and brought onto one clock.

A new kind of log is a `LogForm` of its own and a name in `LOG_FORMS`.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator

from oed.foundation.component import OneOf
from oed.logs.bag_form import BagForm
from oed.logs.form import LogForm, read_logs
from oed.logs.hold_out import last_held_out
from oed.logs.log import Finding, Log, SensorReadings
from oed.logs.series import NotInLog
from oed.logs.tables.csv_form import CsvForm
from oed.logs.tuple_form import TupleForm

LOG_FORMS: tuple[type[LogForm], ...] = (CsvForm, BagForm, TupleForm)


def _with_kind(value: Any) -> Any:
    return {"kind": "csv", **value} if isinstance(value, dict) else value


AnyLogForm = Annotated[LogForm, OneOf(LOG_FORMS), BeforeValidator(_with_kind)]
"""A study's key `log`: of kind csv where it does not say."""

__all__ = [
    "LOG_FORMS",
    "AnyLogForm",
    "BagForm",
    "CsvForm",
    "Finding",
    "Log",
    "LogForm",
    "NotInLog",
    "SensorReadings",
    "TupleForm",
    "last_held_out",
    "read_logs",
]

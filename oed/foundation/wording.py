"""What pydantic finds wrong with a value, in words: what was expected, and what came."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pydantic import ValidationError
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from oed.foundation.quantities import counts_as_zero
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean


def in_words(detail: ErrorDetails) -> str:
    """What is wrong with one value."""
    context = detail.get("ctx", {})
    got = f"got {written(detail['input'])}"
    bounds = {
        "greater_than": ("gt", "more than"),
        "greater_than_equal": ("ge", "at least"),
        "less_than": ("lt", "less than"),
        "less_than_equal": ("le", "at most"),
    }
    kind = detail["type"]
    if kind == "missing":
        return "missing"
    if kind == "extra_forbidden":
        return "unknown key"
    if kind == "invalid_key":
        return f"expected a name as a key, {got}"
    if kind == "value_error":
        return str(context["error"])
    if kind in bounds:
        key, words = bounds[kind]
        why = counts_as_zero(detail["input"]) if context[key] == 0 and kind == "greater_than" else ""
        return f"expected {words} {context[key]}, {got}{why}"
    if kind in ("literal_error", "union_tag_invalid"):
        expected = context.get("expected") or context.get("expected_tags")
        came = f"got {context['tag']!r}" if "tag" in context else got
        given = context.get("tag", detail["input"])
        known = re.findall(r"'([^']+)'", str(expected))
        return f"expected {expected}, {came}{did_you_mean(given, known) if isinstance(given, str) else ''}"
    if kind == "union_tag_not_found":
        return "the key kind is missing, which says what this is"
    if kind == "too_short":
        return f"expected at least {context['min_length']} of them, {got}"
    if kind == "too_long":
        return f"expected at most {context['max_length']} of them, {got}"
    plain = {
        "model_type": "keys and values",
        "model_attributes_type": "keys and values",
        "int_parsing": "a whole number",
        "int_type": "a whole number",
        "int_from_float": "a whole number",
        "float_parsing": "a number",
        "float_type": "a number",
        "bool_parsing": "true or false",
        "bool_type": "true or false",
        "string_type": "text",
        "tuple_type": "a list",
        "list_type": "a list",
        "dict_type": "keys and values",
        "finite_number": "a finite number",
    }
    return f"expected {plain[kind]}, {got}" if kind in plain else f"{detail['msg']}, {got}"


def worded(error: ValidationError, known: Sequence[str] = ()) -> ValidationError:
    """The error with its reasons in words, without addresses of pydantic's pages; `known` are the keys of the
    whole.
    """
    details = error.errors(include_url=False)
    reasons = [
        InitErrorDetails(type=_reason(one, known), loc=one["loc"], input=one["input"]) for one in details
    ]
    return ValidationError.from_exception_data(error.title, reasons, hide_input=True)


def _reason(detail: ErrorDetails, known: Sequence[str]) -> PydanticCustomError:
    own_key = detail["type"] == "extra_forbidden" and len(detail["loc"]) == 1 and known
    hint = f"; known here: {', '.join(known)}" if own_key else ""
    context = {**detail.get("ctx", {}), "reason": in_words(detail) + hint}
    return PydanticCustomError(detail["type"], "{reason}", context)

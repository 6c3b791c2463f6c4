"""What pydantic finds wrong with a value, in words: what was expected, and what came."""

from __future__ import annotations

import re
import typing
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from oed.foundation.errors import Issue, PartError
from oed.foundation.quantities import counts_as_zero
from oed.foundation.removed import REMOVED
from oed.foundation.shown import written
from oed.foundation.text import NAME, did_you_mean

KIND = "kind"
"""The key by which parts are told apart."""


_BOUNDS = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
"""Pydantic's kinds of errors about bounds: where it keeps the bound, and words for it."""
_SENTENCES = {
    "missing": "missing",
    "extra_forbidden": "unknown key",
    "union_tag_not_found": "the key kind is missing, which says what this is",
}
_PATTERNS = {
    NAME: "a name of letters, digits, spaces, _ and -, which begins with a letter, a digit or _",
    r"^[A-Za-z]\w*$": "a name of letters, digits and _, which begins with a letter",
}
"""What a text of a pattern is, in words."""
UNKNOWN = 5
"""Unknown keys beside each other that are named; of more it is the form that is another."""
_EXPECTED = {
    "invalid_key": "a name as a key",
    "too_short": "at least {min_length} of them",
    "too_long": "at most {max_length} of them",
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


def in_words(detail: ErrorDetails) -> str:
    """What is wrong with one value."""
    kind, context = detail["type"], detail.get("ctx", {})
    got = f"got {written(detail['input'])}"
    if kind in _SENTENCES:
        return _SENTENCES[kind]
    if kind == "value_error":
        return str(context["error"])
    if kind == "string_pattern_mismatch" and context["pattern"] in _PATTERNS:
        return f"expected {_PATTERNS[context['pattern']]}, {got}"
    if kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        why = counts_as_zero(detail["input"]) if context[key] == 0 and kind == "greater_than" else ""
        return f"expected {words} {context[key]}, {got}{why}"
    if kind in ("literal_error", "union_tag_invalid"):
        expected = context.get("expected") or context.get("expected_tags")
        came = f"got {context['tag']!r}" if "tag" in context else got
        given = context.get("tag", detail["input"])
        if isinstance(given, str) and given in REMOVED:
            return REMOVED[given]
        known = re.findall(r"'([^']+)'", str(expected))
        return f"expected {expected}, {came}{did_you_mean(given, known) if isinstance(given, str) else ''}"
    return (
        f"expected {_EXPECTED[kind].format(**context)}, {got}"
        if kind in _EXPECTED
        else f"{detail['msg']}, {got}"
    )


def part_error(error: ValidationError, part: type[BaseModel], given: Mapping[str, Any]) -> PartError:
    """What is wrong with the arguments of a part's class.

    Args:
        error: pydantic's.
        part: the class.
        given: its arguments.
    """
    reasons: dict[tuple[str, ...], list[str]] = {}
    for detail, more in few_unknown(error.errors(include_url=False)):
        texts = reasons.setdefault((part.__name__, *_places(detail, given)), [])
        texts.append(sentence(detail, part, more))
    # An issue deeper down says more than "none of the forms fits" about the whole.
    above = {key[:depth] for key in reasons for depth in range(1, len(key))}
    found = {key: "; or ".join(telling(texts)) for key, texts in reasons.items() if key not in above}
    return PartError([Issue(key, text) for key, text in found.items()])


def few_unknown(details: Sequence[ErrorDetails]) -> list[tuple[ErrorDetails, int]]:
    """What is wrong, with only a few of the unknown keys that stand beside each other; and with the last of
    these how many more there are, 0 with all others.

    Args:
        details: pydantic's, of all that is wrong.
    """
    beside: dict[tuple[str | int, ...], list[int]] = {}
    for place, detail in enumerate(details):
        if detail["type"] == "extra_forbidden":
            beside.setdefault(detail["loc"][:-1], []).append(place)
    more = {places[UNKNOWN - 1]: len(places) - UNKNOWN for places in beside.values() if len(places) > UNKNOWN}
    dropped = {place for places in beside.values() for place in places[UNKNOWN:]}
    return [(one, more.get(place, 0)) for place, one in enumerate(details) if place not in dropped]


def _places(detail: ErrorDetails, given: Any) -> Iterator[str]:
    # Parts of a path that are no keys (a union's labels) are passed over, but what is missing is none either.
    for part in untagged(detail["loc"], given):
        inside = isinstance(given, Mapping) and part in given
        if inside or (isinstance(given, list | tuple) and isinstance(part, int) and part < len(given)):
            given = given[part]
            yield str(part)
    if detail["type"] == "missing":
        yield str(detail["loc"][-1])


def untagged(path: Sequence[str | int], given: Any) -> tuple[str | int, ...]:
    """A path of pydantic's without labels that are keys as well: `landmarks` have a key `landmarks`.

    Args:
        path: of keys, and of labels where a union is entered.
        given: what it leads into.
    """
    kept, entered = list[str | int](), False
    for part in path:
        inside = isinstance(given, Mapping) and part in given
        if entered and inside and given.get(KIND) == part:
            entered = False
            continue
        kept.append(part)
        if inside or (isinstance(given, list | tuple) and isinstance(part, int) and part < len(given)):
            given, entered = given[part], True
    return tuple(kept)


def telling(texts: Sequence[str]) -> Sequence[str]:
    """The reasons to give: where it is known what was meant, other forms are none of the reader's."""
    return [text for text in texts if text.endswith("?")] or texts


def sentence(detail: ErrorDetails, root: type[BaseModel] = BaseModel, more: int = 0) -> str:
    """What is wrong with one value.

    Args:
        detail: pydantic's.
        root: knows the keys that there are.
        more: unknown keys beside this one that are not named.
    """
    if more:
        return f"unknown key, as {'are' if more > 1 else 'is'} {more} more beside it"
    if detail["type"] == "extra_forbidden":
        return _unknown_key(str(detail["loc"][-1]), _known_keys(root, detail["loc"][:-1]))
    text = in_words(detail)
    return text.replace("got None", "got nothing") if detail["input"] is None else text


def _unknown_key(key: str, known: Sequence[str]) -> str:
    if key in known:
        # Of another form than the keys beside it.
        return "does not go with the keys beside it: leave out this one or those"
    if key in REMOVED:
        return REMOVED[key]
    hint = did_you_mean(key, known)
    return (
        f"unknown key{hint}{'' if hint else ';'} known here: {', '.join(known)}" if known else "unknown key"
    )


def _known_keys(root: type[BaseModel], path: Sequence[str | int]) -> list[str]:
    candidates = [root]
    for part in path:
        tagged = [one for one in candidates if _kind(one) == part]
        if tagged:
            candidates = tagged
            continue
        fields = [one.model_fields[part] for one in candidates if part in one.model_fields]
        inner = [
            found for field in fields for found in _components(field.rebuild_annotation(), field.metadata)
        ]
        # A list's index or a union's label leads nowhere new.
        candidates = inner or candidates
    return sorted({name for one in candidates for name in one.model_fields})


def _kind(component: type[BaseModel]) -> object:
    field = component.model_fields.get(KIND)
    return None if field is None else field.default


def _components(annotation: Any, metadata: Sequence[Any] = ()) -> Iterator[type[BaseModel]]:
    listed = [member for entry in metadata for member in getattr(entry, "members", ())]
    yield from listed
    if listed:
        return
    if typing.get_origin(annotation) is typing.Annotated:
        inner, *extra = typing.get_args(annotation)
        yield from _components(inner, extra)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    else:
        for argument in typing.get_args(annotation):
            yield from _components(argument)

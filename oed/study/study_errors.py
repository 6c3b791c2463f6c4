"""Validation errors of a study file in words: what was expected, what came, what exists, and where."""

from __future__ import annotations

import typing
from collections.abc import Iterator, Sequence
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from oed.foundation.component import Component, OneOf
from oed.foundation.errors import FileFlaw
from oed.foundation.text import did_you_mean
from oed.foundation.wording import in_words
from oed.study.offered import as_studies_have
from oed.study.yaml_source import Source

MOST_EXPLAINED = 200
"""Mistakes that are explained; where there are more, the file is hardly a study."""


KIND = "kind"
"""The key by which parts are told apart."""


def explain(error: ValidationError, root: type[Component], source: Source) -> list[FileFlaw]:
    """One flaw per place in the file, in the order of the lines.

    Where a value fits none of several forms, the reasons are joined.

    Args:
        error: of the study's classes.
        root: the class of the whole.
        source: where the keys stand.
    """
    reasons: dict[tuple[int, int, str], list[str]] = {}
    details = error.errors(include_url=False)
    for detail in details[:MOST_EXPLAINED]:
        place = _place(detail, source)
        texts = reasons.setdefault((place.line, place.column, place.key), [])
        text = sentence(detail, root)
        if text not in texts:
            texts.append(text)
    # A flaw deeper down says more than "none of the forms fits" about the whole.
    left = [
        _place(detail, source, f"and {len(details) - MOST_EXPLAINED} more mistakes")
        for detail in details[MOST_EXPLAINED : MOST_EXPLAINED + 1]
    ]
    above = {".".join(parts[:depth]) for parts in map(_parts, reasons) for depth in range(1, len(parts))}
    return [
        FileFlaw(source.file, line, column, key, "; or ".join(_telling(texts)))
        for (line, column, key), texts in sorted(reasons.items())
        if key not in above
    ] + left


def _place(detail: ErrorDetails, source: Source, message: str = "") -> FileFlaw:
    path, missing = detail["loc"], detail["type"] == "missing"
    if detail["type"] == "union_tag_invalid":
        # The mistyped value's own line: that of `kind`, or of `form`.
        tag, given = detail["ctx"]["tag"], detail["input"]
        path = (*path, *[key for key in (KIND, "form") if given.get(key) == tag][:1])
    if missing:
        return source.flaw(path[:-1], message, missing=str(path[-1]))
    return source.flaw(path, message, of_key=detail["type"] == "extra_forbidden")


def _telling(texts: Sequence[str]) -> Sequence[str]:
    # Where it is known what was meant, other forms that the value does not have are none of the reader's.
    return [text for text in texts if text.endswith("?")] or texts


def _parts(place: tuple[int, int, str]) -> list[str]:
    return place[2].split(".")


def sentence(detail: ErrorDetails, root: type[Component] = Component) -> str:
    """What is wrong with one value; `root` knows the keys that there are."""
    if detail["type"] == "extra_forbidden":
        return _unknown_key(str(detail["loc"][-1]), _known_keys(root, detail["loc"][:-1]))
    text = in_words(detail)
    if detail["type"] == "union_tag_invalid" and "measurement" in detail["loc"]:
        text += as_studies_have(str(detail["ctx"]["tag"]))
    return text.replace("got None", "got nothing") if detail["input"] is None else text


def _unknown_key(key: str, known: Sequence[str]) -> str:
    hint = did_you_mean(key, known)
    return (
        f"unknown key{hint}{'' if hint else ';'} known here: {', '.join(known)}" if known else "unknown key"
    )


def _known_keys(root: type[Component], path: Sequence[str | int]) -> list[str]:
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


def _kind(component: type[Component]) -> object:
    field = component.model_fields.get(KIND)
    return None if field is None else field.default


def _components(annotation: Any, metadata: Sequence[Any] = ()) -> Iterator[type[Component]]:
    listed = [entry for entry in metadata if isinstance(entry, OneOf)]
    for entry in listed:
        yield from entry.members
    if listed:
        return
    if typing.get_origin(annotation) is typing.Annotated:
        inner, *extra = typing.get_args(annotation)
        yield from _components(inner, extra)
    elif isinstance(annotation, type) and issubclass(annotation, Component):
        yield annotation
    else:
        for argument in typing.get_args(annotation):
            yield from _components(argument)

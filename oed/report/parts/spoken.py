"""Sections in the words of the domain that their record is of."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

from oed.foundation.vocabulary import Vocabulary

Said = TypeVar("Said")
AS_IT_IS = ("code", "downloads", "commands", "links", "film", "animation", "unit", "name", "address", "look")
"""Fields of sections and figures that are no prose."""


def in_words(said: Said, vocabulary: Vocabulary) -> Said:
    """A section, or a part of one, with all its prose in a domain's words."""
    return said if not vocabulary.words else _in_words(said, vocabulary)


def _in_words(said: Any, vocabulary: Vocabulary) -> Any:
    if isinstance(said, str):
        return vocabulary.said(said)
    if isinstance(said, tuple | list):
        return type(said)(_in_words(one, vocabulary) for one in said)
    if not is_dataclass(said) or isinstance(said, type):
        return said
    parts = {one.name: getattr(said, one.name) for one in fields(said) if one.name not in AS_IT_IS}
    return replace(said, **{name: _in_words(part, vocabulary) for name, part in parts.items()})

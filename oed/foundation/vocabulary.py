"""The words of a domain: what is a drive of a robot is an experiment with a system."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property


@dataclass(frozen=True)
class Vocabulary:
    """What a domain calls things otherwise.

    Attributes:
        words: its words by those that texts are written in, both in small letters.
        kept: names in texts that stay as they are, whatever words they have.
    """

    words: Mapping[str, str] = field(default_factory=dict)
    kept: tuple[str, ...] = ()

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        # Of several that fit the longest; of names those that have a word of these.
        own = _either(self.words)
        names = _either(name for name in self.kept if re.search(rf"\b(?:{own})\b", name, re.IGNORECASE))
        kept = rf"(?P<kept>\b(?:{names})\b)|" if names else ""
        return re.compile(rf"{kept}\b(?P<word>{own})\b", re.IGNORECASE)

    def said(self, text: str) -> str:
        """A text in the domain's words."""
        return self._pattern.sub(self._word, text) if self.words else text

    def _word(self, found: re.Match[str]) -> str:
        word = found["word"]
        if word is None:
            return found[0]
        own = self.words[word.lower()]
        return own[:1].upper() + own[1:] if word[:1].isupper() else own


def _either(some: Iterable[str]) -> str:
    return "|".join(re.escape(one) for one in sorted(filter(None, some), key=len, reverse=True))


_spoken: ContextVar[Vocabulary | None] = ContextVar("vocabulary", default=None)


@contextmanager
def speaking(vocabulary: Vocabulary) -> Iterator[None]:
    """Have `spoken` speak so while the context lasts."""
    before = _spoken.set(vocabulary)
    try:
        yield
    finally:
        _spoken.reset(before)


def speak(vocabulary: Vocabulary) -> None:
    """Have `spoken` speak so from here on: of a command that is about one study."""
    _spoken.set(vocabulary)


def spoken(text: str) -> str:
    """A text in the words of what is spoken about."""
    vocabulary = _spoken.get()
    return text if vocabulary is None else vocabulary.said(text)

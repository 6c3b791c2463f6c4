"""Sentences from templates: sections compute values, templates say them."""

from __future__ import annotations

import math
import re
from functools import cached_property, lru_cache
from typing import Any

import jinja2

from oed.foundation import text
from oed.kernel.measurement.information import scaling_text


@lru_cache(maxsize=1)
def environment() -> jinja2.Environment:
    """The templates of the pages, with what they write numbers and names by."""
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("oed.report"),
        autoescape=jinja2.select_autoescape(("html", "html.jinja")),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
        extensions=["jinja2.ext.do"],
    )
    made.filters.update(
        words=text.words,
        listing=lambda items: text.listing(list(items)),
        names=lambda items: text.listing([text.words(item) for item in items]),
        quantity=text.quantity,
        count=text.count,
        chance=text.chance_text,
        digits=lambda value, digits: text.significant(digits)(value),
        given=text.given_text,
        deviation=text.deviation_text,
        unit=text.unit_text,
        slug=text.slug,
        scaling=scaling_text,
        within=within,
    )
    made.globals["infinity"] = math.inf
    return made


def within(name: str) -> str:
    """A drive's name within a sentence: `the designed drive`, `Design 2`."""
    return re.sub(r"^D(?=esigned |esign for )", "the d", name)


class Prose:
    """The sentences of a section: macros of the template of its name."""

    def __init__(self, name: str) -> None:
        """Those of `templates/prose/<name>.jinja`."""
        self._name = name

    @cached_property
    def _macros(self) -> Any:
        return environment().get_template(f"prose/{self._name}.jinja").module

    def __call__(self, macro: str, *values: Any) -> str:
        """What a macro says of values, as one paragraph; "" where it says nothing."""
        return " ".join(self.paragraphs(macro, *values))

    def paragraphs(self, macro: str, *values: Any) -> tuple[str, ...]:
        """What a macro says of values; blank lines part paragraphs."""
        said = re.split(r"\n[ \n]*\n", getattr(self._macros, macro)(*values))
        return tuple(filter(None, (re.sub("[ \n]+", " ", one).strip() for one in said)))

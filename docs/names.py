"""The reference: a page for each group of public names, with what their docstrings say."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

from gallery import keep
from sphinx.pycode import ModuleAnalyzer

import oed

OF_CLASSES = (
    "   :members:\n   :exclude-members: model_config, model_post_init, model_fields, model_computed_fields\n"
)


def groups() -> dict[str, list[str]]:
    """The public names by their groups, as the package lists them."""
    lines = re.findall(
        r"^(    (?:    )?)(\S.*)$", str(oed.__doc__).split("all names", 1)[1], flags=re.MULTILINE
    )
    found: dict[str, list[str]] = {}
    for indent, text in lines:
        if len(indent) == 4:
            names = found[text] = []
        else:
            names += re.findall(r"\w+", text)
    return found


def write(folder: Path) -> None:
    """Write a page for each group, and one that lists them."""
    folder.mkdir(parents=True, exist_ok=True)
    pages = groups()
    for title, names in pages.items():
        keep(folder / f"{_stem(title)}.md", _page(title, names))
    keep(folder / "index.md", _index(list(pages)))


def _stem(title: str) -> str:
    return "_".join(title.lower().replace(",", "").split())


def _page(title: str, names: list[str]) -> str:
    return "\n".join([f"# {title}", "", "```{eval-rst}", *map(_entry, names), "```", ""])


def _entry(name: str) -> str:
    thing = getattr(oed, name)
    if inspect.isclass(thing):
        return f".. autoclass:: oed.{name}\n{OF_CLASSES}"
    return f".. autofunction:: oed.{name}\n" if inspect.isroutine(thing) else _alias(name, thing)


def _alias(name: str, thing: object) -> str:
    # What it says of itself stands in the module that it is from, as the stub has it.
    stub = Path(str(oed.__file__)).with_suffix(".pyi").read_text()
    home = re.search(rf"^from (\S+) import {name} as", stub, flags=re.MULTILINE)
    assert home is not None
    said = ModuleAnalyzer.for_module(f"oed{home[1]}").find_attr_docs()["", name]
    value = re.sub(r"\b(?:[a-z_]+\.)+(?=[A-Z])", "", str(thing))
    return "\n".join([f".. py:data:: oed.{name}", f"   :value: {value}", "", f"   {said[0]}", ""])


def _index(titles: list[str]) -> str:
    said = "Every name of `import oed`, with its shapes, SI units and errors."
    toc = ["```{toctree}", ":maxdepth: 1", "", *map(_stem, titles), "```", ""]
    return "\n".join(["# Python reference", "", said, "", *toc])

"""The reference: a page for each group of public names, with what their docstrings say."""

from __future__ import annotations

import inspect
from pathlib import Path

from gallery import keep

import oed

GROUPS = {
    "Studies, runs and records": ("oed.study", "oed.workflow", "oed.records"),
    "Robots": ("oed.robots.models", "oed.robots.space"),
    "Sensors": ("oed.robots.sensors", "oed.kernel.measurement"),
    "Limits": ("oed.robots.limits", "oed.kernel.limit"),
    "Criteria": ("oed.kernel.criteria",),
    "Problems, drives and their score": ("oed.kernel", "oed.robots"),
    "Searches": ("oed.optimize", "oed.foundation.work"),
    "Uncertain robots": ("oed.uncertainty",),
    "Bounds": ("oed.bounds",),
    "Logs and estimation": ("oed.logs", "oed.estimation"),
    "Simulated experiments": ("oed.simulation",),
    "Reports and exports": ("oed.report", "oed.exporters"),
    "Errors": ("oed.foundation",),
}
"""Of the reference, each with the modules whose public names it has; the longest that fits counts."""
LEFT_OVER = "Further names"
"""Of names of modules that no group has."""
OF_CLASSES = (
    "   :members:\n   :exclude-members: model_config, model_post_init, model_fields, model_computed_fields\n"
)


def group_of(name: str) -> str:
    """The group of a public name."""
    module = str(getattr(getattr(oed, name), "__module__", ""))
    fits = [
        (len(place), title)
        for title, places in GROUPS.items()
        for place in places
        if f"{module}.".startswith(f"{place}.")
    ]
    return max(fits)[1] if fits else LEFT_OVER


def write(folder: Path) -> None:
    """Write a page for each group, and one that lists them."""
    folder.mkdir(parents=True, exist_ok=True)
    grouped: dict[str, list[str]] = {title: [] for title in (*GROUPS, LEFT_OVER)}
    for name in sorted(oed.__all__, key=str.lower):
        grouped[group_of(name)].append(name)
    pages = {title: names for title, names in grouped.items() if names}
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
    return f".. {'autofunction' if callable(thing) else 'autodata'}:: oed.{name}\n"


def _index(titles: list[str]) -> str:
    said = "Every name of `import oed`, with its shapes, SI units and errors."
    toc = ["```{toctree}", ":maxdepth: 1", "", *map(_stem, titles), "```", ""]
    return "\n".join(["# Python reference", "", said, "", *toc])

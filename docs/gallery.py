"""The gallery: every study of a robot in problems/, solved as it stands but from few starts, and its drive.

What was solved is kept beside the pages, and not solved again until the study or the package changes.
`OED_DOCS_GALLERY` names the studies to show, without suffix; all by default.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from cells import quick

import oed
from oed.foundation.text import words
from oed.report.answer import answer_of
from oed.report.figures import paths as path_figures
from oed.report.figures.draw import svg_text
from oed.report.figures.driven import path_of, room_of

ONLY = "OED_DOCS_GALLERY"
"""Environment variable: the studies to show, separated by blanks."""
STARTS = 4
"""Of the search of each study: as good as the study's own in most, in a fraction of the time."""
LEAST = 10
"""Iterations of the one start of each, where all is quick."""
ESTIMATED = "Logs are estimated from with this study, too: {doc}`/howto/estimate`."
SAID = (
    "Every study of a robot that comes with the package, in `problems/`. Each is solved here as it stands, "
    f"but from {STARTS} starts and without its other searches; `oed run problems/NAME.yaml` does all that it "
    "asks for."
)


@dataclass(frozen=True)
class Shown:
    """What the gallery says of a study.

    Attributes:
        stem: of its file.
        name: its own.
        about: paragraphs of the comment that it begins with.
        parts: its robot, sensors and criterion, in words.
        rows: parameter, nominal value, standard error of the design, and of the best baseline.
        baseline: the best one that can be driven; "" for none.
        sentences: how the two compare.
    """

    stem: str
    name: str
    about: Sequence[str]
    parts: str
    rows: Sequence[Sequence[str]]
    baseline: str
    sentences: Sequence[str]


def write(problems: Path, folder: Path) -> None:
    """Write a page and a figure for each study, and a page of all of them.

    Args:
        problems: folder of the studies.
        folder: of the pages; made where missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    wanted = os.environ.get(ONLY, "").split()
    files = [one for one in sorted(problems.glob("*.yaml")) if not wanted or one.stem in wanted]
    shown = [_shown(file, folder) for file in files if _drives(file)]
    for one in shown:
        keep(folder / f"{one.stem}.md", _page(one))
    keep(folder / "index.md", _index(shown))


def keep(file: Path, text: str) -> None:
    """Write a page, unless it says the same already: then it is not built again."""
    if not file.exists() or file.read_text(encoding="utf-8") != text:
        file.write_text(text, encoding="utf-8")


def _drives(file: Path) -> bool:
    # Whether it is of a robot: an experiment on another system has no path to be drawn.
    return hasattr(oed.load_study(file).file, "robot")


def _shown(file: Path, folder: Path) -> Shown:
    kept, key = folder / f"{file.stem}.json", _key(file)
    if kept.exists():
        data = json.loads(kept.read_text(encoding="utf-8"))
        if data.pop("key") == key:
            return Shown(**data)
    print(f"gallery: {file.stem}", flush=True)
    made, figure = _solved(file)
    (folder / f"{file.stem}.svg").write_text(figure, encoding="utf-8")
    kept.write_text(json.dumps({"key": key, **asdict(made)}), encoding="utf-8")
    return made


def _key(file: Path) -> str:
    # Of all that a drive and its figure follow from; studies of one's own robot come with a module.
    code = sorted(Path(oed.__file__).parent.rglob("*.py"))
    own = file.with_suffix(".py")
    read = [file, *([own] if own.exists() else []), Path(__file__), *code]
    return hashlib.sha256(b"\0".join(one.read_bytes() for one in read)).hexdigest() + " quick" * quick()


def _solved(file: Path) -> tuple[Shown, str]:
    # What the study says of itself and of its drive, and the drive's figure.
    study = oed.load_study(file)
    few = {"starts": 1, "max_iterations": LEAST} if quick() else {"starts": STARTS}
    search = oed.Ipopt(perturbations=0, second_stage="none", **few)
    record = oed.run(study.changed(solvers=[search], validation=None, physics=None, bound=False), workers=1)
    answer, best = answer_of(record), record.best
    assert answer is not None, f"no drive of {file} satisfies its limits"
    assert best is not None
    measured = study.file.measurement
    sensors = ", ".join(f"`{one.kind}`" for one in getattr(measured, "sensors", (measured,)))
    robot, criterion = study.file.robot.kind, study.problem.criterion.kind
    shown = Shown(
        stem=file.stem,
        name=study.name,
        about=_about(study.text),
        parts=f"Robot `{robot}`, measured by {sensors}, criterion `{criterion}`.",
        rows=[(one.name, one.value, one.designed, one.baseline or "–") for one in answer.rows],
        baseline=answer.baseline,
        sentences=[*answer.sentences, *([ESTIMATED] if study.file.log is not None else [])],
    )
    return shown, svg_text(
        path_figures.paths([replace(path_of(record, best), title="Designed drive")], room_of(record))
    )


def _about(text: str) -> list[str]:
    # The comment that a study begins with, paragraph by paragraph.
    comment = re.match(r"(?:#.*\n)*", text)
    lines = [
        line.removeprefix("#").removeprefix(" ") for line in (comment[0] if comment else "").splitlines()
    ]
    return [" ".join(part.split()) for part in "\n".join(lines).split("\n\n") if part.strip()]


def _page(one: Shown) -> str:
    lines = [
        f"# {one.name}",
        *map(_plain, one.about),
        one.parts,
        f"```{{figure}} {one.stem}.svg\n"
        f":alt: The drive designed for {words(one.stem)} in its room, from start to end, with its speed\n\n"
        "The designed drive, with its speed as colour.\n```",
        *_table(one),
        " ".join(one.sentences),
        f"```{{literalinclude}} ../../../problems/{one.stem}.yaml\n"
        f":language: yaml\n:caption: problems/{one.stem}.yaml\n```",
    ]
    return "\n\n".join(lines) + "\n"


def _table(one: Shown) -> list[str]:
    usual = f"best baseline ({one.baseline})" if one.baseline else "best baseline"
    head = ("parameter", "value", "standard error, designed", usual)
    # A number and its unit stay on one line.
    rows = [[name, *(cell.replace(" ", "\u00a0") for cell in cells)] for name, *cells in one.rows]
    lines = [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]
    return ["\n".join(lines)] if one.rows else []


def _plain(text: str) -> str:
    # Words of a comment that mean themselves, but for `code`.
    parts = re.split(r"(`[^`]+`)", text)
    return "".join(
        one if one.startswith("`") else re.sub(r"([\\*_\[\]<>#~|$^])", r"\\\1", one) for one in parts
    )


def _index(shown: Iterable[Shown]) -> str:
    every = list(shown)
    toc = "\n".join(["```{toctree}", ":hidden:", "", *(one.stem for one in every), "```"])
    grid = ["::::{grid} 1 1 2 2\n:gutter: 3", *map(_card, every), "::::"]
    return "\n\n".join(["# Gallery of studies", SAID, *grid, toc]) + "\n"


def _card(one: Shown) -> str:
    first = one.about[0].split(". ")[0].rstrip(".:") + "." if one.about else one.name
    lines = [
        f":::{{grid-item-card}} {one.name}",
        f":img-top: {one.stem}.svg",
        f":img-alt: The designed drive of {words(one.stem)}",
        f":link: {one.stem}",
        ":link-type: doc",
        ":class-card: study",
        "",
        _plain(textwrap.shorten(first, 150, placeholder=" ...")),
        ":::",
    ]
    return "\n".join(lines)

"""Damaged files, read by the command line."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from .cases import Verdict
from .damage.material import TARGETS, Target, copied, filled
from .damage.running import Ran, run_apart, run_here
from .damage.tables import LONG_SHARE, TABLES, far_too_long
from .damage.text import ANY, Damage
from .damage.trees import TREES, in_json, in_yaml, yaml_trap
from .damage.verdict import manners, taken_for_right
from .generator.quantities import one_of

Rng = np.random.Generator

STREAMS = (".stdout", ".stderr")
APART = 0.1
"""Share of cases whose command has a process of its own."""


def file_case(rng: Rng, material: Path, *, quick: bool = False) -> Iterator[Verdict]:
    """One damaged file and one command that reads it; `quick` ones take a fraction of a second."""
    target: Target = one_of(rng, TARGETS)
    commands = target.commands[: target.quick] if quick else target.commands
    command, damage = one_of(rng, commands), _damage(rng, target, quick=quick)
    apart = not quick and (rng.random() < APART or damage is far_too_long)
    with tempfile.TemporaryDirectory(prefix="oed-campaign-") as place:
        folder, out = Path(place) / "work", Path(place) / "out"
        out.mkdir()
        copied(material, folder)
        file = folder / target.file
        sound = file.read_bytes()
        damaged = damage(rng, sound)
        file.write_bytes(damaged)
        before = _prints(folder)
        after = _with_exports((run_apart if apart else run_here)(filled(command, out), folder), command, out)
        what = f"{command[0]} of a {target.sort} ({damage.__name__})"
        found = [*manners(after), _strays(Path(place), folder, before, command)]
        if damage is not far_too_long:
            found.append(taken_for_right(target.sort, sound, damaged, _undamaged(material, command), after))
    for one in found:
        yield Verdict(one.asked, one.wrong and f"{what}: {one.wrong}")


def _damage(rng: Rng, target: Target, *, quick: bool) -> Damage:
    if target.sort == "log" and not quick and rng.random() < LONG_SHARE * len(TARGETS):
        return far_too_long
    if rng.random() < 0.4:
        return one_of(rng, ANY)
    if target.sort in ("path", "log"):
        return one_of(rng, TABLES)
    if target.sort == "study" and rng.random() < 0.3:
        return yaml_trap
    change = one_of(rng, TREES)
    made = (in_yaml if target.sort == "study" else in_json)(change)
    made.__name__ = change.__name__
    return made


@lru_cache(maxsize=64)
def _undamaged(material: Path, command: tuple[str, ...]) -> Ran:
    # What the same command says of the sound file.
    with tempfile.TemporaryDirectory(prefix="oed-campaign-") as place:
        folder, out = Path(place) / "work", Path(place) / "out"
        out.mkdir()
        copied(material, folder)
        return _with_exports(run_here(filled(command, out), folder), command, out)


def _with_exports(ran: Ran, command: tuple[str, ...], out: Path) -> Ran:
    # What an export says is in its file; what a page says is for the eye.
    if command[0] == "export":
        texts = [file.read_text(encoding="utf-8") for file in sorted(out.iterdir()) if file.is_file()]
        return replace(ran, out="\n".join(texts))
    return ran if "--json" in command or command[0] == "check" else replace(ran, out="")


def _prints(folder: Path) -> dict[str, str]:
    files = (file for file in sorted(folder.rglob("*")) if file.is_file())
    return {str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def _strays(place: Path, folder: Path, before: dict[str, str], command: tuple[str, ...]) -> Verdict:
    # Files written where nothing was to be written; `validate` renews its own record and report.
    beyond = [entry.name for entry in place.iterdir() if entry.name not in ("work", "out")]
    after = _prints(folder)
    own = f"{command[1]}/" if command[0] == "validate" else "\0"
    changed = [
        name
        for name in {*before, *after}
        if before.get(name) != after.get(name) and not name.startswith(own) and name not in STREAMS
    ]
    return Verdict("nothing written elsewhere", ", ".join(sorted([*beyond, *changed])[:3]))

"""`oed examples`: the example studies that come with the package, listed and copied."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from oed.cli.terminal.command import Command, answered
from oed.cli.terminal.messages import say, tell


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("names", metavar="NAME", nargs="*", help="studies to copy (default: list all)")
    parser.add_argument("--all", action="store_true", help="copy all of them")
    parser.add_argument("--out", metavar="DIR", help="where to copy to (default: problems/)")
    parser.add_argument("--force", action="store_true", help="write over files that exist")


def _run(options: argparse.Namespace) -> int:
    from oed.foundation.errors import UserMistake

    if options.names and options.all:
        raise UserMistake("give names of studies, or --all, not both")
    if options.names or options.all:
        return _copy(options)
    if options.out is not None or options.force:
        raise UserMistake("which studies are to be copied? give their names, or --all")
    return _list(options)


def _list(options: argparse.Namespace) -> int:
    from oed.study.examples import examples

    found = examples()
    wide = max(map(len, found))
    data = [{"name": one.name, "title": one.title, "files": list(one.files)} for one in found.values()]
    lines = [f"{one.name:<{wide}}  {one.title}" for one in found.values()]
    return answered(options, {"examples": data}, lambda: tell(*lines))


def _copy(options: argparse.Namespace) -> int:
    from oed.study.examples import FOLDER, copy_examples, examples, examples_named

    chosen = list(examples().values()) if options.all else examples_named(options.names)
    out = Path(options.out or FOLDER)
    files = copy_examples(chosen, out, force=options.force)
    studies = [out / one.files[0] for one in chosen]
    written = [str(file) for file, new in files.items() if new]
    data = {
        "directory": str(out),
        "studies": [*map(str, studies)],
        "files": [*map(str, files)],
        "written": written,
    }
    text = f"wrote {_named(written, out)}" if written else f"nothing to write, all is in {out} already"
    return answered(options, data, lambda: say(f"{text}; then: oed run {shlex.quote(str(studies[0]))}"))


def _named(files: list[str], out: Path) -> str:
    return " and ".join(files) if len(files) <= 2 else f"{len(files)} files to {out}"


EXAMPLES = Command(
    "examples", "list the studies that come with the package, or copy some to start from", _run, _arguments
)

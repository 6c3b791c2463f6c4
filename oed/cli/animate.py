"""`oed animate`: a film of a saved record's drives."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.cli.terminal.arguments import add_quiet, add_trust
from oed.cli.terminal.command import DONE, Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", metavar="DIR")
    parser.add_argument(
        "--result",
        metavar="NAME",
        nargs="+",
        action="extend",
        default=[],
        help="names of results, side by side, at most 4 (default: the best)",
    )
    parser.add_argument(
        "--to", choices=("gif", "mp4"), help="default: as --out ends, else gif; mp4 needs ffmpeg"
    )
    parser.add_argument("--speed", type=float, default=1.0, help="times as fast as the robot (default: 1)")
    parser.add_argument("--fps", type=float, help="frames a second (default: 20, of a long film fewer)")
    parser.add_argument(
        "--physics", action="store_true", help="drive it in simulated physics and film that (oed[physics])"
    )
    parser.add_argument(
        "--out", metavar="FILE", help="what to write (default: drive.gif in DIR, of physics physics.gif)"
    )
    add_trust(parser)
    add_quiet(parser)


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import progress
    from oed.cli.terminal.messages import print_json, tell
    from oed.foundation.errors import UserMistake
    from oed.records.record import load_record
    from oed.report import animate, write_report
    from oed.report.film.animation import NAME, folder_of
    from oed.report.film.physics import film_physics

    folder = folder_of(options.folder)
    ending = "" if options.to is None else f".{options.to}"
    name = "physics.gif" if options.physics else NAME
    file = Path(options.out) if options.out else (folder / name).with_suffix(ending or ".gif")
    if file.suffix.lower() != (ending or file.suffix.lower()):
        raise UserMistake(f"{file}: expected a name that ends in {ending}, as --to says")
    with progress(options.quiet) as listener:
        more = {"speed": options.speed, "fps": options.fps, "progress": listener}
        if options.physics:
            film = film_physics(
                options.folder, file, result=_one(options.result), trust=options.trust, **more
            )
        else:
            film = animate(options.folder, file, results=options.result, **more)
    # A report that shows the film is made again with it.
    page = None
    if file.resolve() == (folder / NAME).resolve() and (folder / "report.html").is_file():
        page = write_report(load_record(folder), folder)
    if options.json:
        print_json(
            {
                **vars(film),
                "file": str(film.file),
                "results": list(film.results),
                "bytes": film.file.stat().st_size,
                "report": None if page is None else str(page),
            }
        )
    else:
        tell(f"film: {film.file} ({film.seconds:.3g} s, {film.file.stat().st_size / 1e6:.2g} MB)")
        if page is not None:
            tell(f"report: {page}")
    return DONE


def _one(names: list[str]) -> str | None:
    from oed.foundation.errors import UserMistake

    if len(names) > 1:
        raise UserMistake(f"--physics films one drive, got {', '.join(names)}")
    return names[0] if names else None


ANIMATE = Command("animate", "make a film of a saved record's drives, for its report", _run, _arguments)

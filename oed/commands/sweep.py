"""`oed sweep`: a grid of studies, and one page that compares them."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.commands.arguments import add_working, workers_of
from oed.commands.command import DONE, FAILED, Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument(
        "--over",
        metavar="'KEY=V1,V2,... [UNIT]'",
        action="append",
        required=True,
        help="a key of the study, dotted, and its values, e.g. 'limits.wheel_speed=5,10,20 rad/s' or "
        "'solvers.0.starts=4,12'; given again, all combinations",
    )
    parser.add_argument("--out", metavar="DIR", help="where to write (default: reports/<file stem>-sweep/)")
    parser.add_argument("--reports", action="store_true", help="write the report of every point as well")


def _run(options: argparse.Namespace) -> int:
    from oed.console import print_sweep, progress
    from oed.files import inside
    from oed.messages import print_json, say, tell
    from oed.record import load_record
    from oed.report import write_report, write_sweep
    from oed.sweep import parse_axis, sweep

    out = Path(options.out) if options.out else Path("reports") / f"{Path(options.study).stem}-sweep"
    axes = [parse_axis(text) for text in options.over]
    workers = workers_of(options)
    with progress(options.quiet) as listener:
        data = sweep(options.study, axes, out, seed=options.seed, workers=workers, progress=listener)
        if options.reports:
            folders = [inside(out, row["folder"]) for row in data["points"] if row["record"] is not None]
            listener.begin("reports", len(folders))
            for folder in folders:
                write_report(load_record(folder), folder)
                listener.advance()
    page = write_sweep(data, out)
    if data["kept"]:
        say(f"note: {data['kept']} of {len(data['points'])} points kept as they were found in {out}")
    if options.json:
        print_json({**data, "directory": str(out)})
    else:
        print_sweep(data)
        tell(f"report: {page}")
    if data["interrupted"]:
        say("interrupted: the same command goes on where this one stopped")
    found = any(row["objective"] is not None for row in data["points"])
    return DONE if found and not data["interrupted"] else FAILED


SWEEP = Command(
    "sweep", "run a study at every combination of values; compare them on one page", _run, _arguments
)

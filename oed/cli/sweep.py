"""`oed sweep`: a grid of studies, and one page that compares them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from oed.cli.terminal.arguments import add_working, workers_of
from oed.cli.terminal.command import DONE, FAILED, Command, cut_short, noted, place, reported, saved

if TYPE_CHECKING:
    from oed.optimize import Progress
    from oed.records.stored.sweep import StoredSweep


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
    from oed.cli.terminal.console import print_sweep, progress
    from oed.cli.terminal.messages import print_json, say, tell
    from oed.workflow.sweep import parse_axis, sweep

    out = Path(options.out) if options.out else Path("reports") / f"{Path(options.study).stem}-sweep"
    axes = [parse_axis(text) for text in options.over]
    workers = workers_of(options)
    with progress(options.quiet) as listener:
        more = {"seed": options.seed, "workers": workers, "progress": listener}
        done, trouble = saved(lambda: sweep(options.study, axes, out, **more))
        found = done.found
        page, unwritten = None, None
        if done.folder is not None and not found.interrupted:
            folders = [one.folder for one in found.points if options.reports and one.record]
            page, unwritten = reported(lambda: _pages(found, out, folders, listener), out)
    if found.kept:
        say(f"note: {found.kept} of {len(found.points)} points kept as they were found in {out}")
    if options.json:
        print_json({**done.data, **place(done.folder, trouble or unwritten)})
    else:
        print_sweep(found)
        if page is not None:
            tell(f"report: {page}")
    noted((), trouble or unwritten)
    if found.interrupted and trouble is None:
        say(f"{cut_short(done.folder, out)}; the same command goes on where this one stopped")
    any_drive = any(one.objective is not None for one in found.points)
    return DONE if any_drive and not (found.interrupted or trouble or unwritten) else FAILED


def _pages(found: StoredSweep, out: Path, folders: Sequence[str], listener: Progress) -> Path:
    # That of the sweep last: it links to those of its points.
    from oed.foundation.files import inside
    from oed.records.record import load_record
    from oed.report import write_report, write_sweep

    if folders:
        listener.begin("reports", len(folders))
    for folder in (inside(out, name) for name in folders):
        write_report(load_record(folder), folder)
        listener.advance()
    return write_sweep(found, out)


SWEEP = Command(
    "sweep", "run a study at every combination of values; compare them on one page", _run, _arguments
)

"""Commands that search for drives: `oed solve`, `run` and `sweep`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from oed.cli.terminal.arguments import add_working, workers_of
from oed.cli.terminal.command import DONE, FAILED, Command, cut_short, noted, place, reported, saved, verdict
from oed.cli.terminal.messages import print_json, say, tell

if TYPE_CHECKING:
    from oed.optimize import Progress
    from oed.records.stored.sweep import StoredSweep


def _solve_arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument("--out", metavar="DIR", help="where to write the record and the trajectories")


def _solve(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_results, progress
    from oed.workflow.runner import run
    from oed.workflow.studies import load_study

    study = load_study(options.study)
    workers = workers_of(options)
    out = Path(options.out) if options.out else None
    with progress(options.quiet) as listener:
        more = {"seed": options.seed, "workers": workers, "progress": listener}
        record, trouble = saved(lambda: run(study, out, search_only=True, **more))
    if options.json:
        kept = ("format", "oed_version", "seed", "parameters", "results")
        where = {} if out is None else place(record.folder, trouble)
        print_json({**{key: record.data[key] for key in kept}, **where})
    else:
        print_results(record.results, record.robustness)
    noted((), trouble)
    if record.interrupted and trouble is None:
        say(cut_short(record.folder, out))
    return FAILED if trouble else verdict(record)


SOLVE = Command(
    "solve", "search for the best drive; write nothing unless --out is given", _solve, _solve_arguments
)


def _run_arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument("--out", metavar="DIR", help="where to write (default: reports/<file stem>/)")


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_certificate, print_results, progress
    from oed.report import write_report
    from oed.workflow.runner import run
    from oed.workflow.studies import load_study

    out = Path(options.out) if options.out else Path("reports") / Path(options.study).stem
    study = load_study(options.study)
    workers = workers_of(options)
    with progress(options.quiet) as listener:
        record, trouble = saved(
            lambda: run(study, out, seed=options.seed, workers=workers, progress=listener)
        )
    page, unwritten, interrupted = None, None, record.interrupted
    # Whoever interrupts waits for nothing that can be made later.
    if record.folder is not None and not interrupted:
        page, unwritten = reported(lambda: write_report(record, out), out)
    if options.json:
        print_json({**record.data, **place(record.folder, trouble or unwritten)})
    else:
        print_results(record.results, record.robustness)
        if record.certificate is not None:
            print_certificate(record.certificate)
        if page is not None:
            tell(f"report: {page}")
    noted(record.notes, trouble or unwritten)
    if interrupted and trouble is None:
        say(cut_short(record.folder, out))
    return FAILED if trouble or unwritten else verdict(record)


RUN = Command("run", "do everything a study asks for; write the record and the report", _run, _run_arguments)


def _sweep_arguments(parser: argparse.ArgumentParser) -> None:
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


def _sweep(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_sweep, progress
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
    "sweep", "run a study at every combination of values; compare them on one page", _sweep, _sweep_arguments
)

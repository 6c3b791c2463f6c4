"""Commands that search for drives: `oed solve`, `run` and `sweep`."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oed.cli.terminal.arguments import add_working, aim, durations, workers_of
from oed.cli.terminal.command import DONE, FAILED, Command, CommandResult, saved, verdict
from oed.cli.terminal.messages import say, tell
from oed.foundation.shown import shown

if TYPE_CHECKING:
    from oed.optimize import Progress
    from oed.records.record import Record
    from oed.records.stored.sweep import StoredSweep

LATER = ("oed.optimize.local", "oed.report.figures.draw")
"""Modules that the processes of a run need, and that take long to load."""
GOES_ON = "; the same command goes on where this one stopped"
"""What is to be known of an interrupted sweep."""


def _searched(
    options: argparse.Namespace, out: Path | None, later: Sequence[str] = (), **more: Any
) -> tuple[Record, CommandResult]:
    # A run of the study with these options, and where it is; processes load what they need `later` meanwhile.
    from oed.cli.terminal.console import progress
    from oed.foundation.vocabulary import speak
    from oed.foundation.work.parallel import default_workers, load_ahead
    from oed.workflow.runner import run
    from oed.workflow.studies import load_study

    study = load_study(options.study)
    speak(study.file.vocabulary)
    workers = workers_of(options) or default_workers()
    if later:
        load_ahead(workers, later)
    more |= {"seed": options.seed, "workers": workers}
    with progress(options.quiet) as listener:
        record, trouble = saved(lambda: run(study, out, progress=listener, **more))
    return record, CommandResult(record.folder, out, trouble, record.interrupted)


def _found(options: argparse.Namespace, record: Record, outcome: CommandResult) -> None:
    # The answer, or why there is none, and what went wrong; the numbers behind it for those who ask, and
    # where a run was not finished or saved.
    from oed.cli.terminal import console
    from oed.report.answer import answer_of
    from oed.report.refusal import refusal_of

    answer = answer_of(record)
    if answer is not None:
        console.print_answer(answer)
    else:
        console.print_lines(refusal_of(record))
    if options.verbose or outcome.trouble is not None or outcome.interrupted:
        console.print_results(record.results, record.robustness, record.study.limit_units)
        if record.certificate is not None:
            console.print_certificate(record.certificate)
    elif answer is not None:
        # What was searched for comparison only, without back-off, is to be infeasible.
        asked = {one.label for one in record.study.solvers}
        failed = [one for one in record.results if one.name in asked and not one.feasible]
        console.print_messages(failed, units=record.study.limit_units)


def _add_search(parser: argparse.ArgumentParser, where: str) -> None:
    # What every search is asked for; `where` it is written.
    add_working(parser)
    parser.add_argument(
        "--verbose", action="store_true", help="print objectives, every result, violations and bounds too"
    )
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument("--out", metavar="DIR", help=where)


def _solve_arguments(parser: argparse.ArgumentParser) -> None:
    _add_search(parser, "where to write the record and the trajectories")


def _solve(options: argparse.Namespace) -> int:
    out = Path(options.out) if options.out else None
    record, outcome = _searched(options, out, search_only=True)
    kept = ("format", "oed_version", "seed", "parameters", "results", "departures")
    plain = record.plain()
    data = {key: plain[key] for key in kept} | ({} if out is None else outcome.place)
    outcome.show(options, data, lambda: _found(options, record, outcome), record.failures)
    return FAILED if outcome.trouble else verdict(record)


SOLVE = Command(
    "solve", "search for the best design; write nothing unless --out is given", _solve, _solve_arguments
)


def _run_arguments(parser: argparse.ArgumentParser) -> None:
    _add_search(parser, "where to write (default: reports/<file stem>/)")


def _run(options: argparse.Namespace) -> int:
    from oed.report import write_report
    from oed.workflow.runner import CUT_SHORT

    out = Path(options.out) if options.out else Path("reports") / Path(options.study).stem
    record, outcome = _searched(options, out, LATER)
    outcome.report(lambda: write_report(record, out))

    notes = [*record.failures, *(note for note in record.notes if note != CUT_SHORT)]
    exports = [
        shlex.join(["oed", "export", str(out), "--to", kind])
        for kind in ("ros2_node", "rosbag2")[record.pushed :]
    ]
    leads = ("Drive:", "   or:")
    found = [f"{lead} {one}" for lead, one in zip(leads, exports, strict=False)]
    drives = record.best is not None and record.study.domain == "robots"
    further = found if drives else []
    outcome.show(
        options, {**record.plain(), **outcome.place}, lambda: _found(options, record, outcome), notes, further
    )
    return FAILED if outcome.trouble else verdict(record)


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
        outcome = CommandResult(done.folder, out, trouble, found.interrupted, GOES_ON)
        folders = [one.folder for one in found.points if options.reports and one.record]
        outcome.report(lambda: _pages(found, out, folders, listener))
    if found.kept:
        say(f"note: {found.kept} of {len(found.points)} points kept as they were found in {out}")
    outcome.show(options, {**done.data, **outcome.place}, lambda: print_sweep(found))
    any_drive = any(one.objective is not None for one in found.points)
    return DONE if any_drive and not (found.interrupted or outcome.trouble) else FAILED


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


def _plan_arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument(
        "--to",
        metavar="'PARAMETER SIZE'",
        type=aim,
        action="append",
        required=True,
        help="standard error wanted, e.g. 'track 0.1 %%' or 'wheel radius 0.05 mm'; may be given again",
    )
    parser.add_argument(
        "--durations",
        metavar="'T1,T2,... [UNIT]'",
        type=durations,
        default=(),
        help="of one drive, to be tried beside the study's, e.g. '10,40 s' (default: half and twice that)",
    )
    parser.add_argument("--out", metavar="DIR", help="where to write (default: reports/<file stem>-plan/)")


def _plan(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import progress
    from oed.report import write_plan
    from oed.workflow.plan import plan

    out = Path(options.out) if options.out else Path("reports") / f"{Path(options.study).stem}-plan"
    more = {"durations": options.durations, "seed": options.seed, "workers": workers_of(options)}
    with progress(options.quiet) as listener:
        done = plan(options.study, dict(options.to), out, progress=listener, **more)
    found = done.found
    outcome = CommandResult(done.folder, out, None, found.interrupted, GOES_ON)
    outcome.report(lambda: write_plan(found, out))
    outcome.show(options, {**done.data, **outcome.place}, lambda: tell(shown(found.answer)))
    answered = found.one_drive is not None or found.drives is not None
    return DONE if answered and not (found.interrupted or outcome.trouble) else FAILED


PLAN = Command("plan", "how long, or how many drives, for a wanted precision", _plan, _plan_arguments)

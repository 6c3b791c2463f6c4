"""Commands on logs of drives: `oed estimate` and `next`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from oed.cli.terminal.arguments import (
    add_quiet,
    add_trust,
    add_working,
    duration,
    pair,
    part,
    share,
    whole,
    workers_of,
)
from oed.cli.terminal.command import DONE, FAILED, Command, CommandResult, saved, verdict

if TYPE_CHECKING:
    from oed.workflow.next_drive import NextDrive


def _estimate_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument("logs", metavar="LOG", nargs="+", help="as the study's key `log` says")
    parser.add_argument(
        "--apart",
        metavar="LOG",
        nargs="+",
        action="extend",
        default=[],
        help="test logs, which nothing is estimated from: dead reckoning is tried on them",
    )
    parser.add_argument(
        "--hold-out",
        metavar="SHARE",
        type=part,
        default=0.0,
        help="the last part of every log is a test log, too, e.g. '25 %%' of its duration",
    )
    parser.add_argument("--out", metavar="DIR", help="where to write (default: reports/<file stem>/)")
    parser.add_argument("--seed", type=whole, help="seed of the bootstrap, instead of the study's")
    add_quiet(parser)


def _estimate(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_estimate, progress
    from oed.report import write_estimate
    from oed.workflow.estimate_logs import estimate
    from oed.workflow.studies import load_study

    out = Path(options.out) if options.out else Path("reports") / Path(options.study).stem
    study = load_study(options.study)
    more = {"apart": options.apart, "hold_out": options.hold_out, "out": out, "seed": options.seed}
    with progress(options.quiet) as listener:
        record, trouble = saved(lambda: estimate(study, options.logs, progress=listener, **more))
    outcome = CommandResult(None if trouble else out, out, trouble)
    outcome.report(lambda: write_estimate(record, out))
    outcome.show(options, {**record.plain(), **outcome.place}, lambda: print_estimate(record))
    return FAILED if outcome.trouble else DONE


ESTIMATE = Command(
    "estimate", "estimate a robot's parameters from logs of its drives", _estimate, _estimate_arguments
)


def _next_arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("folder", metavar="DIR", help="the record of the design that was driven")
    parser.add_argument("logs", metavar="LOG", nargs="+", help="of the drives since, all together")
    parser.add_argument(
        "--target",
        metavar="PARAMETER=SIZE",
        type=pair,
        action="append",
        default=[],
        help="standard error wanted, e.g. 'track=0.2 mm' or 'track=0.1 %%'; may be given again",
    )
    parser.add_argument(
        "--least-gain",
        type=share,
        help="share of the worst standard error that another drive has to take away (default: 0.05)",
    )
    parser.add_argument(
        "--duration", type=duration, help="of the next drive, e.g. '20 s' (default: that of the last)"
    )
    parser.add_argument("--out", metavar="DIR", help="where to write (default: DIR/next/)")
    add_trust(parser)


def _next(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_next, progress
    from oed.foundation.files import inside
    from oed.records.record import load_record
    from oed.report.film.animation import folder_of
    from oed.workflow.next_drive import LEAST_GAIN, next_drive

    out = Path(options.out) if options.out else inside(folder_of(options.folder), "next")
    workers = workers_of(options)
    more = {
        "targets": dict(options.target),
        "duration": options.duration,
        "least_gain": LEAST_GAIN if options.least_gain is None else options.least_gain,
        "out": out,
        "seed": options.seed,
        "workers": workers,
        "trust": options.trust,
    }
    with progress(options.quiet) as listener:
        before = load_record(options.folder)
        found, trouble = saved(lambda: next_drive(before, options.logs, progress=listener, **more))
    interrupted = found.record is not None and found.record.interrupted
    outcome = CommandResult(found.folder, out, trouble, interrupted)
    outcome.report(lambda: _pages(found, out))
    outcome.show(options, {**found.data, **outcome.place}, lambda: print_next(found))
    if outcome.trouble:
        return FAILED
    return DONE if found.record is None else verdict(found.record)


def _pages(found: NextDrive, out: Path) -> Path:
    from oed.report import write_estimate, write_report

    estimated = write_estimate(found.estimate, out)
    return estimated if found.record is None else write_report(found.record, out)


NEXT = Command(
    "next",
    "estimate from logs of a saved design, and design the drive that adds most",
    _next,
    _next_arguments,
)

"""`oed next`: the drive that adds most to what logs have told."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.commands.arguments import add_trust, add_working, duration, pair, share, workers_of
from oed.commands.command import DONE, Command, saved_in, verdict


def _arguments(parser: argparse.ArgumentParser) -> None:
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


def _run(options: argparse.Namespace) -> int:
    from oed.console import print_next, progress
    from oed.files import inside
    from oed.messages import print_json, tell
    from oed.next_drive import LEAST_GAIN, next_drive
    from oed.record import load_record
    from oed.report import write_estimate, write_report
    from oed.report.animation import folder_of

    out = Path(options.out) if options.out else inside(folder_of(options.folder), "next")
    workers = workers_of(options)
    with progress(options.quiet) as listener:
        found = next_drive(
            load_record(options.folder),
            options.logs,
            targets=dict(options.target),
            duration=options.duration,
            least_gain=LEAST_GAIN if options.least_gain is None else options.least_gain,
            out=out,
            seed=options.seed,
            workers=workers,
            progress=listener,
            trust=options.trust,
        )
    with saved_in(out):
        write_estimate(found.estimate.data, out)
        page = None if found.record is None else write_report(found.record, out)
    if options.json:
        print_json({**found.data, "directory": str(out)})
    else:
        print_next(found.data)
        if page is not None:
            tell(f"report: {page}")
    return DONE if found.record is None else verdict(found.record)


NEXT = Command(
    "next", "estimate from logs of a saved design, and design the drive that adds most", _run, _arguments
)

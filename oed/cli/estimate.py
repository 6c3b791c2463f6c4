"""`oed estimate`: a robot's parameters from logs."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.cli.terminal.arguments import add_quiet, whole
from oed.cli.terminal.command import DONE, FAILED, Command, noted, place, reported, saved


def _arguments(parser: argparse.ArgumentParser) -> None:
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
    parser.add_argument("--out", metavar="DIR", help="where to write (default: reports/<file stem>/)")
    parser.add_argument("--seed", type=whole, help="seed of the bootstrap, instead of the study's")
    add_quiet(parser)


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_estimate, progress
    from oed.cli.terminal.messages import print_json, tell
    from oed.report import write_estimate
    from oed.workflow.estimate_logs import estimate
    from oed.workflow.studies import load_study

    out = Path(options.out) if options.out else Path("reports") / Path(options.study).stem
    study = load_study(options.study)
    more = {"apart": options.apart, "out": out, "seed": options.seed}
    with progress(options.quiet) as listener:
        record, trouble = saved(lambda: estimate(study, options.logs, progress=listener, **more))
    page, unwritten = None, None
    if trouble is None:
        page, unwritten = reported(lambda: write_estimate(record, out), out)
    if options.json:
        print_json({**record.plain(), **place(None if trouble else out, trouble or unwritten)})
    else:
        print_estimate(record)
        if page is not None:
            tell(f"report: {page}")
    noted((), trouble or unwritten)
    return FAILED if trouble or unwritten else DONE


ESTIMATE = Command("estimate", "estimate a robot's parameters from logs of its drives", _run, _arguments)

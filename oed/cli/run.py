"""`oed run`: everything a study asks for."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.cli.terminal.arguments import add_working, workers_of
from oed.cli.terminal.command import FAILED, Command, cut_short, noted, place, reported, saved, verdict


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument("--out", metavar="DIR", help="where to write (default: reports/<file stem>/)")


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_certificate, print_results, progress
    from oed.cli.terminal.messages import print_json, say, tell
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
        print_json({**record.plain(), **place(record.folder, trouble or unwritten)})
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


RUN = Command("run", "do everything a study asks for; write the record and the report", _run, _arguments)

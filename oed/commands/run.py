"""`oed run`: everything a study asks for."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.commands.arguments import add_working, workers_of
from oed.commands.command import Command, saved_in, verdict


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument("--out", metavar="DIR", help="where to write (default: reports/<file stem>/)")


def _run(options: argparse.Namespace) -> int:
    from oed.console import print_certificate, print_results, progress
    from oed.messages import print_json, say, tell
    from oed.report import write_report
    from oed.runner import run
    from oed.shown import shown
    from oed.study import load_study

    out = Path(options.out) if options.out else Path("reports") / Path(options.study).stem
    study = load_study(options.study)
    workers = workers_of(options)
    with progress(options.quiet) as listener:
        record = run(study, out, seed=options.seed, workers=workers, progress=listener)
    with saved_in(out):
        page = write_report(record, out)
    if options.json:
        print_json({**record.data, "directory": str(out)})
    else:
        print_results(record.results, record.data["robustness"])
        if record.data["certificate"] is not None:
            print_certificate(record.data["certificate"])
        tell(f"report: {page}")
    for note in record.data["notes"]:
        say(shown(f"note: {note}"))
    return verdict(record)


RUN = Command("run", "do everything a study asks for; write the record and the report", _run, _arguments)

"""`oed solve`: searches, and nothing else."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.cli.terminal.arguments import add_working, workers_of
from oed.cli.terminal.command import FAILED, Command, cut_short, noted, place, saved, verdict


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument("--out", metavar="DIR", help="where to write the record and the trajectories")


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_results, progress
    from oed.cli.terminal.messages import print_json, say
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
        plain = record.plain()
        print_json({**{key: plain[key] for key in kept}, **where})
    else:
        print_results(record.results, record.robustness)
    noted((), trouble)
    if record.interrupted and trouble is None:
        say(cut_short(record.folder, out))
    return FAILED if trouble else verdict(record)


SOLVE = Command("solve", "search for the best drive; write nothing unless --out is given", _run, _arguments)

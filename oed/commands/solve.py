"""`oed solve`: searches, and nothing else."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.commands.arguments import add_working, workers_of
from oed.commands.command import Command, verdict


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument("--out", metavar="DIR", help="where to write the record and the trajectories")


def _run(options: argparse.Namespace) -> int:
    from oed.console import print_results, progress
    from oed.messages import print_json
    from oed.runner import record as record_of
    from oed.runner import search
    from oed.study import load_study

    study = load_study(options.study)
    seed = study.seed if options.seed is None else options.seed
    workers = workers_of(options)
    with progress(options.quiet) as listener:
        solutions, interrupted = search(study, seed=seed, workers=workers, progress=listener)
    out = Path(options.out) if options.out else None
    record = record_of(study, solutions, seed, out, interrupted=interrupted)
    if options.json:
        kept = ("format", "oed_version", "seed", "parameters", "results")
        print_json({key: record.data[key] for key in kept})
    else:
        print_results(record.results, record.data["robustness"])
    return verdict(record)


SOLVE = Command("solve", "search for the best drive; write nothing unless --out is given", _run, _arguments)

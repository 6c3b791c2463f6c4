"""`oed bound`: how good any drive could be at most."""

from __future__ import annotations

import argparse

from oed.cli.terminal.arguments import positive, seconds
from oed.cli.terminal.command import DONE, Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument(
        "--nodes",
        type=positive,
        help="of the search for the bound at most (default: as many as take some seconds)",
    )
    parser.add_argument(
        "--time-limit",
        type=seconds,
        help="of that search [s] (default: none, for the same certificate on every machine)",
    )


def _run(options: argparse.Namespace) -> int:
    from oed.bounds import LATTICE, bound
    from oed.cli.terminal.console import print_certificate
    from oed.cli.terminal.messages import print_json
    from oed.foundation.errors import Failure
    from oed.kernel.solution import scored
    from oed.workflow.runner import certified
    from oed.workflow.studies import load_study

    study = load_study(options.study)
    certificate = bound(study.problem, nodes=options.nodes, time_limit=options.time_limit)
    drives = [] if certificate.drive is None else [scored(study.problem, certificate.drive, LATTICE)]
    found = certified(study, certificate, drives)
    if found is None:
        raise Failure(f"{options.study}: {certificate.method}")
    if options.json:
        print_json(found.plain())
    else:
        print_certificate(found)
    return DONE


BOUND = Command("bound", "prove how good any drive could be at most; solve nothing", _run, _arguments)

"""`oed evaluate`: what a path or the log of a drive is worth."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.cli.terminal.command import DONE, Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument(
        "path", metavar="PATH", help="a trajectory CSV, or a log as the study's key `log` says"
    )
    parser.add_argument(
        "--designs", metavar="DIR", help="a record to compare with (default: reports/<file stem>/, if there)"
    )


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_results, print_worth
    from oed.cli.terminal.messages import print_json, say
    from oed.workflow.driven import score_path
    from oed.workflow.studies import load_study

    study = load_study(options.study)
    designs = options.designs or Path("reports") / Path(options.study).stem
    found = score_path(study, options.path, designs)
    if options.json:
        print_json(found.data)
    else:
        print_results([one.result for one in found.paths], found.robustness)
        print_worth(found)
    for name, one in found.findings:
        say(f"{name}: {one.message}")
    return DONE


EVALUATE = Command(
    "evaluate", "score a path (CSV) or the log of a drive with a study's problem", _run, _arguments
)

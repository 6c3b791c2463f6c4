"""`oed validate`: whether drives keep their promise."""

from __future__ import annotations

import argparse

from oed.commands.arguments import add_quiet, add_trust, add_workers, positive, whole, workers_of
from oed.commands.command import DONE, Command, saved_in


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", metavar="DIR")
    parser.add_argument("--replicates", type=positive, help="simulated experiments (default: the study's)")
    parser.add_argument(
        "--heading",
        choices=("known", "predicted", "measured"),
        help="which headings the estimator uses (default: the study's)",
    )
    parser.add_argument(
        "--estimator",
        action="append",
        choices=("ols", "sandwich", "gls", "errors_in_variables", "nonlinear"),
        help="what estimates and promises; may be given again (default: the study's)",
    )
    add_workers(parser)
    parser.add_argument("--seed", type=whole, help="seed of the noise (default: the record's)")
    add_trust(parser)
    add_quiet(parser)


def _run(options: argparse.Namespace) -> int:
    from oed.console import progress
    from oed.experiments import validated, validation_options
    from oed.messages import print_json, tell
    from oed.record import load_record, save_record
    from oed.report import write_report
    from oed.shown import shown

    saved = load_record(options.folder)
    chosen = validation_options(
        saved, replicates=options.replicates, estimators=options.estimator, heading=options.heading
    )
    workers = workers_of(options)
    with progress(options.quiet) as listener:
        record = validated(
            saved, chosen, seed=options.seed, workers=workers, progress=listener, trust=options.trust
        )
    save_record(record, options.folder)
    with saved_in(options.folder):
        page = write_report(record, options.folder)
    if options.json:
        print_json(record.data["validation"])
    else:
        for entry in record.data["validation"]["results"]:
            tell(shown(f"{entry['name']}, {entry['estimator']}: {entry['verdict']}"))
        tell(f"report: {page}")
    return DONE


VALIDATE = Command("validate", "simulate a saved record's drives; update record and report", _run, _arguments)

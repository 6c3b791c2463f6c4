"""`oed validate`: whether drives are as precise as predicted."""

from __future__ import annotations

import argparse

from oed.cli.terminal.arguments import add_quiet, add_trust, add_workers, positive, whole, workers_of
from oed.cli.terminal.command import DONE, FAILED, Command, noted, reported, saved


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
        help="what estimates and predicts the covariance; may be given again (default: the study's)",
    )
    add_workers(parser)
    parser.add_argument("--seed", type=whole, help="seed of the noise (default: the record's)")
    add_trust(parser)
    add_quiet(parser)


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import progress
    from oed.cli.terminal.messages import print_json, tell
    from oed.foundation.shown import shown
    from oed.foundation.work.folders import drafted
    from oed.records.record import load_record
    from oed.report import write_report
    from oed.report.film.animation import folder_of
    from oed.workflow.experiments import validated, validation_options
    from oed.workflow.saving import save_into

    workers = workers_of(options)
    with drafted(folder_of(options.folder)) as draft:
        before = load_record(options.folder)
        chosen = validation_options(
            before, replicates=options.replicates, estimators=options.estimator, heading=options.heading
        )
        with progress(options.quiet) as listener:
            record = validated(
                before, chosen, seed=options.seed, workers=workers, progress=listener, trust=options.trust
            )
        record, trouble = saved(lambda: save_into(draft, record))
    page, unwritten = None, None
    if record.folder is not None:
        page, unwritten = reported(lambda: write_report(record, draft.target), draft.target)
    found = record.validation
    assert found is not None
    if options.json:
        print_json(found.plain())
    else:
        for one in found.results:
            tell(shown(f"{one.name}, {one.estimator}: {one.verdict}"))
        if page is not None:
            tell(f"report: {page}")
    noted((), trouble or unwritten)
    return FAILED if trouble or unwritten else DONE


VALIDATE = Command("validate", "simulate a saved record's drives; update record and report", _run, _arguments)

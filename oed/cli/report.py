"""`oed report`: the pages again."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.cli.terminal.command import DONE, Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folders", metavar="DIR", nargs="+")
    parser.add_argument("--out", metavar="DIR", help="where a comparison goes (default: reports/comparison/)")


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.messages import print_json, tell
    from oed.foundation.work.folders import in_order
    from oed.records.record import ESTIMATE_FILE as ESTIMATE
    from oed.records.record import FILE, load_estimate, load_record
    from oed.report import write_comparison, write_estimate, write_report, write_sweep
    from oed.workflow.sweep import FILE as SWEEP
    from oed.workflow.sweep import load_sweep

    first = in_order(options.folders[0])
    estimated = len(options.folders) == 1 and (first / ESTIMATE).is_file()
    if estimated:
        page = write_estimate(load_estimate(first), options.out or first)
    swept = len(options.folders) == 1 and (first / SWEEP).is_file()
    if swept:
        page = write_sweep(load_sweep(first), first, options.out or first)
    elif not estimated or (first / FILE).is_file():
        records = [(folder, load_record(folder)) for folder in options.folders]
        if len(records) == 1:
            page = write_report(records[0][1], options.out or first)
        else:
            names = [Path(folder).resolve().name for folder in options.folders]
            labels = names if len(set(names)) == len(names) else options.folders
            named = list(zip(labels, (record for _, record in records), strict=True))
            page = write_comparison(named, options.out or Path("reports") / "comparison")
    if options.json:
        print_json({"report": str(page)})
    else:
        tell(f"report: {page}")
    return DONE


REPORT = Command(
    "report", "make the report again from a saved record; several are compared", _run, _arguments
)

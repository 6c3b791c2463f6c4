"""The command line: parse, call, map errors to exit codes. It computes nothing.

Exit codes: 0 done, 1 failed (no feasible design, interrupted), 2 the user's mistake.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oed.record import Record

DONE, FAILED, MISTAKE = 0, 1, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    options = _parser().parse_args(arguments)
    if options.command is None:
        _parser().print_help()
        return MISTAKE
    from oed.errors import FileError, OedError, UserMistake

    command: Callable[[argparse.Namespace], int] = options.run
    try:
        return command(options)
    except OedError as error:
        flaws = error.flaws if isinstance(error, FileError) else ()
        mistake = isinstance(error, UserMistake)
        _report_error(options, str(error), [vars(flaw) for flaw in flaws])
        return MISTAKE if mistake else FAILED
    except SystemError as error:
        # What CasADi's wrappers make of Ctrl-C in the middle of a call.
        if not isinstance(error.__cause__ or error.__context__, KeyboardInterrupt):
            raise
        _report_error(options, "interrupted", [])
        return FAILED
    except KeyboardInterrupt:
        _report_error(options, "interrupted", [])
        return FAILED
    except BrokenPipeError:
        # The reader of our output has left (`oed ... | head`): nothing more to say.
        sys.stderr.close()
        return DONE


def _report_error(options: argparse.Namespace, message: str, flaws: list[dict[str, Any]]) -> None:
    from oed.console import print_json, say

    say(message)
    if options.json:
        print_json({"error": message, "flaws": flaws})


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="oed",
        description="Design the drive that makes a robot's kinematic parameters best estimable.",
    )
    parser.add_argument("--version", action=_ShowVersion, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--json", action="store_true", help="one JSON object on stdout, all else on stderr")
    working = argparse.ArgumentParser(add_help=False)
    working.add_argument("--seed", type=_whole, help="seed of every random draw, instead of the study's")
    working.add_argument("--workers", type=_positive, help="processes (default: one per processor)")
    working.add_argument("--quiet", action="store_true", help="show no progress")

    def add(name: str, run: Callable[[argparse.Namespace], int], text: str, *parents: Any) -> Any:
        command = commands.add_parser(name, help=text, description=text, parents=[common, *parents])
        command.set_defaults(run=run)
        return command

    command = add("init", _init, "write a first study for a robot, a room and a sensor")
    command.add_argument("file", metavar="STUDY", nargs="?", help="what to write (default: ROBOT.yaml)")
    command.add_argument("--robot", help="a preset or a kind of robot; asked for where not given")
    command.add_argument("--room", help="like '4 m x 3 m' or 'circle 2 m'")
    command.add_argument("--sensor", help="poses, positions, ranges or displacements")
    command.add_argument(
        "--size",
        metavar="KEY=VALUE",
        type=_pair,
        action="append",
        default=[],
        help="a constant of the robot, e.g. 'track=18 cm'; may be given again",
    )
    command.add_argument("--duration", help="of one run, e.g. '20 s'")
    command.add_argument("--runs", type=_positive, default=1, help="separate drives designed together")
    command.add_argument("--force", action="store_true", help="write over a file that exists")
    command = add("run", _run, "do everything a study asks for; write the record and the report", working)
    command.add_argument("study", metavar="STUDY")
    command.add_argument("--out", metavar="DIR", help="where to write (default: reports/<file stem>/)")
    command = add("check", _check, "read and cross-check studies; solve nothing")
    command.add_argument("studies", metavar="STUDY", nargs="+")
    command = add("solve", _solve, "search for the best drive; write nothing unless --out is given", working)
    command.add_argument("study", metavar="STUDY")
    command.add_argument("--out", metavar="DIR", help="where to write the record and the trajectories")
    command = add("bound", _bound, "prove how good any drive could be at most; solve nothing")
    command.add_argument("study", metavar="STUDY")
    command.add_argument("--time-limit", type=_seconds, help="of the search for the bound [s] (default: 5)")
    command = add("evaluate", _evaluate, "score a path (CSV) or the log of a drive with a study's problem")
    command.add_argument("study", metavar="STUDY")
    command.add_argument(
        "path", metavar="PATH", help="a trajectory CSV, or a log as the study's key `log` says"
    )
    command.add_argument(
        "--designs", metavar="DIR", help="a record to compare with (default: reports/<file stem>/, if there)"
    )
    command = add("estimate", _estimate, "estimate a robot's parameters from logs of its drives")
    command.add_argument("study", metavar="STUDY")
    command.add_argument("logs", metavar="LOG", nargs="+", help="as the study's key `log` says")
    command.add_argument(
        "--apart",
        metavar="LOG",
        nargs="+",
        action="extend",
        default=[],
        help="logs that are kept apart: dead reckoning is tried on them",
    )
    command.add_argument("--out", metavar="DIR", help="where to write (default: reports/<file stem>/)")
    command.add_argument("--seed", type=_whole, help="seed of the bootstrap, instead of the study's")
    command.add_argument("--quiet", action="store_true", help="show no progress")
    command = add(
        "next", _next, "estimate from logs of a saved design, and design the drive that adds most", working
    )
    command.add_argument("folder", metavar="DIR", help="the record of the design that was driven")
    command.add_argument("logs", metavar="LOG", nargs="+", help="of the drives since, all together")
    command.add_argument(
        "--target",
        metavar="PARAMETER=SIZE",
        type=_pair,
        action="append",
        default=[],
        help="standard error wanted, e.g. 'track=0.2 mm' or 'track=0.1 %%'; may be given again",
    )
    command.add_argument(
        "--least-gain",
        type=_share,
        help="share of the worst standard error that another drive has to take away (default: 0.05)",
    )
    command.add_argument("--out", metavar="DIR", help="where to write (default: DIR/next/)")
    command = add("report", _report, "make the report again from a saved record; several are compared")
    command.add_argument("folders", metavar="DIR", nargs="+")
    command.add_argument(
        "--out", metavar="DIR", help="where a comparison goes (default: reports/comparison/)"
    )
    command = add("validate", _validate, "simulate a saved record's drives; update record and report")
    command.add_argument("folder", metavar="DIR")
    command.add_argument("--replicates", type=_positive, help="simulated experiments (default: the study's)")
    command.add_argument(
        "--heading",
        choices=("known", "predicted", "measured"),
        help="which headings the estimator uses (default: the study's)",
    )
    command.add_argument(
        "--estimator",
        action="append",
        choices=("ols", "sandwich", "gls", "errors_in_variables", "nonlinear"),
        help="what estimates and promises; may be given again (default: the study's)",
    )
    command.add_argument("--workers", type=_positive, help="processes (default: one per processor)")
    command.add_argument("--seed", type=_whole, help="seed of the noise (default: the record's)")
    command.add_argument("--quiet", action="store_true", help="show no progress")
    command = add("export", _export, "write a result's drive for a robot, or the robot's parameters")
    command.add_argument("folder", metavar="DIR")
    command.add_argument("--to", required=True, metavar="FORMAT", help="csv, json, rosbag2 or ros2_yaml")
    command.add_argument("--result", help="name of the result (default: the best)")
    command.add_argument("--rate", type=float, help="of the commands [Hz] (default: the design's own)")
    command.add_argument("--out", metavar="PATH", help="what to write (default: in DIR)")
    command.add_argument("--storage", default="sqlite3", help="of a bag: sqlite3 (default) or mcap")
    command.add_argument("--force", action="store_true", help="replace a bag that exists")
    add("schema", _schema, "print the JSON schema of study files, for editors")
    return parser


class _ShowVersion(argparse.Action):
    """Print the version, looked up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        """Print it and leave."""
        from importlib.metadata import version

        print(f"oed {version('oed')}")
        parser.exit()


def _whole(text: str) -> int:
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"expected 0 or more, got {value}")
    return value


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected 1 or more, got {value}")
    return value


def _seconds(text: str) -> float:
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"expected more than 0 seconds, got {value:g}")
    return value


def _share(text: str) -> float:
    value = float(text)
    if not 0 <= value < 1:
        raise argparse.ArgumentTypeError(f"expected a share from 0 to 1, got {value:g}")
    return value


def _pair(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"expected KEY=VALUE, got {text!r}")
    return key.strip(), value.strip()


def _init(options: argparse.Namespace) -> int:
    from oed.console import choice_of, print_json, say
    from oed.errors import UserMistake
    from oed.files import write_text
    from oed.starter import starter

    choice = choice_of(options)
    file = Path(options.file or f"{choice.robot}.yaml")
    if file.exists() and not options.force:
        raise UserMistake(f"{file} exists; give another name, or --force to write over it")
    write_text(file, starter(choice))
    if options.json:
        print_json({"study": str(file)})
    else:
        say(f"wrote {file}; change what is yours, then: oed run {file}")
    return DONE


def _run(options: argparse.Namespace) -> int:
    from oed.console import print_certificate, print_json, print_results, progress, say
    from oed.report import write_report
    from oed.runner import run
    from oed.study import load_study

    out = Path(options.out) if options.out else Path("reports") / Path(options.study).stem
    study = load_study(options.study)
    with progress(options.quiet) as listener:
        record = run(study, out, seed=options.seed, workers=options.workers, progress=listener)
    page = write_report(record, out)
    if options.json:
        print_json({**record.data, "directory": str(out)})
    else:
        print_results(record.results)
        if record.data["certificate"] is not None:
            print_certificate(record.data["certificate"])
        print(f"report: {page}")
    for note in record.data["notes"]:
        say(f"note: {note}")
    return _verdict(record)


def _solve(options: argparse.Namespace) -> int:
    from oed.console import print_json, print_results, progress
    from oed.runner import record as record_of
    from oed.runner import search
    from oed.study import load_study

    study = load_study(options.study)
    seed = study.seed if options.seed is None else options.seed
    with progress(options.quiet) as listener:
        solutions, interrupted = search(study, seed=seed, workers=options.workers, progress=listener)
    out = Path(options.out) if options.out else None
    record = record_of(study, solutions, seed, out, interrupted=interrupted)
    if options.json:
        kept = ("format", "oed_version", "seed", "parameters", "results")
        print_json({key: record.data[key] for key in kept})
    else:
        print_results(record.results)
    return _verdict(record)


def _verdict(record: Record) -> int:
    # Searches fail one by one; a design anywhere is a design. An interrupted run is not a finished one.
    searched = [entry for entry in record.results if entry["kind"] not in ("baseline", "path")]
    found = any(entry["feasible"] for entry in searched or record.results)
    return DONE if found and not record.data["interrupted"] else FAILED


def _check(options: argparse.Namespace) -> int:
    from oed.console import print_json, say
    from oed.errors import FileError
    from oed.runner import own_paths
    from oed.study import load_study

    entries, flawed = [], False
    for file in options.studies:
        try:
            study = load_study(file)
            own_paths(study)
            study.require_identifiable()
        except FileError as error:
            flawed = True
            say(str(error))
            entries.append({"file": file, "ok": False, "flaws": [vars(flaw) for flaw in error.flaws]})
        else:
            entries.append({"file": file, "ok": True, "name": study.name, "flaws": []})
            if not options.json:
                print(f"{file}: ok ({study.name})")
    if options.json:
        print_json({"studies": entries})
    return MISTAKE if flawed else DONE


def _bound(options: argparse.Namespace) -> int:
    from oed.bounds import LATTICE, TIME_LIMIT, bound
    from oed.console import print_certificate, print_json
    from oed.errors import Failure
    from oed.runner import certified, score
    from oed.study import load_study

    study = load_study(options.study)
    certificate = bound(study.problem, time_limit=options.time_limit or TIME_LIMIT)
    drives = [] if certificate.drive is None else [score(study, certificate.drive, LATTICE)]
    found = certified(study, certificate, drives)
    if found is None:
        raise Failure(f"{options.study}: {certificate.method}")
    if options.json:
        print_json(found)
    else:
        print_certificate(found)
    return DONE


def _evaluate(options: argparse.Namespace) -> int:
    from oed.console import print_json, print_results, print_worth
    from oed.driven import score_path
    from oed.study import load_study

    study = load_study(options.study)
    designs = options.designs or Path("reports") / Path(options.study).stem
    found = score_path(study, options.path, designs)
    if options.json:
        print_json(found.data)
    else:
        print_results([one.entry for one in found.paths])
        print_worth(found)
    return DONE


def _estimate(options: argparse.Namespace) -> int:
    from oed.console import print_estimate, print_json, progress
    from oed.estimation import estimate
    from oed.report import write_estimate
    from oed.study import load_study

    out = Path(options.out) if options.out else Path("reports") / Path(options.study).stem
    study = load_study(options.study)
    with progress(options.quiet) as listener:
        record = estimate(
            study, options.logs, apart=options.apart, out=out, seed=options.seed, progress=listener
        )
    page = write_estimate(record.data, out)
    if options.json:
        print_json({**record.data, "directory": str(out)})
    else:
        print_estimate(record.data)
        print(f"report: {page}")
    return DONE


def _next(options: argparse.Namespace) -> int:
    from oed.console import print_json, print_next, progress
    from oed.next_drive import LEAST_GAIN, next_drive
    from oed.record import load_record
    from oed.report import write_estimate, write_report

    out = Path(options.out) if options.out else Path(options.folder) / "next"
    with progress(options.quiet) as listener:
        found = next_drive(
            load_record(options.folder),
            options.logs,
            targets=dict(options.target),
            least_gain=LEAST_GAIN if options.least_gain is None else options.least_gain,
            out=out,
            seed=options.seed,
            workers=options.workers,
            progress=listener,
        )
    write_estimate(found.estimate.data, out)
    page = None if found.record is None else write_report(found.record, out)
    if options.json:
        print_json({**found.data, "directory": str(out)})
    else:
        print_next(found.data)
        if page is not None:
            print(f"report: {page}")
    return DONE if found.record is None else _verdict(found.record)


def _report(options: argparse.Namespace) -> int:
    from oed.calibration_record import FILE as ESTIMATE
    from oed.calibration_record import load_estimate
    from oed.console import print_json
    from oed.record import FILE, load_record
    from oed.report import write_comparison, write_estimate, write_report

    first = Path(options.folders[0])
    estimated = len(options.folders) == 1 and (first / ESTIMATE).is_file()
    if estimated:
        page = write_estimate(load_estimate(first).data, options.out or first)
    if not estimated or (first / FILE).is_file():
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
        print(f"report: {page}")
    return DONE


def _validate(options: argparse.Namespace) -> int:
    from oed.console import print_json, progress
    from oed.record import load_record, save_record
    from oed.report import write_report
    from oed.runner import validated, validation_options

    saved = load_record(options.folder)
    chosen = validation_options(
        saved, replicates=options.replicates, estimators=options.estimator, heading=options.heading
    )
    with progress(options.quiet) as listener:
        record = validated(saved, chosen, seed=options.seed, workers=options.workers, progress=listener)
    save_record(record, options.folder)
    page = write_report(record, options.folder)
    if options.json:
        print_json(record.data["validation"])
    else:
        for entry in record.data["validation"]["results"]:
            print(f"{entry['name']}, {entry['estimator']}: {entry['verdict']}")
        print(f"report: {page}")
    return DONE


def _export(options: argparse.Namespace) -> int:
    from oed.console import print_json
    from oed.exporters import export

    path = export(
        options.folder,
        options.to,
        result=options.result,
        rate=options.rate,
        out=options.out,
        storage=options.storage,
        force=options.force,
    )
    if options.json:
        print_json({"export": str(path)})
    else:
        print(path)
    return DONE


def _schema(options: argparse.Namespace) -> int:
    from oed.console import print_json
    from oed.study import json_schema

    print_json(json_schema())
    return DONE


if __name__ == "__main__":
    sys.exit(main())

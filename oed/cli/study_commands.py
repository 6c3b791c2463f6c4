"""Commands on study files that solve nothing: `oed init`, `check`, `bound`, `evaluate` and `schema`."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from oed.cli.terminal.arguments import pair, positive, seconds
from oed.cli.terminal.command import DONE, MISTAKE, Command, answered
from oed.cli.terminal.messages import print_json, say, tell


def _init_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="STUDY", nargs="?", help="what to write (default: ROBOT.yaml)")
    parser.add_argument("--robot", help="a preset or a kind of robot; asked for where not given")
    parser.add_argument("--room", help="like '4 m x 3 m' or 'circle 2 m'")
    parser.add_argument(
        "--sensor",
        help="poses, positions, positions_and_yaw_rate, relative_poses, ranges, landmarks or displacements",
    )
    parser.add_argument(
        "--noise",
        metavar="KEY=VALUE",
        type=pair,
        action="append",
        default=[],
        help="standard deviation of the sensor's readings, e.g. 'position=5 mm'; may be given again",
    )
    parser.add_argument(
        "--size",
        metavar="KEY=VALUE",
        type=pair,
        action="append",
        default=[],
        help="a constant of the robot, e.g. 'track=18 cm'; may be given again",
    )
    parser.add_argument(
        "--only-estimate", action="store_true", help="for estimates from logs alone: no room, no drive"
    )
    parser.add_argument("--duration", help="of one run, e.g. '20 s'")
    parser.add_argument("--runs", type=positive, help="separate drives designed together (default: 1)")
    parser.add_argument("--force", action="store_true", help="write over a file that exists")


def _init(options: argparse.Namespace) -> int:
    from oed.cli.terminal.asking import choice_of
    from oed.foundation.errors import StudyError, UserMistake
    from oed.foundation.files import write_text
    from oed.study.starter import in_short, starter

    choice, file = choice_of(options)
    try:
        text = starter(choice)
    except StudyError as error:
        raise UserMistake(f"this makes no study: {in_short(error)}") from None
    made = "" if file.parent.exists() else f" in a new folder, {file.parent}"
    write_text(file, text)
    quoted = shlex.quote(str(file))
    then = f"oed run {quoted}" if choice.designs else f"oed estimate {quoted} LOG..."
    text = f"wrote {file}{made}; change what is yours, then: {then}"
    return answered(options, {"study": str(file)}, lambda: say(text))


INIT = Command("init", "write a first study for a robot, a room and a sensor", _init, _init_arguments)


def _check_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("studies", metavar="STUDY", nargs="+")


def _check(options: argparse.Namespace) -> int:
    from oed.foundation.errors import FileError
    from oed.foundation.shown import shown
    from oed.workflow.studies import load_study, own_paths, refinements

    entries, wrong = [], False
    for file in options.studies:
        try:
            study = load_study(file)
            own_paths(study)
            study.require_identifiable()
        except FileError as error:
            wrong = True
            say(str(error))
            entries.append({"file": file, "ok": False, "flaws": [vars(issue) for issue in error.issues]})
        else:
            refining = refinements(study)
            entry = {"file": file, "ok": True, "name": study.name, "flaws": []}
            entries.append({**entry, "refinement": refining} if refining else entry)
            if not options.json:
                only = (
                    "" if study.problem.designed else "; without `trajectory`: for estimates from logs alone"
                )
                auto = f"; `coefficients: auto`: {refining}" if refining else ""
                tell(shown(f"{file}: ok ({study.name}{only}{auto})"))
    if options.json:
        print_json({"studies": entries})
    return MISTAKE if wrong else DONE


CHECK = Command("check", "read and cross-check studies; solve nothing", _check, _check_arguments)


def _bound_arguments(parser: argparse.ArgumentParser) -> None:
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


def _bound(options: argparse.Namespace) -> int:
    from oed.bounds import LATTICE, bound
    from oed.cli.terminal.console import print_certificate
    from oed.foundation.errors import Failure
    from oed.foundation.vocabulary import speak
    from oed.kernel.solution import scored
    from oed.workflow.certificates import certified
    from oed.workflow.studies import load_study

    study = load_study(options.study)
    speak(study.file.vocabulary)
    study.require_designed()
    certificate = bound(study.problem, nodes=options.nodes, time_limit=options.time_limit)
    drives = [] if certificate.drive is None else [scored(study.problem, certificate.drive, LATTICE)]
    found = certified(study, certificate, drives)
    if found is None:
        raise Failure(f"{options.study}: {certificate.method}")
    return answered(options, found.plain(), lambda: print_certificate(found))


BOUND = Command("bound", "prove how good any design can be at most; solve nothing", _bound, _bound_arguments)


def _evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("study", metavar="STUDY")
    parser.add_argument(
        "path", metavar="PATH", help="a trajectory CSV, or a log as the study's key `log` says"
    )
    parser.add_argument(
        "--designs", metavar="DIR", help="a record to compare with (default: reports/<file stem>/, if there)"
    )
    parser.add_argument("--verbose", action="store_true", help="print objectives too")


def _evaluate(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_driven, print_results, print_worth
    from oed.foundation.vocabulary import speak
    from oed.records.record import load_record
    from oed.workflow.driven import score_path
    from oed.workflow.studies import load_study

    study = load_study(options.study)
    speak(study.file.vocabulary)
    if options.designs is not None:
        load_record(options.designs)
    designs = options.designs or Path("reports") / Path(options.study).stem
    found = score_path(study, options.path, designs)
    if options.json:
        print_json(found.data)
    else:
        units = None if study.file.domain == "robots" else study.file.shown_units
        limits = study.file.limit_units
        print_driven(found, limited=bool(study.problem.limits), units=units, limits=limits)
        if options.verbose:
            print_results([one.result for one in found.paths], found.robustness, limits)
        print_worth(found)
    for name, one in found.findings:
        say(f"{name}: {one.message}")
    return DONE


EVALUATE = Command(
    "evaluate",
    "score a design (CSV) or the log of a drive with a study's problem",
    _evaluate,
    _evaluate_arguments,
)


def _schema(options: argparse.Namespace) -> int:
    from oed.study.study import json_schema

    print_json(json_schema())
    return DONE


SCHEMA = Command("schema", "print the JSON schema of study files, for editors", _schema)

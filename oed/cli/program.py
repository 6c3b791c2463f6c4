"""The command line: parse, call a command, map errors to exit codes.

Exit codes: 0 done, 1 failed (no feasible design, interrupted), 2 the user's mistake.
"""

from __future__ import annotations

import argparse
import atexit
import gc
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from oed.cli.design_commands import PLAN, RUN, SOLVE, SWEEP
from oed.cli.examples_command import EXAMPLES
from oed.cli.log_commands import ESTIMATE, NEXT
from oed.cli.loop_command import LOOP
from oed.cli.record_commands import ANIMATE, EXPORT, REPORT, VALIDATE
from oed.cli.study_commands import BOUND, CHECK, EVALUATE, INIT, SCHEMA
from oed.cli.terminal.command import FAILED, MISTAKE, Command
from oed.cli.terminal.messages import print_json, say, steady_streams, warnings_shown

if TYPE_CHECKING:
    from oed.foundation.errors import OedError
    from oed.foundation.work.signals import Ending

COMMANDS: tuple[Command, ...] = (
    INIT,
    EXAMPLES,
    RUN,
    CHECK,
    SOLVE,
    SWEEP,
    PLAN,
    BOUND,
    EVALUATE,
    ESTIMATE,
    NEXT,
    LOOP,
    REPORT,
    VALIDATE,
    EXPORT,
    ANIMATE,
    SCHEMA,
)
"""In the order of `oed --help`. They compute nothing, and load what computes when they are run."""
DEBUG = "OED_DEBUG"
"""Environment variable with which what nobody has foreseen is shown as Python shows it."""
OBJECTS = 200_000
"""New objects after which garbage is looked for: more than a check makes."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    from oed.foundation.errors import Failure
    from oed.foundation.work import start
    from oed.foundation.work.signals import ending_alike

    with steady_streams(), warnings_shown(), ending_alike() as ending:
        try:
            try:
                code = _run(arguments, ending)
            finally:
                # What cannot be printed is known only now.
                sys.stdout.flush()
        except Failure as error:
            say(str(error))
            code = FAILED
        except KeyboardInterrupt:
            say("interrupted")
            code = FAILED
        ending.over = True
        if start.LEAVING is not None:
            _end_processes()
            start.done(code)
    return code


def _end_processes() -> None:
    # Python would wait for them after the last handler of signals is gone, and print what a signal does then.
    ends = (("foundation.work.parallel", "end_processes"), ("kernel.dynamics.compiled", "stop_all"))
    for module, function in ends:
        loaded = sys.modules.get(f"oed.{module}")
        if loaded is not None:
            getattr(loaded, function)()


def _run(arguments: Sequence[str] | None, ending: Ending) -> int:
    from oed.foundation.errors import FileError, OedError, UserMistake

    given = sys.argv[1:] if arguments is None else arguments
    try:
        parser = _parser(_JsonParser if _asks_for_json(given) else argparse.ArgumentParser)
        options = parser.parse_args(given)
    except UserMistake as misused:
        _report(str(misused), [], as_json=True)
        return MISTAKE
    if options.command is None:
        parser.print_help()
        return MISTAKE
    _spare_time()
    from oed.foundation.vocabulary import Vocabulary, speaking
    from oed.foundation.work.signals import interrupts_named

    command: Callable[[argparse.Namespace], int] = options.run
    try:
        try:
            with interrupts_named(), speaking(Vocabulary()):
                _require_names(options)
                return command(options)
        finally:
            # What is left is to say how it ended.
            ending.over = True
    except OedError as raised:
        error = _located(raised, options)
        issues = error.issues if isinstance(error, FileError) else ()
        mistake = isinstance(error, UserMistake)
        _report(_with_notes(str(error), raised), [vars(issue) for issue in issues], as_json=options.json)
        return MISTAKE if mistake else FAILED
    except KeyboardInterrupt as error:
        _report(_with_notes("interrupted", error), [], as_json=options.json)
        return FAILED
    except OSError as error:
        # A disk that is full, a file that may not be read: no fault of the program's.
        _report(_with_notes(_of_system(error), error), [], as_json=options.json)
        return FAILED
    except MemoryError as error:
        text = f"more memory is asked for than there is ({error}): take fewer samples, points or coefficients"
        _report(_with_notes(text, error), [], as_json=options.json)
        return FAILED
    except (Exception, SystemExit) as error:
        return _defect(options, error)


def _spare_time() -> None:
    # What a command loads stays: to look through it for garbage again and again takes a tenth of a check.
    gc.set_threshold(OBJECTS, *gc.get_threshold()[1:])
    # The last look, when all ends, would free what the system takes back anyway.
    atexit.register(gc.freeze)
    # Nor does this program use plugins of its libraries, which are looked for among all that is installed.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")


def _require_names(options: argparse.Namespace) -> None:
    # A shell cannot give a null character, other programs' calls of `main` can.
    from oed.foundation.errors import UserMistake

    for given in vars(options).values():
        for one in given if isinstance(given, list) else [given]:
            if isinstance(one, str | Path) and "\0" in str(one):
                raise UserMistake(f"no name of a file has the character '\\x00', got {str(one)!r}")


def _with_notes(message: str, error: BaseException) -> str:
    # What was done before the error, and where it is.
    return "; ".join([message, *getattr(error, "__notes__", ())])


def _of_system(error: OSError) -> str:
    try:
        os.getcwd()
    except FileNotFoundError:
        # Of names that begin there the system says no more than that something is not there.
        return f"the working directory has been deleted: change to another folder ({error})"
    return str(error)


def _located(error: OedError, options: argparse.Namespace) -> OedError:
    # What a command finds out of a study late is named by its line all the same.
    from oed.foundation.errors import FileError, ProblemError, StudyError
    from oed.study.yaml_source import read_yaml

    file = getattr(options, "study", None)
    if file is None or not isinstance(error, ProblemError):
        return error
    try:
        source = read_yaml(file)
    except FileError:
        return error
    return StudyError([source.issue(issue.key, issue.message) for issue in error.issues])


def _defect(options: argparse.Namespace, error: BaseException) -> int:
    # What nobody has foreseen: a sentence all the same, and the way to the whole story.
    if os.environ.get(DEBUG):
        raise error
    said = " ".join(f"{type(error).__name__}: {error}".split())
    if isinstance(error, SystemExit):
        text = f"something ended the program halfway ({said}), which a robot's own module must not do"
    else:
        text = f"a defect of oed, not of your files ({said})"
    text = f"{text}; with {DEBUG}=1 in the environment the same command shows where"
    _report(_with_notes(text, error), [], as_json=options.json)
    return FAILED


def _report(message: str, issues: list[dict[str, Any]], *, as_json: bool) -> None:
    say(message)
    if as_json:
        print_json({"error": message, "flaws": issues})


class _JsonParser(argparse.ArgumentParser):
    """One whose mistakes are said as all others are, for the JSON object that is to say them."""

    def error(self, message: str) -> NoReturn:
        """Refuse what was given, with how the command is called."""
        from oed.foundation.errors import UserMistake

        usage = " ".join(self.format_usage().split())
        raise UserMistake(f"{self.prog}: {message}; {usage}")


def _asks_for_json(given: Sequence[str]) -> bool:
    # Before anything is parsed: `--json` and what argparse takes for it, but no name of a file after `--`.
    options = list(given)[: list(given).index("--")] if "--" in given else given
    return any(len(one) > 2 and "--json".startswith(one) for one in options)


def _parser(kind: type[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    parser = kind(
        prog="oed",
        description="Design the drive that makes a robot's kinematic parameters best estimable.",
    )
    parser.add_argument("--version", action=_ShowVersion, nargs=0, help="show the version and exit")
    parsers = parser.add_subparsers(dest="command", metavar="COMMAND")
    for command in COMMANDS:
        added = parsers.add_parser(command.name, help=command.text, description=command.text)
        added.add_argument(
            "--json", action="store_true", help="one JSON object on stdout, all else on stderr"
        )
        command.arguments(added)
        added.set_defaults(run=command.run)
    return parser


class _ShowVersion(argparse.Action):
    """Print the version, looked up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        """Print it and end."""
        from importlib.metadata import version

        print(f"oed {version('oed')}")
        parser.exit()


if __name__ == "__main__":
    sys.exit(main())

"""`oed check`: whether studies can be solved."""

from __future__ import annotations

import argparse

from oed.cli.terminal.command import DONE, MISTAKE, Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("studies", metavar="STUDY", nargs="+")


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.messages import print_json, say, tell
    from oed.foundation.errors import FileError
    from oed.foundation.shown import shown
    from oed.workflow.studies import load_study, own_paths

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
                tell(shown(f"{file}: ok ({study.name})"))
    if options.json:
        print_json({"studies": entries})
    return MISTAKE if flawed else DONE


CHECK = Command("check", "read and cross-check studies; solve nothing", _run, _arguments)

"""`oed schema`: what a study file may hold."""

from __future__ import annotations

import argparse

from oed.cli.terminal.command import DONE, Command


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.messages import print_json
    from oed.study.study import json_schema

    print_json(json_schema())
    return DONE


SCHEMA = Command("schema", "print the JSON schema of study files, for editors", _run)

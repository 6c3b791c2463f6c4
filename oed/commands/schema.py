"""`oed schema`: what a study file may hold."""

from __future__ import annotations

import argparse

from oed.commands.command import DONE, Command


def _run(options: argparse.Namespace) -> int:
    from oed.messages import print_json
    from oed.study import json_schema

    print_json(json_schema())
    return DONE


SCHEMA = Command("schema", "print the JSON schema of study files, for editors", _run)

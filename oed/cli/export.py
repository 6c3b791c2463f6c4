"""`oed export`: a drive for a real robot."""

from __future__ import annotations

import argparse

from oed.cli.terminal.arguments import add_trust
from oed.cli.terminal.command import DONE, Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", metavar="DIR")
    parser.add_argument("--to", required=True, metavar="FORMAT", help="csv, json, rosbag2 or ros2_yaml")
    parser.add_argument("--result", help="name of the result (default: the best)")
    parser.add_argument("--rate", type=float, help="of the commands [Hz] (default: the design's own)")
    parser.add_argument("--out", metavar="PATH", help="what to write (default: in DIR)")
    parser.add_argument("--storage", default="sqlite3", help="of a bag: sqlite3 (default) or mcap")
    parser.add_argument("--force", action="store_true", help="replace a bag that exists")
    add_trust(parser)


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.messages import print_json, tell
    from oed.exporters import export

    path = export(
        options.folder,
        options.to,
        result=options.result,
        rate=options.rate,
        out=options.out,
        storage=options.storage,
        force=options.force,
        trust=options.trust,
    )
    if options.json:
        print_json({"export": str(path)})
    else:
        tell(str(path))
    return DONE


EXPORT = Command("export", "write a result's drive for a robot, or the robot's parameters", _run, _arguments)

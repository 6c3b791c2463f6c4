"""`python -m benchmarks [NAME ...] [--write]`: run the benchmarks, each in a process of its own."""

from __future__ import annotations

import argparse
import math
import multiprocessing
import platform
import sys
from concurrent.futures import ProcessPoolExecutor
from datetime import date
from pathlib import Path

from benchmarks.figure import Figure, figures_of

BENCHMARKS: tuple[str, ...] = (
    "solve",
    "transcriptions",
    "drift",
    "limits",
    "large",
    "population",
    "monte_carlo",
    "long_log",
    "start_up",
    "whole_run",
    "starters",
    "weights",
)
"""Modules of this folder, in the order of the table."""

PAGE = Path(__file__).parent.parent / "docs" / "benchmarks.md"
BEGIN, END = "<!-- benchmarks: written by make bench -->", "<!-- end of benchmarks -->"


def main() -> int:
    """Print the table; with --write put it into docs/benchmarks.md."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"some of {', '.join(BENCHMARKS)}")
    parser.add_argument("--write", action="store_true", help="write the table into docs/benchmarks.md")
    options = parser.parse_args()
    strangers = sorted(set(options.names) - set(BENCHMARKS))
    if strangers:
        parser.error(f"no benchmark {', '.join(strangers)}; there are {', '.join(BENCHMARKS)}")
    if options.write and options.names:
        parser.error("--write needs all benchmarks: leave out the names")
    found, failed = list[Figure](), list[str]()
    for name in options.names or BENCHMARKS:
        try:
            found += _alone(name)
        except Exception as error:
            # The others' minutes are not to be lost.
            failed.append(f"{name} failed: {error!r}")
    table = _table(found)
    print(table)
    if failed:
        print(*failed, sep="\n", file=sys.stderr)
    elif options.write:
        _write(table)
    return 1 if failed else 0


def _alone(name: str) -> list[Figure]:
    # A process of its own: what one benchmark has compiled or cached must not help the next.
    print(f"{name} ...", file=sys.stderr, flush=True)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(figures_of, name).result()


def _table(figures: list[Figure]) -> str:
    rows = [
        f"Measured on {date.today().isoformat()}, {_machine()}, Python {platform.python_version()}.",
        "",
        "| | oed | compared with | ratio | goal |",
        "|---|---|---|---|---|",
    ]
    for one in figures:
        ratio = "" if math.isnan(one.ratio) else f"{one.ratio:.3g}"
        rows.append(f"| {one.what} | {one.ours} | {one.against} | {ratio} | {_goal(one)} |")
    return "\n".join(rows)


def _goal(figure: Figure) -> str:
    if figure.goal is None:
        return ""
    sign = "≥" if figure.at == "least" else "≤"
    return f"{sign} {figure.goal:g}: {'reached' if figure.reached else 'missed'}"


def _machine() -> str:
    models = [
        line.split(":", 1)[1].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    return f"{len(models)} x {models[0] if models else platform.machine()}"


def _write(table: str) -> None:
    text = PAGE.read_text()
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    PAGE.write_text(f"{before}{BEGIN}\n{table}\n{END}{after}")


if __name__ == "__main__":
    sys.exit(main())

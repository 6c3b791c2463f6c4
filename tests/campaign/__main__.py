"""`python -m tests.campaign`: as many random problems, experiments, damaged files and signals as wanted."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from .cases import Outcome
from .damage.material import make_material
from .runner import JUDGED, SORTS, Task, run_case, run_cases

EVERY = 10.0
"""Seconds between two lines of progress."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a campaign; 1 if anything failed."""
    options = _options(arguments)
    with tempfile.TemporaryDirectory(prefix="oed-campaign-") as place:
        tasks = _tasks(options, Path(place))
        if any(task.sort not in JUDGED for task in tasks):
            make_material(Path(place), options.seed)
        # A single case is run here, where a debugger finds it.
        found = map(run_case, tasks) if options.only else run_cases(tasks, options.workers)
        outcomes = list(_reported(found, {(task.sort, task.index): task for task in tasks}))
    print(table(outcomes))
    return int(any(outcome.failures for outcome in outcomes))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description=__doc__)
    for name, number in (("problems", 10_000), ("files", 1000), ("signals", 100), ("experiments", 2000)):
        parser.add_argument(f"--{name}", type=int, default=number, help=f"how many (default: {number})")
    parser.add_argument(
        "--workers", type=int, default=2, help="processes (default: 2); results do not depend on it"
    )
    parser.add_argument("--seed", type=int, default=0, help="of everything that is random (default: 0)")
    parser.add_argument("--first", type=int, default=0, help="number of the first of each sort (default: 0)")
    parser.add_argument(
        "--only", metavar="SORT:NUMBER", help="one case alone, e.g. problem:17, in this process"
    )
    parser.add_argument(
        "--quick", action="store_true", help="no commands on files that take long, no timing of signals"
    )
    return parser.parse_args(arguments)


def _tasks(options: argparse.Namespace, material: Path) -> list[Task]:
    counts = dict(
        zip(SORTS, (options.problems, options.files, options.signals, options.experiments), strict=True)
    )
    wanted = [(sort, index) for sort in SORTS for index in range(options.first, counts[sort])]
    if options.only:
        sort, number = options.only.split(":")
        wanted = [(sort, int(number))]
    return [Task(sort, index, options.seed, material, options.quick) for sort, index in wanted]


def _reported(outcomes: Iterable[Outcome], tasks: dict[tuple[str, int], Task]) -> Iterable[Outcome]:
    # Prints one line a failure, and now and then how far it is.
    began = last = time.monotonic()
    for count, outcome in enumerate(outcomes, start=1):
        for one in outcome.failures:
            command = tasks[outcome.sort, outcome.index].command
            print(
                f"{outcome.sort} {outcome.index}: not so: {one.asked}: {one.wrong}  [{command}]", flush=True
            )
        if time.monotonic() - last > EVERY:
            last = time.monotonic()
            rate = count / (last - began)
            left = (len(tasks) - count) / rate
            print(
                f"{count} of {len(tasks)}, {rate:.1f}/s, {left / 60:.0f} min left",
                file=sys.stderr,
                flush=True,
            )
        yield outcome


def table(outcomes: Iterable[Outcome]) -> str:
    """What was asked how often of which cases, and how often it did not hold."""
    cases, failed = Counter[str](), Counter[str]()
    asked, wrong = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for outcome in outcomes:
        cases[outcome.sort] += 1
        failed[outcome.sort] += bool(outcome.failures)
        asked.update((outcome.sort, one.asked) for one in outcome.verdicts)
        wrong.update((outcome.sort, one.asked) for one in outcome.failures)
    lines = [f"{'':42}{'tried':>9}{'failed':>9}"]
    for sort in SORTS:
        if cases[sort]:
            lines.append(f"{sort + 's':42}{cases[sort]:9}{failed[sort]:9}")
            own = sorted(key for key in asked if key[0] == sort)
            lines += [f"  {key[1]:40}{asked[key]:9}{wrong[key]:9}" for key in own]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())

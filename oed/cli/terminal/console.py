"""What the command line shows with rich: progress on standard error, and results as tables."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.progress import Progress as RichProgress
from rich.table import Table
from rich.text import Text

from oed.cli.terminal.messages import tell
from oed.foundation.shown import shown
from oed.foundation.work.progress import Progress, Silent

if TYPE_CHECKING:
    from oed.records.record import EstimateRecord
    from oed.records.stored.result import Result
    from oed.records.stored.simulation import StoredRobustness
    from oed.records.stored.study_record import StoredCertificate
    from oed.records.stored.sweep import StoredSweep
    from oed.workflow.driven import DrivenPaths
    from oed.workflow.next_drive import NextDrive


class _Bars:
    """Progress of long work as rich bars, one per stage."""

    def __init__(self, bars: RichProgress) -> None:
        self._bars = bars
        self._task: TaskID | None = None

    def begin(self, description: str, total: int) -> None:
        self._bars.start()
        self._task = self._bars.add_task(shown(description), total=total, note="")

    def advance(self, note: str = "") -> None:
        if self._task is not None:
            self._bars.update(self._task, advance=1, note=shown(note))

    def say(self, sentence: str) -> None:
        self._bars.console.print(shown(sentence), markup=False, highlight=False)

    def end(self) -> None:
        # Where nothing has begun, nothing is shown: not even the empty line that rich ends with.
        if self._task is not None:
            self._bars.stop()


@contextmanager
def progress(quiet: bool) -> Iterator[Progress]:
    """A listener that draws bars on standard error while the context lasts; silent when `quiet`."""
    if quiet:
        yield Silent()
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}", markup=False),
    )
    bars = _Bars(RichProgress(*columns, console=Console(stderr=True)))
    try:
        yield bars
    finally:
        bars.end()


def _console() -> Console:
    # As wide as the terminal, or as a file's readers have it.
    return Console(width=None if sys.stdout.isatty() else 120)


def _table(headings: Sequence[str], left: Sequence[str], *, no_wrap: bool = False) -> Table:
    # Text, for rich would take "[m]" for markup.
    table = Table(box=None, pad_edge=False)
    for heading in headings:
        table.add_column(Text(heading), justify="left" if heading in left else "right", no_wrap=no_wrap)
    return table


def print_results(results: Sequence[Result], robustness: StoredRobustness | None = None) -> None:
    """Results as a table and their messages, on standard output; `robustness` as a record has it."""
    tightened = () if robustness is None else robustness.limits
    headings = ("name", "objective", "s_min(W)", "cond(W)", "|y|", "path [m]", "feasible", "time [s]")
    table = _table(headings, ("name",))
    for one in results:
        table.add_row(
            _cell(one.name),
            number(one.objective),
            number(one.smallest_singular_value),
            number(one.condition_number),
            number(one.norm_y),
            number(one.path_length),
            "yes" if one.feasible else "no",
            number(one.wall_seconds, 3),
        )
    console = _console()
    console.print(table)
    for one in results:
        # A path that was scored and can be driven has said all there is in its row.
        if len(results) > 1 and one.status == "scored" and one.feasible:
            continue
        _print_line(console, f"{one.name}: {one.message}")
        for limit, amount in one.violations.items():
            how = ", back-off for other robots included" if limit in tightened else ""
            _print_line(console, f"  exceeds {limit} by {amount:.4g} (SI){how}")
        points = [margin.limit for margin in one.margins if margin.certain is False]
        if points and one.feasible:
            _print_line(console, f"  checked at points only, not between them: {', '.join(points)}")


def _cell(text: str) -> Text:
    # Names come from files: they neither steer the terminal nor are rich's markup.
    return Text(shown(text))


def _print_line(console: Console, line: str) -> None:
    console.print(shown(line), highlight=False, markup=False)


def print_worth(found: DrivenPaths) -> None:
    """The information of driven paths, as a share of the best design's and of what no drive exceeds."""
    for one in found.paths:
        shares = []
        if one.efficiency is not None and found.best is not None:
            shares.append(f"{percent(one.efficiency)} of the best design known ({found.best[0]})")
        if one.share_of_bound is not None:
            shares.append(f"at least {percent(one.share_of_bound)} of what any drive of the study can give")
        if shares:
            tell(shown(f"{one.name}: {one.seconds:.3g} s of motion have {', '.join(shares)}"))


def print_next(found: NextDrive) -> None:
    """Standard errors now, wanted and after the next drive, and whether to drive it."""
    from oed.foundation.text import error_text, own_unit, to_error, words

    headings = ("parameter", "unit", "estimate", "std. error", "wanted", "after the next drive")
    table = _table(headings, ("parameter", "unit"))
    for one in found.precision:
        unit, factor = own_unit(one.unit)
        errors = (error_text(error, factor) for error in (one.now, one.wanted, one.next))
        table.add_row(_cell(words(one.name)), _cell(unit), to_error(one.value, one.now, factor), *errors)
    _console().print(table)
    tell(found.reason)


def print_certificate(certificate: StoredCertificate) -> None:
    """An upper bound with its method and assumptions, and the others that were found."""
    console = _console()
    lines = [f"no drive has an objective above {number(certificate.upper_bound)}: {certificate.method}"]
    lines += [f"  assumes {assumption}" for assumption in certificate.assumptions]
    if not certificate.complete:
        lines.append(f"  ended after {certificate.nodes} nodes; more of them (--nodes) may lower it")
    widened = certificate.widened
    if widened is not None:
        lines.append(
            f"no drive that satisfies the limits within {percent(widened.tolerance)} has one above "
            f"{number(widened.upper_bound)}"
        )
    if certificate.gap is not None:
        loose = ", a loose bound" if certificate.loose else ""
        exact = certificate.gap_to == certificate.upper_bound
        satisfied = "exactly" if exact or widened is None else f"within {percent(widened.tolerance)}"
        lines.append(
            f"best drive known here: {number(certificate.best)}, limits satisfied {satisfied}, "
            f"gap {percent(certificate.gap)} to the bound for such drives{loose}"
        )
    for upper in certificate.bounds[1:]:
        lines.append(f"  also {number(upper.upper_bound)}: {upper.method}")
    for line in lines:
        _print_line(console, line)


def percent(share: float) -> str:
    """A share in percent, two digits of it or the whole number."""
    size = 100 * share
    return f"{size:.0f} %" if abs(size) >= 9.95 else f"{size:.2g} %"


def number(value: float | None, digits: int = 6) -> str:
    """A number with so many significant digits; a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}g}"


def print_estimate(record: EstimateRecord) -> None:
    """Estimates as a table, what their errors rest on, what they are worth, and warnings."""
    from oed.report.estimate.parameters import estimate_lines, estimate_rows

    headings = ("parameter", "unit", "nominal", "estimate", "std. error", "95 % interval", "change [%]")
    table = _table(headings, ("parameter", "unit"), no_wrap=True)
    for row in estimate_rows(record):
        table.add_row(*map(_cell, row))
    console = _console()
    console.print(table)
    for line in estimate_lines(record):
        _print_line(console, line)


def print_sweep(found: StoredSweep) -> None:
    """A sweep's points as a table, the best marked, and what went wrong, on standard output."""
    names = [shown(axis.name) for axis in found.keys]
    headings = (*names, "best result", "objective", "lambda_min", "gap", "status", "time [s]")
    table = _table(headings, ("best result", "status"))
    for one in found.points:
        table.add_row(
            *(_cell(one.values[axis.key]) for axis in found.keys),
            _cell(one.design or "-"),
            number(one.objective) + (" *" if one.folder == found.best else "  "),
            number(one.lambda_min),
            "-" if one.gap is None else percent(one.gap),
            _cell(one.status),
            number(one.seconds, 3),
        )
    console = _console()
    console.print(table)
    if found.best is not None:
        tell("* the best of them")
    elif not found.comparable:
        tell("objectives of different criteria, parameters or measurements do not compare")
    for one in found.points:
        if one.objective is None:
            _print_line(console, f"{one.label}: {'; '.join(one.message.splitlines())}")

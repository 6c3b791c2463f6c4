"""What the command line shows with rich: progress on standard error, and results as tables."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.progress import Progress as RichProgress
from rich.table import Table
from rich.text import Text

from oed.cli.terminal.messages import tell
from oed.foundation.shown import shown
from oed.foundation.text import error_text, own_unit, to_error, words
from oed.foundation.vocabulary import spoken
from oed.foundation.work.progress import Progress, Silent

if TYPE_CHECKING:
    from oed.records.record import EstimateRecord
    from oed.records.stored.loop import KnownParameter
    from oed.records.stored.result import Result
    from oed.records.stored.simulation import StoredRobustness
    from oed.records.stored.study_record import StoredCertificate
    from oed.records.stored.sweep import StoredSweep
    from oed.report.answer import Answer, Estimated
    from oed.workflow.driven import DrivenPaths
    from oed.workflow.next_drive import NextDrive, Precision

HELD = "\0"
"""Stands for a space that lines do not end at; what is shown has none."""
WIDTH = 80
"""Columns of what every terminal shows whole."""


class _Bars:
    """Progress of long work as rich bars, one per stage."""

    def __init__(self, bars: RichProgress) -> None:
        self._bars = bars
        self._task: TaskID | None = None
        self._current, self._one_step = "", False

    def begin(self, description: str, total: int) -> None:
        self._bars.start()
        if self._task is not None and description == self._current:
            # The same work on the next drive goes on in the same line.
            known = self._bars.tasks[-1].total or 0
            self._bars.update(self._task, total=known + total)
            self._one_step = False
            return
        if self._task is not None and self._one_step:
            # Stages of one step take each other's place.
            self._bars.remove_task(self._task)
        elif self._task is not None:
            # A stage may end before all its steps: its clock stops, and what was done is all there was.
            self._bars.update(self._task, total=self._bars.tasks[-1].completed)
            self._bars.stop_task(self._task)
        self._current, self._one_step = description, total == 1
        self._task = self._bars.add_task(shown(spoken(description)), total=total, note="")

    def advance(self, note: str = "") -> None:
        if self._task is not None:
            self._bars.update(self._task, advance=1, note=shown(spoken(note)))

    def say(self, sentence: str) -> None:
        self._bars.console.print(shown(spoken(sentence)), markup=False, highlight=False)

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


def _table(headings: Sequence[str], left: Sequence[str], *, kept: Sequence[str] = ()) -> Table:
    # Text, for rich would take "[m]" for markup. Columns that are `kept` are never narrowed.
    table = Table(box=None, pad_edge=False)
    for heading in headings:
        side: Literal["left", "right"] = "left" if heading in left else "right"
        table.add_column(Text(heading), justify=side, no_wrap=heading in kept, overflow="fold")
    return table


def print_answer(answer: Answer) -> None:
    """What a study found: every standard error, beside the best baseline, and its grounds."""
    print_lines(filter(None, [answer.warning, answer.title]))
    if answer.rows:
        _print_rows(answer.rows, answer.baseline and f"best baseline ({answer.baseline})")
    print_lines(answer.sentences)


def print_lines(lines: Iterable[str]) -> None:
    """Sentences, on standard output, as wide as every terminal shows whole."""
    console = Console(width=WIDTH)
    for line in lines:
        _print_line(console, line)


def _print_rows(rows: Iterable[Estimated], beside: str) -> None:
    # Standard errors, and what is `beside` them.
    headings = ("", "value", "standard error", *([spoken(beside)] if beside else []))
    table = _table(headings, ("",))
    for one in rows:
        table.add_row(*map(_cell, (one.name, one.value, one.designed, one.baseline)[: len(headings)]))
    Console(width=WIDTH).print(table)


def print_results(
    results: Sequence[Result],
    robustness: StoredRobustness | None = None,
    units: Mapping[str, tuple[str, float]] | None = None,
) -> None:
    """Results as a table and their messages, on standard output.

    Args:
        results: that are shown.
        robustness: as a record has it.
        units: in which limits are given, by their names.
    """
    lengths = any(one.path_length is not None for one in results)
    path = ["path [m]"] if lengths else []
    headings = ("name", "objective", "s_min(W)", "cond(W)", *path, "feasible", "time [s]")
    table = _table(headings, ("name",), kept=headings[1:])
    for one in results:
        table.add_row(
            _cell(one.name),
            number(one.objective),
            number(one.smallest_singular_value, 4),
            number(one.condition_number, 3),
            *([number(one.path_length, 3)] if lengths else []),
            "yes" if one.feasible else "no",
            number(one.wall_seconds, 3),
        )
    _console().print(table)
    # A path of the user's own that can be driven has said all there is in its row.
    alone = len(results) == 1
    print_messages(
        (one for one in results if alone or one.origin != "path" or not one.feasible),
        robustness,
        units,
    )


def print_messages(
    results: Iterable[Result],
    robustness: StoredRobustness | None = None,
    units: Mapping[str, tuple[str, float]] | None = None,
) -> None:
    """What became of results, and the limits that they exceed; tightened ones with their back-off.

    Args:
        results: that are told of.
        robustness: as a record has it.
        units: in which limits are given, by their names.
    """
    console = _console()
    for one in results:
        message, broken = _message(one), list(_broken(one, robustness, units))
        if message or broken:
            _print_line(console, f"{one.name}: {message}".rstrip())
        for line in broken:
            _print_line(console, f"  {line}")


def _message(one: Result) -> str:
    # That it was scored as given is no news.
    from oed.kernel.solution import Status

    return one.message.removeprefix(Status.SCORED.sentence).strip()


def _broken(
    one: Result, robustness: StoredRobustness | None, units: Mapping[str, tuple[str, float]] | None
) -> Iterator[str]:
    from oed.report.sections.limits import exceeded

    for excess in exceeded(one, robustness, units):
        yield f"exceeds {excess}"
    points = [words(margin.limit) for margin in one.margins if margin.certain is False]
    if points and one.feasible:
        yield f"checked at points only, not between them: {', '.join(points)}"


def _cell(text: str) -> Text:
    # Names come from files: they neither steer the terminal nor are rich's markup.
    return Text(shown(text))


def _print_line(console: Console, line: str) -> None:
    # A number and its unit, and the sides of a room, stay on one line.
    text = re.sub(r"(?<=\d) (?=\S)|(?<= x) | (?=x )", HELD, shown(spoken(line)))
    for one in textwrap.wrap(text, console.width, break_long_words=False, break_on_hyphens=False):
        console.print(one.replace(HELD, " "), highlight=False, markup=False, soft_wrap=True)


def print_driven(
    found: DrivenPaths,
    *,
    limited: bool = True,
    units: Mapping[str, tuple[str, float]] | None = None,
    limits: Mapping[str, tuple[str, float]] | None = None,
) -> None:
    """Of driven paths every standard error, beside the best design's, and limits that they exceed.

    Args:
        found: the paths.
        limited: whether there are any limits.
        units: in which parameters are shown, of what is no robot; None of robots.
        limits: in which limits are given, by their names.
    """
    from oed.report.answer import rows_of

    beside = "" if found.design is None else f"best design ({found.design.name})"
    for one in found.paths:
        rows = rows_of(found.parameters, one.result, found.design, units)
        departing, warns = found.departing(one)
        print_lines([departing] if warns else [])
        print_lines([f"{one.name}: {one.seconds:.3g} s of motion" if units is None else one.name])
        if rows:
            _print_rows(rows, beside)
        print_lines(filter(None, [_message(one.result)]))
        if departing and not warns:
            print_lines([departing])
        elif not departing and one.result.feasible and limited:
            print_lines(["Limits satisfied."])
        print_lines(_broken(one.result, found.robustness, limits))


def print_worth(found: DrivenPaths) -> None:
    """The information of driven paths, as a share of the best design's and of what no drive exceeds."""
    for one in found.paths:
        shares = []
        if one.efficiency is not None and found.best is not None:
            shares.append(
                f"{percent(one.efficiency)} of the information of the best design known ({found.best[0]})"
            )
        if one.share_of_bound is not None:
            shares.append(f"at least {percent(one.share_of_bound)} of what any drive of the study can give")
        if shares:
            print_lines([f"{one.name}: {', '.join(shares)}"])


def print_next(found: NextDrive) -> None:
    """Standard errors now, wanted and after the next drive, and whether to drive it."""
    print_precision(found.precision)
    if found.basis:
        tell(found.basis)
    tell(found.reason)


def print_precision(known: Iterable[Precision | KnownParameter]) -> None:
    """What is known of parameters, what is wanted, and what another drive would bring."""
    headings = ("parameter", "unit", "estimate", "std. error", "wanted", "after the next drive")
    table = _table(headings, ("parameter", "unit"))
    for one in known:
        unit, factor = own_unit(one.unit)
        errors = (error_text(error, factor) for error in (one.now, one.wanted, one.next))
        table.add_row(_cell(words(one.name)), _cell(unit), to_error(one.value, one.now, factor), *errors)
    _console().print(table)


def print_certificate(certificate: StoredCertificate) -> None:
    """An upper bound with its method and assumptions, and the others that were found."""
    console = _console()
    lines = [f"no drive has an objective above {number(certificate.upper_bound)}: {certificate.method}"]
    lines += [f"  assumes {assumption}" for assumption in certificate.every_assumption]
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

    headings = ["parameter", "unit", "nominal", "estimate", "standard error", "change [%]"]
    headings += ["bias, at most"] if record.diluted else []
    table = _table(headings, ("parameter", "unit"), kept=headings[1:])
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

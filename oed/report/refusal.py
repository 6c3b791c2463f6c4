"""Why a study has no answer: which limits conflict, and what comes closest to satisfying them."""

from __future__ import annotations

from collections.abc import Iterator

from oed.foundation.text import words
from oed.kernel.solution import Status
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.answer import title_of
from oed.report.parts.prose import Prose
from oed.report.parts.reading import VARIANT
from oed.report.sections.limits import exceeded

SAY = Prose("refusal")


def refusal_of(record: Record) -> tuple[str, ...]:
    """Why a record has no drive to use, line by line: first what was asked for, then what is in the way."""
    driven = any(one.feasible for one in record.results)
    said = (SAY("nothing", bool(record.results), driven), *_reasons(record), _closest(record))
    return (title_of(record), *filter(None, said))


def _reasons(record: Record) -> Iterator[str]:
    # Of every search, what it says beyond that it found nothing; the same once.
    searches = [one for one in record.results if one.origin != "baseline"]
    said: dict[str, list[str]] = {}
    for one in searches:
        reason = one.message.removeprefix(Status.INFEASIBLE.sentence).strip()
        said.setdefault(reason or one.message, []).append(one.name)
    for reason, names in said.items():
        yield reason if len(said) == 1 else SAY("reason", names, reason)


def _closest(record: Record) -> str:
    # The baseline that exceeds the fewest limits, and those by least.
    def excess(one: Result) -> tuple[int, float]:
        broken = [margin for margin in one.margins if not margin.satisfied]
        return len(broken), sum(-margin.margin / margin.size for margin in broken)

    baselines = [one for one in record.results if one.origin == "baseline" and VARIANT not in one.name]
    closest = min((one for one in baselines if one.violations), key=excess, default=None)
    if closest is None or any(one.feasible for one in record.results):
        return ""
    return SAY("closest", words(closest.name), exceeded(closest, record.robustness, record.study.limit_units))

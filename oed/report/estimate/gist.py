"""The gist of an estimate in sentences: what it is worth on the road, and what speaks against it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from oed.foundation.text import count, listing, quantity
from oed.report.estimate.numbers import known, unit_for
from oed.report.estimate.reading import (
    Data,
    Run,
    clock_label,
    clocks,
    entries,
    held_out_runs,
    in_signs,
    left_out_runs,
    means,
)

GAINS = (
    ("drift over 1 m of path", "drift_position", "m"),
    ("position error (RMS)", "rmse_position", "m"),
    ("heading error (RMS)", "rmse_heading", "rad"),
)
"""What is told of dead reckoning in one sentence, and the numbers' names and units."""
WORSE = 1.05
"""Ratio of errors after and before from which on the estimate has made dead reckoning worse."""
CLOCKS_APART = 0.1
"""Offset of two clocks that is worth a warning [s]."""
NAMED = 3
"""How many things a sentence names before it counts the others."""


def gains(data: Data) -> list[str]:
    """A sentence each on the logs kept apart and on those left out one at a time; [] without positions."""
    apart, left = held_out_runs(data), left_out_runs(data)
    kept = "log" if len(apart) == 1 else count(len(apart), "log")
    found = [_gain(f"the {kept} kept apart", apart)]
    found.append(_gain(f"{_parts(data)}, by the estimate from the others", left))
    return list(filter(None, found))


def _parts(data: Data) -> str:
    folds = entries(data, "left_out")
    if all(len(fold["logs"]) == 1 for fold in folds):
        return "each log"
    return f"each of {len(folds)} parts of the logs"


def _gain(which: str, runs: Sequence[Run]) -> str:
    told = [_from_to(name, means(runs, key), unit) for name, key, unit in GAINS]
    changes = list(filter(None, told))
    return f"Dead reckoning of {which}: {', '.join(changes)}." if changes else ""


def _from_to(name: str, pair: tuple[float, float] | None, unit: str) -> str:
    if pair is None:
        return ""
    shown, factor = unit_for([max(pair)], unit)
    before, after = (quantity(value * factor, shown) for value in pair)
    return f"{name} from {before} to {after}"


def warnings(data: Data) -> list[str]:
    """What must not be overlooked, the gravest first."""
    found = []
    if not data.get("converged", True):
        found.append("The search did not converge: take the estimates with care.")
    found += [_sentence(str(text)) for text in data.get("untold") or []]
    return [*found, *_doubts(data), *_worse(data), *_failed(data)]


def notes(data: Data) -> list[str]:
    """What was decided or seen on the way."""
    return [_sentence(in_signs(str(text))) for text in data.get("notes") or []]


def _worse(data: Data) -> list[str]:
    runs = held_out_runs(data) or left_out_runs(data)
    pairs = [(name, means(runs, key)) for name, key, _ in GAINS]
    grown = [name for name, pair in pairs if pair is not None and pair[1] > WORSE * pair[0]]
    if not grown:
        return []
    return [f"With these estimates dead reckoning of logs that they do not know is worse: {listing(grown)}."]


def _failed(data: Data) -> list[str]:
    # The other ways to a covariance allow for what is left of correlations and of differences between logs.
    grave = {"outliers"} if data.get("covariance_kind") != "information" else {"outliers", "whiteness"}
    grave |= {"logs_agree"} if data.get("covariance_kind") == "information" else set()
    failed = [one for one in entries(data, "diagnostics") if not one["passed"] and one["name"] in grave]
    return [_sentence(in_signs(str(one["message"]))) for one in failed]


def _doubts(data: Data) -> list[str]:
    groups = findings(data)
    return [_doubt(group) for group in groups.values() if group[0][1].get("doubtful")]


def _doubt(group: Sequence[tuple[str, Mapping[str, Any]]]) -> str:
    log, first = group[0]
    others = len({name for name, _ in group}) - 1
    more = f" (and something alike in {count(others, 'other log')})" if others else ""
    return f"{log}: {in_signs(str(first['message']))}{more}."


def findings(data: Data) -> dict[tuple[str, bool], list[tuple[str, Mapping[str, Any]]]]:
    """Findings with the names of their logs, by kind and doubtfulness, the doubtful ones first."""
    groups: dict[tuple[str, bool], list[tuple[str, Mapping[str, Any]]]] = {}
    for log in entries(data, "logs"):
        for one in log.get("findings") or []:
            key = str(one["name"]), bool(one.get("doubtful"))
            groups.setdefault(key, []).append((str(log["name"]), one))
    return dict(sorted(groups.items(), key=lambda item: not item[0][1]))


def offset_clocks(data: Data, beyond: float = CLOCKS_APART) -> str:
    """Which clocks are further apart than `beyond` [s], in words; nothing where none is."""
    sizes = [(clock_label(data, one), known(one.get("value")) or 0.0) for one in clocks(data)]
    far = sorted((one for one in sizes if abs(one[1]) > beyond), key=lambda one: -abs(one[1]))
    told = [f"{label} {1e3 * value:+.0f} ms" for label, value in far[:NAMED]]
    if len(far) > NAMED:
        told.append(f"{len(far) - NAMED} more")
    return listing(told)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."

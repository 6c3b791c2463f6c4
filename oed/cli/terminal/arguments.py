"""Options that several commands have, and what is read of an option's text."""

from __future__ import annotations

import argparse
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oed.optimize import Workers


def add_working(parser: argparse.ArgumentParser) -> None:
    """The options of a command that searches."""
    parser.add_argument("--seed", type=whole, help="seed of every random draw, instead of the study's")
    add_workers(parser)
    add_quiet(parser)


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Who works."""
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument("--workers", type=positive, help="processes (default: one per processor)")
    choice.add_argument(
        "--cluster", metavar="tcp://HOST:PORT", help="a running Dask cluster's scheduler, instead"
    )


def workers_of(options: argparse.Namespace) -> Workers | None:
    """Who works, None for the default; a cluster is connected to at once, before any work is done.

    Raises:
        UserMistake: not an address, or the extra `cluster` is missing.
        Failure: no cluster answers there, or it has other versions of what computes.
    """
    if options.cluster is None:
        workers: int | None = options.workers
        return workers
    from oed.foundation.work.cluster import Cluster

    cluster = Cluster(options.cluster)
    cluster.connect()
    return cluster


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Whether progress is shown."""
    parser.add_argument("--quiet", action="store_true", help="show no progress")


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Whether code that a record names may be run."""
    parser.add_argument(
        "--trust",
        action="store_true",
        help="run the Python code that the record names, and read other files that it names",
    )


def count(text: str) -> int:
    """A number, whose bounds those know who are given it."""
    return _at_least(None, text)


def whole(text: str) -> int:
    """A number from 0."""
    return _at_least(0, text)


def positive(text: str) -> int:
    """A number from 1."""
    return _at_least(1, text)


def _at_least(least: int | None, text: str) -> int:
    from oed.foundation.arguments import DIGITS, count_issue
    from oed.foundation.shown import written

    # Python reads no numbers of thousands of digits.
    digits = re.fullmatch(r"\s*[-+]?0*([0-9]+)\s*", text)
    number = None if digits is None else int(text) if len(digits[1]) <= DIGITS else 10**DIGITS
    reason = count_issue(number, least) or ("expected a whole number" if number is None else "")
    if number is None or reason:
        raise argparse.ArgumentTypeError(f"{reason}, got {written(text)}")
    return number


def seconds(text: str) -> float:
    """A time above 0 [s]."""
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"expected more than 0 seconds, got {value:g}")
    return value


def duration(text: str) -> float:
    """A time above 0, `20 s` or plain seconds [s]."""
    value = _quantity(text, "s")
    if not value > 0:
        raise argparse.ArgumentTypeError(f"expected more than 0 seconds, got {text!r}")
    return value


def _quantity(text: str, unit: str) -> float:
    from oed.foundation.quantities import parse_quantity

    try:
        return parse_quantity(text, unit)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def durations(text: str) -> tuple[float, ...]:
    """Times above 0, `10,20,40 s` or plain seconds [s]: a unit after the last one is that of all."""
    parts = [part.strip() for part in text.split(",")]
    unit = re.sub(r"^[-+.\deE]*", "", parts[-1])
    return tuple(duration(f"{part} {unit}" if part[-1:].isdigit() else part) for part in parts)


def aim(text: str) -> tuple[str, str]:
    """`PARAMETER SIZE`, as the parameter's name and the size."""
    found = re.fullmatch(r"\s*(.*?\S)\s*[\s=]\s*([-+.]?\d.*)", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"expected PARAMETER SIZE, e.g. 'track 0.1 %', got {text!r}")
    return re.sub(r"\s+", "_", found[1].strip()), found[2].strip()


def share(text: str) -> float:
    """A share from 0, below 1."""
    value = float(text)
    if not 0 <= value < 1:
        raise argparse.ArgumentTypeError(f"expected a share from 0 to 1, got {value:g}")
    return value


def part(text: str) -> float:
    """A share above 0 and below 1, `25%` or `0.25`."""
    value = _quantity(text, "")
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"expected more than 0 % and less than 100 %, got {text}")
    return value


def pair(text: str) -> tuple[str, str]:
    """`KEY=VALUE`, as its two sides."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"expected KEY=VALUE, got {text!r}")
    return key.strip(), value.strip()

"""Plain output: what every command needs, and nothing heavy to load for it (tables and bars: console)."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

from oed.foundation.shown import shown_lines


def print_json(data: Mapping[str, Any]) -> None:
    """One JSON object on standard output."""
    sys.stdout.write(json.dumps(data, indent=1, allow_nan=False) + "\n")


def tell(*lines: str) -> None:
    """Lines on standard output."""
    sys.stdout.write("".join(f"{shown_lines(text)}\n" for text in lines))


def say(text: str) -> None:
    """A line on standard error."""
    sys.stderr.write(f"{shown_lines(text)}\n")

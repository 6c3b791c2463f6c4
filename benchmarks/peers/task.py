"""The task "robot-40", in plain numbers, so that everyone can read it: the package, its peers, the scorer."""

from __future__ import annotations

import argparse
import json
import random
import time

COEFFICIENTS = {"c11": 0.2722, "c12": -0.2722, "c21": 0.0245, "c22": 0.0245}
"""Yaw rate = c11 right + c12 left [1], forward speed = c21 right + c22 left [m], of wheel speeds in rad/s."""
DURATION = 10.0
"""Of the drive [s], from the known pose 0."""
INTERVALS = 20
"""Equal intervals on which the wheel speeds are constant."""
READINGS = 40
"""Equal times at which x, y and heading are read, the last at the end; at the start they are known."""
FASTEST = 10.0
"""Largest wheel speed [rad/s]; the smallest is 0."""
DEVIATION = 0.01
"""Standard deviation of x and y [m], and of the heading [rad]."""
STARTS = 5
"""Random starts of each peer, the same for all."""

BEST_KNOWN = {"D": 56.69755968910, "A": 2.0001318203e-4, "E": 5751.5608838}
"""log det F, tr F^-1 and lambda_min F, relative to the coefficients: the best that any search has found."""


def random_inputs(start: int) -> list[list[float]]:
    """Wheel speeds (INTERVALS, 2) of a random start, right and left [rad/s]."""
    draw = random.Random(start)
    return [[draw.uniform(0.0, FASTEST), draw.uniform(0.0, FASTEST)] for _ in range(INTERVALS)]


def parse(description: str) -> argparse.Namespace:
    """The command line of a program that searches: a criterion, and how many starts."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("criterion", choices=sorted(BEST_KNOWN))
    parser.add_argument("--starts", type=int, default=STARTS)
    parser.add_argument("--option", default="", help="the peer's own variant, where it has some")
    return parser.parse_args()


def answer(inputs: list[list[float]], said: str, waste: float = 0.0) -> None:
    """Print one design found.

    Args:
        inputs: wheel speeds (INTERVALS, 2) [rad/s].
        said: what the program itself says of its search.
        waste: time [s] that is not the program's fault, to be taken off.
    """
    print(json.dumps({"inputs": inputs, "said": said, "waste": waste, "at": time.time()}), flush=True)


def give_up(why: str) -> None:
    """Print why there is no design."""
    print(json.dumps({"skipped": why}), flush=True)

"""The paths people drive today, made to fit a study: what a design is compared with.

A pattern is a list of moves (straights, arcs, spins), each driven from rest to rest. It is made as large
as the limits allow and stretched in time to the study's duration; a second variant has the path length of
a given design, as the paper's comparison has.
"""

from oed.robots.baselines.paths import baselines
from oed.robots.baselines.patterns import NAMES, PATTERNS, RANDOM, BaselineName, Move, Pattern
from oed.robots.baselines.suitability import baseline_flaws, suited

__all__ = [
    "NAMES",
    "PATTERNS",
    "RANDOM",
    "BaselineName",
    "Move",
    "Pattern",
    "baseline_flaws",
    "baselines",
    "suited",
]

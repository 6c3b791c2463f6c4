"""The paths people drive today, made to fit a study: what a design is compared with.

A pattern is a list of moves (straights, arcs, spins), each driven from rest to rest. It is made as large
as the limits allow and stretched in time to the study's duration; a second variant has the path length of
a given design, as the paper's comparison has.
"""

from oed.robots.baselines.baseline import Baseline as Baseline
from oed.robots.baselines.baseline import PythonBaseline as PythonBaseline
from oed.robots.baselines.paths import baselines as baselines
from oed.robots.baselines.paths import label as label
from oed.robots.baselines.paths import refusal as refusal
from oed.robots.baselines.paths import suited as suited
from oed.robots.baselines.paths import try_baselines as try_baselines
from oed.robots.baselines.patterns import NAMES as NAMES
from oed.robots.baselines.patterns import PATTERNS as PATTERNS
from oed.robots.baselines.patterns import RANDOM as RANDOM
from oed.robots.baselines.patterns import BaselineName as BaselineName
from oed.robots.baselines.patterns import Move as Move

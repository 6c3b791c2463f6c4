"""Is the predicted precision what a simulation gives?"""

from oed.simulation.checks import Check
from oed.simulation.linearisation import Linearisation
from oed.simulation.monte_carlo import Validation, validate

__all__ = ["Check", "Linearisation", "Validation", "validate"]

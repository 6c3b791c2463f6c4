"""Is the promised precision what a simulation gives?"""

from oed.validation.checks import Check
from oed.validation.monte_carlo import Validation, validate

__all__ = ["Check", "Validation", "validate"]

"""The type of a CasADi expression in signatures."""

from typing import Any, TypeAlias

Expression: TypeAlias = Any
"""A `casadi.SX`, `casadi.MX` or `casadi.DM`: formulas are written once and serve all three."""

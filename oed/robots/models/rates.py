"""What the rates of a robot's inputs are called."""

from __future__ import annotations

from oed.kernel.dynamics.system import Input

RATES = {
    "wheel_speed": "wheel_acceleration",
    "steering_angle": "steering_rate",
    "commanded_speed": "commanded_acceleration",
    "commanded_yaw_rate": "commanded_yaw_acceleration",
    "throttle": "throttle_rate",
}
"""Quantity of an input -> what its rate is called, where that has a name of its own."""


def rate_of(entry: Input) -> str:
    """What the derivative of an input is called, by which limits on that are named."""
    return RATES.get(entry.quantity, f"rate_of_{entry.quantity}")

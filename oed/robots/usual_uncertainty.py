"""Usual ranges that the parameters of a robot lie in before it is calibrated, by kind of parameter."""

from __future__ import annotations

from oed.foundation.quantities import parse_quantity
from oed.kernel.dynamics.system import Parameter
from oed.robots.models.model import Model

RADII, LENGTHS, DYNAMICS, ANGLES = "2 %", "4 %", "5 %", "1 deg"
"""Half-widths of the ranges of wheel radii and gains, lengths, constants of the dynamics, and angles."""
EFFECTIVE, LEAST, MOST = 1.8, 1.4, 2.4
"""Effective track of a robot that skids, as a multiple of the wheels' distance: usual, least and most."""
WIDENED = ("track", "y_icr_left", "y_icr_right")
"""Parameters of robots that skid which skidding widens."""


def usual_uncertainty(model: Model) -> dict[str, str | tuple[str, str]]:
    """Return usual ranges of a robot's parameters, by name, as the study's key `uncertainty` has them.

    Parameters that are 0 and have no scale are left out: there is nothing that a share could be of.
    """
    amounts = {parameter.name: _amount(parameter, model.skids) for parameter in model.parameters}
    return {name: amount for name, amount in amounts.items() if amount}


def _amount(parameter: Parameter, skids: bool) -> str | tuple[str, str]:
    if skids and parameter.name in WIDENED:
        low, high = sorted(parameter.nominal * times / EFFECTIVE for times in (LEAST, MOST))
        return f"{low:.3g} m", f"{high:.3g} m"
    if parameter.unit == "rad":
        return ANGLES
    share = _share(parameter)
    if parameter.nominal:
        return share
    size = parse_quantity(share, "") * parameter.scale
    return f"{size:.2g} {parameter.unit}".strip() if size else ""


def _share(parameter: Parameter) -> str:
    if not parameter.unit or parameter.name.startswith("wheel_radius"):
        return RADII
    return LENGTHS if parameter.unit == "m" else DYNAMICS

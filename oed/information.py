"""Information matrices: how much a measurement says about its parameters, in the scaling chosen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import casadi as ca
import numpy as np
import numpy.typing as npt
from pydantic import Field

from oed.errors import Flaw
from oed.expression import Expression
from oed.measurements.measurement import Block

Scale = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Scaling = Literal["relative", "none"] | Mapping[str, Scale]


def information(block: Block, scaling: Scaling) -> Expression:
    """F = D W' W D / sigma^2 (p, p), with D the parameters' scales.

    `relative` scales by the nominal values, so that lambda_min^(-1/2) is the worst relative standard
    deviation; a mapping gives a scale per parameter; `none` is the paper's raw W'W, neither scaled nor
    divided by the noise.
    """
    scales = ca.DM(scale_factors(block, scaling))
    scaled = block.design_matrix @ ca.diag(scales)
    return scaled.T @ scaled


def scale_factors(block: Block, scaling: Scaling) -> npt.NDArray[np.float64]:
    """Factor (p,) of each column of W, the noise included."""
    if scaling == "none":
        return np.ones(len(block.parameters))
    # A block without noise is refused when the problem is made; see `scaling_flaws`.
    noise = 1.0 if block.noise is None else block.noise
    if scaling == "relative":
        return np.abs(block.nominal) / noise
    return np.array([scaling[name] for name in block.parameters]) / noise


def scaling_flaws(blocks: tuple[Block, ...], scaling: Scaling) -> list[Flaw]:
    """What keeps `scaling` from being applied to these blocks; [] if nothing."""
    if scaling == "none":
        return []
    flaws = []
    for block in blocks:
        if block.noise is None:
            text = f"the {block.name} noise is needed to weigh the information (or use scaling: none)"
            flaws.append(Flaw(("measurement", "noise"), text))
        if scaling == "relative":
            zero = [name for name, value in zip(block.parameters, block.nominal, strict=True) if value == 0]
            if zero:
                text = f"{', '.join(zero)} is nominally 0 and has no relative precision; give its scale"
                flaws.append(Flaw(("criterion", "scaling"), text))
    if isinstance(scaling, Mapping):
        flaws += _scale_name_flaws([name for block in blocks for name in block.parameters], scaling)
    return flaws


def _scale_name_flaws(names: list[str], scaling: Mapping[str, float]) -> list[Flaw]:
    flaws = []
    for name in names:
        if name not in scaling:
            flaws.append(Flaw(("criterion", "scaling"), f"the scale of {name} is missing"))
    for name in scaling:
        if name not in names:
            text = f"{name} is not estimated here; the parameters are {', '.join(names)}"
            flaws.append(Flaw(("criterion", "scaling", name), text))
    return flaws

"""What inputs are held at in the periods of a trial, from the unknowns of their signals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .splines import clamped_run

Array = npt.NDArray[Any]


def unknowns_of(signal: Mapping[str, Any]) -> int:
    """How many unknowns a signal has in a trial."""
    kind = signal["kind"]
    if kind == "constant":
        return 1
    if kind == "spline":
        return int(signal["coefficients"]) - (2 if signal.get("rest_to_rest") else 0)
    if kind == "fourier":
        return 1 + 2 * int(signal["harmonics"])
    return int(signal["pieces"]) + (kind == "piecewise_linear")


def held(signal: Mapping[str, Any], unknowns: Array, duration: float, samples: int) -> Array:
    """Values (N,) in the middles of the periods."""
    kind, middles = signal["kind"], (np.arange(samples) + 0.5) / samples
    if kind == "constant":
        return np.full(samples, unknowns[0])
    if kind == "piecewise_constant":
        # A middle on an edge belongs to the piece that begins there.
        return unknowns[(np.floor(middles * len(unknowns) + 1e-9)).astype(int)]
    if kind == "piecewise_linear":
        return np.interp(middles, np.linspace(0, 1, len(unknowns)), unknowns)
    if kind == "spline":
        rest = np.zeros(1 if signal.get("rest_to_rest") else 0)
        table = np.concatenate([rest, unknowns, rest])[:, None]
        return clamped_run(duration, int(signal["degree"]), table, np.zeros(0), samples).held[:, 0]
    mean, cosines, sines = unknowns[0], *np.split(unknowns[1:], 2)
    angles = 2 * np.pi * middles * duration / signal.get("period", duration)
    orders = np.arange(1, len(cosines) + 1)
    waves = [
        one * np.cos(n * angles) + two * np.sin(n * angles)
        for n, one, two in zip(orders, cosines, sines, strict=True)
    ]
    return mean + np.sum(waves, axis=0)

"""Arcs: how a constant twist moves a pose over a period, and where a robot is on its way."""

from __future__ import annotations

import math
from typing import Literal

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression

Integration = Literal["arc", "midpoint"]

FULL_TURN = 2 * math.pi - 0.05
"""Turn [rad] from which a chord says too little of its arc."""
MOST_TURNS = 0.75
"""Turns in a period at most that a mean speed is corrected for: its chord vanishes at 1."""
LATERAL = 0.01
"""Share of its way that a drive goes sideways, above which its robot counts as one of those."""
TURN = 0.05
"""Largest turn between two places that are drawn [rad]: arcs look round."""
FINEST = 40
"""Places drawn between two samples at most."""


def sinc(angle: Expression) -> Expression:
    """sin(angle) / angle, by its series near 0, so that every derivative is finite there."""
    magnitude = ca.fabs(angle)
    small = magnitude < 0.02
    square = angle * angle
    # Products, for quotients take several times as long.
    series = 1 - square * (1 / 6) * (1 - square * (1 / 20) * (1 - square * (1 / 42)))
    # Of the magnitude: what stands in for small ones is on the same side of 0, so that bounds stay finite.
    return ca.if_else(small, series, ca.sin(magnitude) / ca.if_else(small, 1, magnitude))


def chord(
    yaw_rate: Expression, heading: Expression, period: Expression, integration: Integration
) -> tuple[Expression, Expression]:
    """How a sample's speed moves the pose: (gain [s], direction [rad]); displacement = gain * R(direction) v.

    `arc` is exact for a constant twist: the chord of the arc has length factor sinc(T Omega / 2).
    `midpoint` is the paper's rule, gain T [Choi, eq. 8].

    Args:
        yaw_rate: of the period [rad/s].
        heading: at its begin [rad].
        period: [s].
        integration: the rule.
    """
    half_turn = 0.5 * period * yaw_rate
    gain = period * sinc(half_turn) if integration == "arc" else period + 0 * half_turn
    return gain, heading + half_turn


def after_arc(
    state: Expression, twist: Expression, further: Expression, period: Expression, integration: Integration
) -> Expression:
    """The state (states,) after a period.

    Args:
        state: at its begin, (states,).
        twist: constant in it, (3,).
        further: next values of the states after (x, y, heading).
        period: [s].
        integration: the rule.
    """
    forward, lateral, yaw_rate = ca.vertsplit(twist)
    gain, direction = chord(yaw_rate, state[2], period, integration)
    cosine, sine = ca.cos(direction), ca.sin(direction)
    return ca.vertcat(
        state[0] + gain * (forward * cosine - lateral * sine),
        state[1] + gain * (forward * sine + lateral * cosine),
        state[2] + period * yaw_rate,
        further,
    )


def between(first: Array, last: Array, shares: Array) -> Array:
    """States (..., k, states) at shares of the time from one state to the next, on the arc between them.

    The chord to a share s of an arc that turns by a is s sinc(s a/2) / sinc(a/2) of the whole chord, turned
    back by (1 - s) a/2; states other than x and y change evenly.

    Args:
        first: state, or many at once, (..., states).
        last: as many, (..., states).
        shares: of the time between them, (k,).
    """
    way = last - first
    found: Array = first[..., None, :] + shares[:, None] * way[..., None, :]
    bent = np.abs(way[..., 2, None]) < FULL_TURN
    turn = np.where(bent, way[..., 2, None], 0.0)
    chord = (way[..., 0, None] + 1j * way[..., 1, None]) / np.sinc(turn / (2 * np.pi))
    parts = shares * np.sinc(shares * turn / (2 * np.pi)) * chord * np.exp(-0.5j * (1 - shares) * turn)
    found[..., 0] = np.where(bent, first[..., 0, None] + parts.real, found[..., 0])
    found[..., 1] = np.where(bent, first[..., 1, None] + parts.imag, found[..., 1])
    return found


def moves(poses: Array) -> tuple[Array, Array]:
    """Ways (N,) [m] along and across the mean heading of every period.

    A robot without lateral speed has no second one, whether it is moved by chords of arcs or by the midpoint
    rule.
    """
    x, y, angle = np.diff(poses[:, :3], axis=0).T
    middle = poses[:-1, 2] + angle / 2
    return x * np.cos(middle) + y * np.sin(middle), y * np.cos(middle) - x * np.sin(middle)


def signed_speeds(poses: Array, period: float, integration: Integration, sideways: bool) -> Array:
    """Mean speed of each period (N,) [m/s] along its arc or chord: negative backwards, but never sideways.

    Args:
        poses: (N + 1, states).
        period: [s].
        integration: the rule they were integrated by.
        sideways: whether the robot drives sideways.
    """
    x, y, angle = np.diff(poses[:, :3], axis=0).T
    speeds = np.hypot(x, y) / period
    if integration == "arc":
        speeds = speeds / np.sinc(np.clip(angle / (2 * np.pi), -MOST_TURNS, MOST_TURNS))
    return np.asarray(speeds) if sideways else np.where(moves(poses)[0] >= 0, speeds, -speeds)


def goes_sideways(poses: Array, least: float) -> bool:
    """Whether a robot drives sideways as well: by `least` [m] and more than rounding's share of its way."""
    lateral = float(np.abs(moves(poses)[1]).sum())
    length = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
    return lateral > max(least, LATERAL * length)


def finer(poses: Array) -> Array:
    """States (n, states) so close in time that straight lines between them look like the arcs of poses."""
    sharpest = float(np.abs(np.diff(poses[:, 2])).max(initial=0.0))
    steps = int(np.clip(math.ceil(sharpest / TURN), 1, FINEST))
    shares = np.arange(steps) / steps
    each = between(poses[:-1], poses[1:], shares)
    return np.vstack([each.reshape(-1, poses.shape[1]), poses[-1]])

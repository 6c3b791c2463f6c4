"""How far noise of the inputs may have pulled estimates away: errors in variables, regression dilution.

A fit takes inputs as they were logged. Noise in them (ticks, jitter of their times, commands that the robot
does not follow) moves the predicted motion, and correlates with what this motion is compared with: the less a
log drives what identifies a parameter, the more of that is noise, and the smaller its effect seems [Fuller,
Measurement Error Models, 1987; Carroll et al., Measurement Error in Nonlinear Models, 2006]. How large the
noise is no log says for sure; but it shows in residuals that are larger than the noise of the poses alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from oed.estimation.assessment.doubts import Doubt
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gauss_newton import projected
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.setup.noise import group_of, groups, in_turn, places_of
from oed.foundation.arrays import ROUNDING, Array, Bools
from oed.foundation.text import significant, size_text, words
from oed.kernel.measurement.square_root import SquareRoot

DRAWS, DRAWN = 4, 4000
"""Of noise, that its effects are averaged over at most; and the readings in all of them that are enough."""
SMALL = 1e-3
"""Least noise that is drawn, relative to the inputs' root mean square: effects are then in proportion."""
MOST = 0.9
"""Share of the information in any direction that noise of the inputs is taken to make up at most."""
ALL = 0.99 * MOST
"""Share of noise of the inputs from which on the information on an unknown may be nothing else."""
OUTLYING = 10.0
"""Times their median that third differences are jumps, not noise."""
WORTH_SAYING = 1.0
"""Bias in standard errors from which on it is said."""
BEYOND_HELP = 0.5
"""Share of noise from which on the nominal value may be nearer than the estimate."""
STENCIL = np.array([1.0, -3.0, 3.0, -1.0])
"""Third differences: smooth motion leaves next to nothing in them, white noise 20 times its variance."""
SPREAD = 2.15
"""Standard error of a variance by third differences, relative to it, times the root of their number."""


Kind = Literal["rates", "readings"]
"""Of noise: of each period's input, or of what the inputs have added up to."""


@dataclass(frozen=True)
class Dilution:
    """What noise of the inputs may have done to estimates.

    Attributes:
        moves: of the estimates, at most, (q, k), SI: what it has done to all of them together, and what it
            may have done along each direction of which the information may be nothing else.
        shares: of the information on each unknown that may be noise, (q,); 1 of parameters that such
            directions take to their own size.
    """

    moves: Array
    shares: Array

    @property
    def bias(self) -> Array:
        """Estimates less what they would be without it, at most, (q,), SI; signs of moves are independent."""
        return np.asarray(np.copysign(np.linalg.norm(self.moves, axis=1), self.moves.sum(axis=1)))

    def lost(self, names: Sequence[str]) -> set[str]:
        """Return those of the parameters whose information may be noise alone."""
        return {name for name, share in zip(names, self.shares, strict=False) if share == 1}

    def widened(self, matrix: Array) -> Array:
        """Return a covariance (q, q) that allows for its moves, whose directions are believed and whose sizes
        are not: combinations that none of them changes stay as sure as they were.
        """
        return np.asarray(matrix + self.moves @ self.moves.T)


def dilution_of(fit: Fit, seed: int = 0) -> Dilution | None:
    """The most that noise of the inputs can have done to a fit over segments.

    The noise is white, of each input as large as its high frequencies say beside the others', and as large as
    the residuals leave room for beside the poses' own noise. None of fits that hold no readings of segments.

    Args:
        fit: of all logs.
        seed: of the noise that is drawn.
    """
    if fit.motions or not fit.layout.logs:
        return None
    effects, count = _Effects(fit), fit.unknowns.size
    noise, slope, rng = np.zeros((count, count)), np.zeros(count), np.random.default_rng([seed, DRAWS])
    draws = int(np.clip(np.ceil(DRAWN / max(fit.layout.valid.sum(), 1)), 1, DRAWS))
    for kind, room in effects.room().items():
        made, turned, along = np.zeros(len(room)), np.zeros((count, count)), np.zeros(count)
        for _ in range(draws):
            moved, slopes = effects.of(kind, rng)
            made += effects.judged(moved**2)
            turned += np.einsum("sia,sib->ab", slopes, slopes)
            along += np.einsum("sia,si->a", slopes, moved)
        # No reading may hold more of it than it has room for.
        each = (left / own for left, own in zip(room, made, strict=True) if own > 0 and np.isfinite(left))
        largest = min(each, default=0.0)
        noise, slope = noise + largest * turned, slope + largest * along
    return _dilution(fit, noise, slope)


def _dilution(fit: Fit, noise: Array, slope: Array) -> Dilution:
    # The root of the corrected score, with the share of noise in every direction held below 1; nothing along
    # what is not identifiable.
    factor, scale = SquareRoot.of_matrix(fit.total).factor, fit.unknowns.scale
    in_directions, vectors = np.linalg.eigh(factor.T @ noise @ factor)
    back, left = factor @ vectors, 1 - np.clip(in_directions, 0.0, MOST)
    before, after = (back**2).sum(axis=1), (back**2 / left).sum(axis=1)
    ratio = np.divide(before, after, out=np.ones_like(before), where=after > 0)
    relative, is_noise = back / scale[:, None], in_directions > MOST
    # Noise cannot make up more than all of the information in any direction: there is so much less of it.
    part = 1 / max(1.0, float(in_directions.max(initial=0.0)))
    other, smaller = back[:, ~is_noise], part * in_directions[~is_noise]
    # A direction is believed, its length is not; each is held back by itself, and not for another's unknowns.
    most = _most(other / scale[:, None])
    together = other @ np.clip(-part * (other.T @ slope) / (1 - smaller), -most, most)
    # What noise alone has led away from the nominal values may as well be as near to them as these directions
    # lead, which any combinations of them span.
    spanned = np.linalg.svd(relative[:, is_noise], full_matrices=False)[0]
    apart = ((fit.values - fit.unknowns.nominal) / scale) @ spanned
    alone = spanned * np.copysign(np.maximum(np.abs(apart), _most(spanned)), apart)
    reaches = np.linalg.norm(alone, axis=1) >= 1 - ROUNDING
    is_parameter = np.arange(len(scale)) < len(fit.unknowns.parameters)
    shares = np.where(is_parameter & reaches & (1 - ratio >= ALL), 1.0, 1 - ratio)
    return Dilution(np.column_stack([together, scale[:, None] * alone]), shares)


def _most(relative: Array) -> Array:
    # How far to go along directions of the unknowns in their sizes (q, k), (k,): beyond its own size nobody
    # looks for any.
    largest = np.abs(relative).max(axis=0, initial=0.0)
    return np.asarray(np.divide(1.0, largest, out=np.full_like(largest, np.inf), where=largest > 0))


@dataclass(frozen=True)
class _Effects:
    # Of noise in the inputs on the readings of a fit, and on their derivatives.
    fit: Fit

    def of(self, kind: Kind, rng: np.random.Generator) -> tuple[Array, Array]:
        # Of one draw: what it adds to predicted readings (S, m) and to their derivatives (S, m, q), in units
        # of their noise, each segment's start eliminated. Errors of rates add up, those of readings do not.
        fit, (found, slopes) = self.fit, self._undisturbed
        steps = fit.layout.steps[..., None]
        if kind == "rates":
            added = np.sqrt(steps) * rng.standard_normal(self._inputs.shape)
        else:
            added = np.diff(
                rng.standard_normal((steps.shape[0], steps.shape[1] + 1, len(self._sizes))), axis=1
            )
        noise = self._sizes * np.divide(added, steps, out=np.zeros_like(added), where=steps > 0)
        there, turned = self._readings.disturbed(fit.values, fit.starts, noise)
        both = np.concatenate([(there - found)[..., None], turned - slopes], axis=-1)
        left, _ = projected(self._white(both), self._own)
        return left[..., 0], left[..., 1:]

    def judged(self, each: Array) -> Array:
        # The sum of what every reading has (S, m), of each kind of readings that the noise is judged by.
        every = each.reshape(*self.fit.white.shape)
        return np.array([every[..., own].sum() for own in self._judges])

    def room(self) -> dict[Kind, list[float]]:
        # The most that residuals hold besides the readings' own noise, for each kind that judges.
        rooms = [self._room(own) for own in self._judges]
        return {kind: [one[kind] for one in rooms] for kind in ("readings", "rates")}

    def _room(self, own: list[int]) -> dict[Kind, float]:
        # Summed in units of the noise. What is rough in residuals is noise of readings, what is not is noise
        # of rates. The sensor's own noise is rough, too, and shows in its readings themselves.
        fit = self.fit
        valid = fit.layout.valid[..., own]
        total = float((fit.weights * fit.white**2)[..., own][valid].sum())
        degrees = float(fit.redundancy[..., own][valid].sum())
        poses, left = (
            _rough(one[..., own] / self._deviations[..., own], valid)
            for one in (fit.layout.readings, fit.residuals)
        )
        unsure = left[0] * SPREAD / np.sqrt(max(left[1], 1))
        rough, smooth = left[0] - min(poses[0], left[0]), total / max(degrees, 1e-9) - left[0]
        return {
            "readings": degrees * (max(rough, 0.0) + unsure) if left[1] else np.inf,
            "rates": degrees * (max(smooth, 0.0) + unsure),
        }

    @cached_property
    def _judges(self) -> list[list[int]]:
        # Headings show turns that the inputs do not explain; positions show slip of all kinds besides.
        states, every = self.fit.layout.states, self.fit.layout.quantities
        kinds = groups(states)
        of_poses = ["heading"] if "heading" in kinds else list(kinds[:1])
        return [places_of(kind, every) for kind in (*of_poses, *groups(every[len(states) :]))]

    @cached_property
    def _undisturbed(self) -> tuple[Array, Array]:
        return self._readings.disturbed(self.fit.values, self.fit.starts, np.zeros_like(self._inputs))

    @cached_property
    def _own(self) -> Array:
        # Derivatives by each segment's start.
        return self._white(self._readings.derivatives(self.fit.values, self.fit.starts)[2])

    @cached_property
    def _readings(self) -> LoggedReadings:
        return LoggedReadings.of(self.fit.layout, self.fit.unknowns, self.fit.offsets)

    @cached_property
    def _inputs(self) -> Array:
        return self.fit.layout.inputs(self.fit.clock_offsets)

    @cached_property
    def _sizes(self) -> Array:
        # Of the noise that is drawn, at one second, (inputs,): inputs of a kind alike, and all of them small.
        fit, inputs, driven = self.fit, self._inputs, self.fit.layout.steps > 0
        each = [inputs[..., [place]] for place in range(inputs.shape[-1])]
        rough = np.array([_rough(one, driven[..., None])[0] for one in each])
        whole = (inputs[driven] ** 2).mean(axis=0)
        kinds = np.array([entry.quantity for entry in fit.unknowns.robot.inputs])
        rough, whole = (np.array([one[kinds == kind].mean() for kind in kinds]) for one in (rough, whole))
        shares = np.maximum(rough, SMALL**2 * whole)
        largest = (shares / np.where(whole > 0, whole, 1.0)).max()
        usual = float(np.median(fit.layout.steps[driven]))
        return np.asarray(SMALL * np.sqrt(shares * usual / (largest or 1.0)))

    @cached_property
    def _deviations(self) -> Array:
        fit = self.fit
        each = [
            fit.noises[group_of(name)].deviation(fit.speeds, fit.yaw_rates) for name in fit.layout.quantities
        ]
        alone = 1.0 if fit.layout.averaged is None else np.sqrt(fit.layout.averaged)
        return np.asarray(np.stack(each, axis=-1) / alone)

    def _white(self, values: Array) -> Array:
        # Of readings (S, K, k, c) in units of their noise, below each other, (S, m, c).
        fit = self.fit
        scale = np.where(fit.layout.valid, np.sqrt(fit.weights) / self._deviations, 0.0)
        return np.asarray((values * scale[..., None]).reshape(len(values), -1, values.shape[-1]))


def _rough(values: Array, valid: Bools) -> tuple[float, int]:
    # The variance (S, K, c) by third differences of what there is, outliers left out, and how many there are.
    length = len(STENCIL)
    if valid.shape[1] < length:
        return 0.0, 0
    there, (values,) = in_turn(valid, values)
    count = valid.shape[1] - length + 1
    found = sum(weight * values[:, first : first + count] for first, weight in enumerate(STENCIL))
    sizes = np.abs(np.asarray(found)[there[:, length - 1 :]])
    kept = sizes[sizes <= OUTLYING * np.median(sizes)] if sizes.size else sizes
    return (float((kept**2).mean() / (STENCIL @ STENCIL)), kept.size) if kept.size else (0.0, 0)


def dilution_doubts(fit: Fit, found: Dilution, covariance: Array) -> tuple[Doubt, ...]:
    """Parameters whose estimates noise of the inputs may have moved by much of their standard errors.

    Args:
        fit: of all logs.
        found: what the noise may have done.
        covariance: of all unknowns without that, (q, q), SI.
    """
    unknowns, errors = fit.unknowns, np.sqrt(np.diag(covariance))
    each = zip(
        unknowns.parameters, unknowns.units, fit.values, errors, found.bias, found.shares, strict=False
    )
    return tuple(
        Doubt(name, "input_noise", _sentence(name, unit, value, bias, share))
        for name, unit, value, error, bias, share in each
        if abs(bias) > WORTH_SAYING * error
    )


def _sentence(name: str, unit: str, value: float, bias: float, share: float) -> str:
    larger = "large" if abs(value) > abs(value - bias) else "small"
    text = (
        f"{words(name)} may be too {larger} by up to {size_text(abs(bias), unit, 2)}, for which its standard "
        f"error allows: noise of the inputs can be {significant(2)(100 * share)} % of the motion that "
        "identifies it, which the logs hardly drive"
    )
    nearer = " (until then the nominal value may be nearer)" if share > BEYOND_HELP else ""
    return f"{text}; drive more of it, such as `oed next` designs{nearer}"

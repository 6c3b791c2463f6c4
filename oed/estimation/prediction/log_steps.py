"""Whole logs, step by step: where the next one begins, and what is read in each, linear about a path.

Readings may be so many that several are taken together: the mean of what is read in a step stands for them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.prediction.logged_readings import POSE, LoggedReadings
from oed.estimation.setup.unknowns import Unknowns
from oed.foundation.arrays import Array, Places
from oed.kernel.measurement.process_noise import spread
from oed.robots.models.model import Model
from oed.robots.sensors.drift import USUAL, amounts_of


class Stretch(NamedTuple):
    """A stretch of a log in K steps, the last of no duration: all derivatives are by (unknowns, 1), the last
    column what the path, or a reading, is predicted to be off.

    Attributes:
        row: which of the stretches it is.
        clock: whose inputs drive it, among the unknown ones; -1 where they are known.
        onward: of the next step's begin by this one's, (K, 3, 3).
        moved: of the next step's begin, (K, 3, q + 1).
        effect: of it by an error of the motion, ahead, to the left, turned, (K, 3, 3).
        amounts: path [m], turning [rad] and time [s] of each step, (K, 3).
        seen: of what is read by the step's begin, (K, k, 3), SI.
        read: of what is read directly, (K, k, q + 1), SI.
        within: share of the step's drift that each sees, and deviation of what it sees of the drift besides,
            in that of the whole, (K, k, 2); 0 where it is read at the begin.
        counts: how many readings each is the mean of, (K, k); 0 of none.
        headings: at the steps' begins, (K,).
    """

    row: int
    clock: int
    onward: Array
    moved: Array
    effect: Array
    amounts: Array
    seen: Array
    read: Array
    within: Array
    counts: Array
    headings: Array


@dataclass(frozen=True)
class LogSteps:
    """Stretches of logs, each of them driven without a break.

    Attributes:
        whole: the stretches.
        together: how many readings a step takes together.
        unknowns: common to them.
        offsets: of the clocks, as far as known, (clocks,) [s].
    """

    whole: SegmentLayout
    together: int
    unknowns: Unknowns
    offsets: Array

    @cached_property
    def begins(self) -> tuple[Places, ...]:
        """Where each stretch's steps begin on its grid of times, the last at its end."""
        return tuple(np.append(np.arange(0, last, self.together), last) for last in self.whole.last)

    def about(self, values: Array, paths: list[Array]) -> Iterator[Stretch]:
        """What is linear about a path.

        Args:
            values: of the unknowns, (q,).
            paths: poses (K, 3) at the steps' begins, stretch by stretch.
        """
        starts = np.concatenate(paths)
        found, slopes, own = self._readings.derivatives(values, starts)
        following, carried, by_start = self._states(values, starts)
        effects, amounts = self._errors(values, starts)
        layout, size = self._layout, self.unknowns.size
        left = np.concatenate([slopes, (found - layout.readings)[..., None]], axis=-1)
        seen, read = self._mean(own), self._mean(left)
        counts, edges = layout.valid.sum(axis=1), np.cumsum([0, *map(len, self.begins)])
        for row, (path, begin, end) in enumerate(zip(paths, edges, edges[1:], strict=False)):
            own_rows = slice(begin, end)
            moved = np.concatenate([carried[own_rows], np.zeros((end - begin, POSE, 1))], axis=-1)
            moved[:-1, :, size] = following[begin : end - 1] - path[1:]
            yield Stretch(
                row,
                int(self.whole.clock[row]) if self.unknowns.clocks else -1,
                by_start[own_rows],
                moved,
                effects[own_rows],
                amounts[own_rows],
                seen[own_rows],
                read[own_rows],
                self._within[own_rows],
                counts[own_rows].astype(float),
                path[:, 2],
            )

    def rates(self, values: Array, paths: list[Array]) -> list[tuple[Array, Array]]:
        """Speeds [m/s] and yaw rates [rad/s] of the steps, stretch by stretch."""
        amounts, seconds = self._errors(values, np.concatenate(paths))[1], self._layout.steps.sum(axis=1)
        each = amounts[:, :2] / np.maximum(seconds, 1e-9)[:, None]
        edges = np.cumsum([len(one) for one in self.begins])[:-1]
        return [(one[:, 0], one[:, 1]) for one in np.split(each, edges)]

    @cached_property
    def _layout(self) -> SegmentLayout:
        # Each step a segment, of what is read in it from its begin up to the next one's.
        whole, owner, places, read = self.whole, [], [], []
        ahead = np.arange(self.together + 1)
        for number, begins in enumerate(self.begins):
            last = int(whole.last[number])
            at = begins[:, None] + ahead
            own = (ahead < self.together) & (at < last)
            own[-1, 0] = True
            owner.append(np.full(len(begins), number))
            places.append(np.minimum(at, np.append(begins[1:], last)[:, None]))
            read.append(own)
        row, at = np.concatenate(owner)[:, None], np.concatenate(places)
        return replace(
            whole,
            owner=whole.owner[row[:, 0]],
            times=whole.times[row, at],
            readings=whole.readings[row, at],
            valid=whole.valid[row, at] & np.concatenate(read)[..., None],
            averaged=None,
        )

    @cached_property
    def _readings(self) -> LoggedReadings:
        return LoggedReadings.of(self._layout, self.unknowns, self.offsets)

    @cached_property
    def _within(self) -> Array:
        # Drift within a step is a random walk in time. The mean of its values at shares f of the step has the
        # slope mean f by its value at the end, and the variance mean min(f, f') in all.
        times, valid = self._layout.times, self._layout.valid
        lasting = times[:, -1:] - times[:, :1]
        passed = (times - times[:, :1]) / np.where(lasting > 0, lasting, 1.0)
        each = valid / np.maximum(valid.sum(axis=1, keepdims=True), 1)
        share = np.einsum("sn,snk->sk", passed, each)
        both = np.minimum(passed[:, :, None], passed[:, None, :])
        whole = np.einsum("snk,snm,smk->sk", each, both, each)
        return np.stack([share, np.sqrt(np.maximum(whole - share**2, 0.0))], axis=-1)

    def _states(self, values: Array, starts: Array) -> tuple[Array, Array, Array]:
        # Where the robot's origin is at the steps' ends, (K, 3), and derivatives by the unknowns, of which
        # the sensor's place is none, and by the begins.
        unknowns = self.unknowns
        place = [unknowns.names.index(name) for name in unknowns.place]
        kept = np.setdiff1d(np.arange(unknowns.size), place)
        placed = replace(unknowns, place=(), sits=(0.0,) * len(unknowns.sits))
        every = LoggedReadings.of(self._layout, placed, self.offsets).reading(*unknowns.robot.states)
        found, slopes, own = every.derivatives(values[kept], starts)
        carried = np.zeros((len(starts), POSE, unknowns.size))
        carried[..., kept] = slopes[:, -1]
        return found[:, -1], carried, own[:, -1]

    def _errors(self, values: Array, starts: Array) -> tuple[Array, Array]:
        # Effects of errors of the steps' motions, (K, 3, 3), and amounts (K, 3) that these grow with.
        layout, (parameters, _, clocks) = self._layout, self.unknowns.parts(values)
        steps, lengths = layout.steps, layout.steps.sum(axis=1)
        inputs = layout.inputs(self.offsets + clocks if len(clocks) else self.offsets)
        mean = (inputs * steps[..., None]).sum(axis=1) / np.maximum(lengths, 1e-9)[:, None]
        robot, count = self.unknowns.robot, len(starts)
        given = starts.T, mean.T, np.tile(parameters[:, None], count), np.maximum(lengths, 1e-9)[None]
        effect = np.array(_effect(robot).map(count)(*given)).reshape(POSE, count, -1).transpose(1, 0, 2)
        amounts = np.array(amounts_of(robot).map(count)(*given)).T
        resting = (lengths <= 0)[:, None]
        return np.where(resting[..., None], 0.0, effect), np.where(resting, 0.0, amounts)

    def _mean(self, values: Array) -> Array:
        # Of what is read in each step, (K, k, ...), 0 of nothing.
        valid = self._layout.valid[..., None]
        total = np.where(valid, values, 0.0).sum(axis=1)
        return np.asarray(total / np.maximum(valid.sum(axis=1), 1))


def _effect(robot: Model) -> ca.Function:
    # What an error of a period's motion does to the pose after it, whatever its size.
    whole = spread(USUAL, robot)
    given = [ca.SX.sym(whole.name_in(place), *whole.size_in(place)) for place in range(whole.n_in())]
    return ca.Function("effect", given, [ca.densify(whole(*given)[0])])

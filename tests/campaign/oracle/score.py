"""The score of a drive: objective, eigenvalues, standard deviations, length; and how far to trust them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .criteria import predicted, value
from .information import FAINT, NOTHING, Told, eliminated, sandwich
from .motion import drive
from .readings import Block, blocks_of
from .robots import Robot, robot_of, through_coefficients
from .splines import Run

Array = npt.NDArray[Any]

SHAKEN, MOVED = 1e-11, 1e-3
"""Share of the largest input by which all are changed; share of an eigenvalue by which that may change it if
rounding, some 1e-15 of the inputs, is not to reach a millionth of it."""
STANDING = 1e-10
"""Share of the largest change of the readings by any parameter below which another may change them
by rounding alone: nobody can say what hides behind it."""
STEEP = 1e7
"""lambda_max / lambda_min above which rounding of F itself may reach a millionth of lambda_min."""


@dataclass(frozen=True)
class Score:
    """What the oracle says of a drive.

    Attributes:
        objective: in the study's criterion.
        lambda_min, lambda_max: over all blocks.
        deviations: standard deviation of each estimated parameter, SI.
        path_length: of the origin [m].
        sort: "well" conditioned, "singular" beyond doubt, or "unclear" between the two.
    """

    objective: float
    lambda_min: float
    lambda_max: float
    deviations: Mapping[str, float]
    path_length: float
    sort: str


def estimated_robot(study: Mapping[str, Any]) -> Robot:
    """The robot with the parameters that a study estimates: its own, or its coefficients."""
    robot = robot_of(study["robot"])
    return robot if set(study.get("estimate") or ()) <= set(robot.names) else through_coefficients(robot)


def score(study: Mapping[str, Any], runs: Sequence[Run]) -> Score:
    """Score a drive by a study, SI."""
    criterion = study.get("criterion", {"kind": "E"})
    robot, rule = estimated_robot(study), study["trajectory"].get("integration", "arc")
    found = _estimates(study, runs)
    told = [one.judged_information() for one in found]
    sort = sort_of(told)
    if sort == "well" and not _steady(study, runs, told):
        sort = "unclear"
    if sort == "singular" and any(one.standing for one in found):
        sort = "unclear"
    deviations: dict[str, float] = {}
    for one in found:
        deviations |= one.deviations() if sort == "well" and one.block.noise is not None else {}
    smallest = min(float(one.eigenvalues[-1]) for one in told)
    largest = max(float(one.eigenvalues[0]) for one in told)
    objective = np.nan
    if sort == "well":
        rows = [one.predictions(robot, runs[0].period) for one in found] if criterion["kind"] in "GI" else ()
        objective = value(criterion["kind"], told, rows)
    return Score(objective, smallest, largest, deviations, path_length(robot, runs, rule), sort)


def _estimates(study: Mapping[str, Any], runs: Sequence[Run]) -> list[Estimate]:
    rule = study["trajectory"].get("integration", "arc")
    blocks = blocks_of(study["measurement"], estimated_robot(study), runs, rule)
    return [one for one in (Estimate(study, block) for block in blocks) if one.judged]


def _steady(study: Mapping[str, Any], runs: Sequence[Run], told: Sequence[Told]) -> bool:
    # Whether the information is more than what rounding of the inputs leaves: as of wheels that stand but for
    # that, or of displacements that cancel.
    rng = np.random.default_rng(0)
    size = max(float(np.abs(run.coefficients).max()) for run in runs)
    shaken = [
        replace(
            run, coefficients=run.coefficients + SHAKEN * size * rng.uniform(-1, 1, run.coefficients.shape)
        )
        for run in runs
    ]
    return steady(told, [one.judged_information() for one in _estimates(study, shaken)])


def steady(told: Sequence[Told], others: Sequence[Told]) -> bool:
    """Whether information is about what it is of inputs that are shaken by `SHAKEN`."""
    return all(
        np.allclose(one.eigenvalues, other.eigenvalues, rtol=MOVED, atol=0)
        for one, other in zip(told, others, strict=True)
    )


def sort_of(told: Sequence[Told]) -> str:
    """How far information is to be trusted: "well", "singular" or "unclear"."""
    weakest = min(one.weakest for one in told)
    clear = all(one.clear for one in told)
    steep = max(float(one.eigenvalues[0] / max(one.eigenvalues[-1], 1e-300)) for one in told)
    if clear and weakest > FAINT and steep < STEEP:
        return "well"
    return "singular" if clear and weakest < NOTHING else "unclear"


def path_length(robot: Robot, runs: Sequence[Run], rule: str) -> float:
    """How far the origin goes [m]: its speed is constant in every period."""
    return sum(run_length(robot, run, rule) for run in runs)


def run_length(robot: Robot, run: Run, rule: str) -> float:
    """The same of one run."""
    nominal = [np.array([[entry]]) for entry in robot.values]
    start = [np.array([[entry]]) for entry in [*run.start, *[0.0] * (len(robot.states) - 3)]]
    mean = drive(robot, run.held, start, nominal, run.period, rule).mean
    return float(np.hypot(mean[0], mean[1]).sum() * run.period)


class Estimate:
    """One block of readings, with what is estimated and judged of it."""

    def __init__(self, study: Mapping[str, Any], block: Block) -> None:
        self.criterion = study.get("criterion", {"kind": "E"})
        self.block = block
        wanted = study.get("estimate") or block.names
        estimated = [name for name in wanted if name in block.names]
        subset = self.criterion.get("subset")
        self.judged = [name for name in estimated if subset is None or name in subset]
        self.names = [*self.judged, *(name for name in estimated if name not in self.judged)]
        self.places = [block.names.index(name) for name in self.names]
        self.prior = _prior_rows(study.get("prior"), self.names, block)

    @property
    def standing(self) -> bool:
        """Whether some parameter changes the readings by rounding alone, as that of a wheel that stands."""
        block = self.block
        changes = np.linalg.norm(block.rows[:, : len(block.names)], axis=0) * block.sizes
        own = changes[self.places]
        return bool(np.any((own > 0) & (own < STANDING * changes.max())))

    @property
    def scales(self) -> Array:
        """Of the judged parameters."""
        scaling = self.criterion.get("scaling", "relative")
        if scaling == "none":
            return np.ones(len(self.judged))
        if scaling == "relative":
            return self.block.sizes[self.places[: len(self.judged)]]
        return np.array([scaling[name] for name in self.judged], dtype=float)

    def judged_information(self) -> Told:
        """In the criterion's scaling."""
        raw = self.block.raw and self.criterion.get("scaling", "relative") == "none"
        return self._information(len(self.judged), self.scales, 1.0 if raw else self.block.noise)

    def deviations(self) -> dict[str, float]:
        """Standard deviations of all estimated parameters; none where some are not told."""
        told = self._information(len(self.names), np.ones(len(self.names)), self.block.noise)
        if told.weakest <= FAINT:
            return {}
        lengths = np.linalg.norm(told.root, axis=0)
        inverse = np.linalg.inv(told.root / lengths)
        found = np.linalg.norm(inverse, axis=1) / lengths
        return dict(zip(self.names, found.tolist(), strict=True))

    def predictions(self, robot: Robot, longest: float) -> Array:
        """What G and I judge, by the scaled parameters, in steps of at most so long [s]."""
        named = robot if set(self.judged) <= set(robot.names) else through_coefficients(robot)
        rows = predicted(named, self.criterion, longest)
        return rows[:, :, [named.names.index(name) for name in self.judged]] * self.scales

    def _information(self, kept: int, scales: Array, noise: float | None) -> Told:
        block, size = self.block, len(self.names)
        if block.spread is not None:
            return self._of_ordinary_least_squares(kept, scales, noise)
        rows = block.rows[:, [*self.places, *range(len(block.names), block.rows.shape[1])]] / (noise or 1.0)
        known = np.isfinite(block.known)
        beforehand = np.diag(1 / np.where(known, block.known, np.inf))
        more = np.zeros((len(self.prior) + len(beforehand), rows.shape[1]))
        more[: len(self.prior), :size] = self.prior
        more[len(self.prior) :, size:] = beforehand
        whole = np.vstack([rows, more])
        return eliminated(whole, range(kept), range(kept, whole.shape[1]), scales)

    def _of_ordinary_least_squares(self, kept: int, scales: Array, noise: float | None) -> Told:
        assert self.block.spread is not None
        every = np.ones(len(self.names))
        told = sandwich(self.block.rows[:, self.places] / (noise or 1.0), self.block.spread, every)
        rows = np.vstack([told.root, self.prior])
        reduced = eliminated(rows, range(kept), range(kept, rows.shape[1]), scales)
        # Estimates of nothing have no covariance that a prior could be added to; nor do they keep some of the
        # estimates from being told where the others are not.
        alone = kept == len(self.names) and not len(self.prior)
        clear = reduced.clear and (told.weakest > FAINT or alone)
        return Told(reduced.root, np.minimum(reduced.strengths, told.weakest), clear)


def _prior_rows(prior: Mapping[str, Any] | None, names: Sequence[str], block: Block) -> Array:
    # Rows whose squares are the information had beforehand.
    if not prior:
        return np.zeros((0, len(names)))
    if "standard_deviations" in prior:
        given = prior["standard_deviations"]
        rows = np.zeros((len(names), len(names)))
        for place, name in enumerate(names):
            if name in given:
                rows[place, place] = 1 / _deviation(given[name], block.nominal[block.names.index(name)])
        return rows
    own = [place for place, name in enumerate(prior["parameters"]) if name in names]
    covariance = np.array(prior["covariance"], dtype=float)[np.ix_(own, own)]
    rows = np.zeros((len(own), len(names)))
    columns = [list(names).index(prior["parameters"][place]) for place in own]
    rows[:, columns] = np.linalg.inv(np.linalg.cholesky(covariance)) if own else 0.0
    return rows


def _deviation(given: Any, nominal: float) -> float:
    # A share of the nominal value is written as {"share": 0.02}.
    return given["share"] * abs(nominal) if isinstance(given, Mapping) else float(given)

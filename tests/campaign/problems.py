"""Random problems, judged: the package's score, verdict on limits and certificates against the oracle's."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import oed
from oed.kernel import results, scorer
from oed.workflow.studies import parse_study

from .cases import Verdict, quoted
from .generator.drives import Drive, draw_drive, draw_polygon, draw_seemingly_feasible, pinched
from .generator.quantities import one_of, plain
from .generator.studies import Study, draw_study
from .oracle.limits import Excess, excesses
from .oracle.score import Score, score
from .oracle.splines import Run, clamped_run
from .searches import LONGEST, searched

Rng = np.random.Generator

AGREED = 1e-6
"""Share by which scores may differ on a well-conditioned drive."""
TOLERANCE: float = results.TOLERANCE
"""Share of a limit's size that the scorer says it tolerates."""
ROUNDING = 1e-9
"""Share of what is added up that rounding may take from a distance."""
CORNER = 1.01e-9
"""Speed [m/s] over which the scorer rounds a path length's corner at rest."""
LONGER = 1e-4
"""Speed [m/s] by which a limit on path length may see a robot faster, as its documentation states."""
CLEARLY = 3e-3
"""Share of its size by which a limit is kept so clearly that it must not be called broken."""
SEARCHED, BOUNDED, PINCHED = 0.06, 0.4, 0.35
"""Shares of problems that are searched, bounded, and drawn around a drive."""
SEARCHABLE = 400
"""Unknowns of a search at most: of more, a minute of search is work and no hang."""
READ, SCORED, SINGULAR = "valid studies are read", "scores agree", "undetermined is -inf"
FEASIBLE, INFEASIBLE = "kept is kept", "broken is broken"
BOUND = "no score above its certificate"


def problem_case(rng: Rng) -> Iterator[Verdict]:
    """One random problem and some drives of it."""
    study, drives = _drawn(rng)
    try:
        problem = parse_study(study.text(rng), "campaign.yaml").problem
    except oed.UserMistake as error:
        yield Verdict(READ, quoted(str(error)))
        return
    yield Verdict(READ)
    judged = [_Judged(study, problem, drive) for drive in drives]
    if rng.random() < SEARCHED and _unknowns(problem) <= SEARCHABLE:
        own = [trajectory_of(problem, drive) for drive in drives if not drive.polygon]
        design, verdicts = searched(rng, problem, own)
        yield from verdicts
        judged += [] if design is None else [_Judged(study, problem, drive_of(design))]
    for one in judged:
        yield from one.verdicts()
    if rng.random() < BOUNDED and study.spec["criterion"]["kind"] == "E":
        yield from _bounded(problem, judged)


def _unknowns(problem: oed.Problem) -> int:
    return int(problem.design.all_coefficients) * len(problem.model.inputs)


def _drawn(rng: Rng) -> tuple[Study, list[Drive]]:
    study, drives = draw_study(rng), []
    if rng.random() < PINCHED:
        study, drive = pinched(rng, study)
        drives.append(drive)
    else:
        drives.append(draw_seemingly_feasible(rng, study))
    drives.append(one_of(rng, (draw_drive, draw_seemingly_feasible, draw_polygon))(rng, study))
    return study, drives


def drive_of(trajectory: oed.Trajectory) -> Drive:
    """A trajectory of a study's space as the oracle knows it."""
    duration, samples = trajectory.duration / trajectory.runs, trajectory.samples // trajectory.runs
    parts = np.split(np.asarray(trajectory.coefficients), trajectory.runs)
    runs: list[Run] = [
        clamped_run(duration, trajectory.degree, part, start[:3], samples)
        for part, start in zip(parts, trajectory.starts, strict=True)
    ]
    return Drive(tuple(runs))


def trajectory_of(problem: oed.Problem, drive: Drive) -> oed.Trajectory:
    """The package's trajectory of a drive."""
    states = problem.start_states(drive.starts)
    if not drive.polygon:
        return problem.design.trajectory(drive.coefficients, states)
    rest, runs = problem.design.rest_to_rest, problem.design.runs
    whole = problem.design.whole_duration
    return oed.Trajectory.from_samples(drive.held, whole, states, rest_to_rest=rest, runs=runs)


@dataclass(frozen=True)
class _Judged:
    """A drive, scored by both."""

    study: Study
    problem: oed.Problem
    drive: Drive

    @cached_property
    def spec(self) -> dict[str, Any]:
        return dict(plain(self.study.spec))

    @cached_property
    def said(self) -> oed.Evaluation:
        """What the package says."""
        return scorer.score(self.problem, trajectory_of(self.problem, self.drive))

    @cached_property
    def true(self) -> Score:
        """What the oracle says."""
        return score(self.spec, self.drive.runs)

    @cached_property
    def limits(self) -> list[Excess]:
        """How far each limit is exceeded at most."""
        return excesses(self.spec, self.drive.runs)

    def verdicts(self) -> Iterator[Verdict]:
        """Everything the two disagree about."""
        if self.true.sort == "well":
            yield from self._scores()
        elif self.true.sort == "singular":
            yield from self._singular()
        yield from self._broken()

    def _scores(self) -> Iterator[Verdict]:
        said, true, kind = self.said, self.true, self.spec["criterion"]["kind"]
        pairs = {
            f"objective {kind}": (said.objective, true.objective),
            "lambda_min": (said.lambda_min, true.lambda_min),
            "lambda_max": (said.lambda_max, true.lambda_max),
            "path length": (said.path_length, true.path_length),
            **{
                f"deviation of {name}": (said.standard_deviations.get(name, math.nan), size)
                for name, size in true.deviations.items()
            },
        }
        for name, (one, other) in pairs.items():
            # log det is a sum of logarithms: what is a share elsewhere is an amount there.
            least = 1.0 if name == "objective D" else 0.0
            spare = CORNER * self.said_duration if name == "path length" else 0.0
            agreed = abs(one - other) <= AGREED * max(abs(other), least) + spare
            yield Verdict(SCORED, "" if agreed else f"{name}: {one:.9g}, the oracle says {other:.9g}")

    @property
    def said_duration(self) -> float:
        """Of all runs [s]."""
        return sum(run.duration for run in self.drive.runs)

    def _singular(self) -> Iterator[Verdict]:
        kind, objective = self.spec["criterion"]["kind"], self.said.objective
        expected = {"E": 0.0, "D": -math.inf, "A": -math.inf, "modified_E": -math.inf}
        if kind in expected:
            right = objective == expected[kind] or (kind == "E" and objective <= 1e-9 * self.said.lambda_max)
            yield Verdict(
                SINGULAR, "" if right else f"{kind} {objective:.4g} where parameters are undetermined"
            )

    def _broken(self) -> Iterator[Verdict]:
        margins = {margin.name: margin for margin in self.said.margins}
        for one in self.limits:
            margin, rounding = margins[one.limit], self._rounding(one.limit)
            if margin.satisfied:
                right = one.amount <= TOLERANCE * min(one.size, margin.size) + rounding
                text = f"{one.limit} exceeded by {one.amount:.4g} (size {one.size:.4g}), called kept"
                yield Verdict(FEASIBLE, "" if right else text)
            else:
                spare = CLEARLY * one.size + rounding
                # A length is rounded upwards, by a tenth of a millimetre per second.
                spare += LONGER * self.said_duration if one.limit == "path_length" else 0.0
                text = f"{one.limit} kept with {-one.amount:.4g} to spare (size {one.size:.4g})"
                broken = f"{text}, called broken by {margin.violation:.4g}"
                yield Verdict(INFEASIBLE, "" if one.amount >= -spare else broken)

    def _rounding(self, limit: str) -> float:
        places = ("workspace", "obstacles", "end_position", "path_length")
        return ROUNDING * (self.study.size + self.true.path_length) if limit in places else 0.0

    @property
    def exactly_feasible(self) -> bool:
        """Whether every limit is kept without any tolerance."""
        return self.said.feasible and all(one.amount <= 0 for one in self.limits)


def _bounded(problem: oed.Problem, judged: list[_Judged]) -> Iterator[Verdict]:
    certificate = oed.bound(problem, time_limit=LONGEST)
    # A certificate without a widened one says nothing of drives within the tolerance only.
    looser = getattr(certificate, "widened", None)
    widened = None if looser is None else looser.upper_bound
    for one in judged:
        if not one.said.feasible or any(run.samples != problem.design.samples for run in one.drive.runs):
            continue
        exact = one.exactly_feasible
        limit = certificate.upper_bound if exact or widened is None else widened
        if exact or widened is not None:
            text = f"{one.said.objective:.6g} above {limit:.6g} ({certificate.method})"
            yield Verdict(BOUND, "" if one.said.objective <= limit * (1 + AGREED) else text)

"""Random experiments with systems of equations, judged: scores, limits, weights and certificates."""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import oed
from oed.kernel import results, scorer
from oed.kernel.evaluation import times_finer
from oed.optimize.selection import select
from oed.workflow.studies import parse_study

from .cases import Verdict, quoted
from .generator.experiments import ExperimentStudy, draw_experiment_study
from .generator.trials import draw_trial, draw_unknowns, draw_weights, groups_of, samples_of, signals_of
from .oracle.equations import NotSolved
from .oracle.experiments import Experiment, Trial, score, shaken
from .oracle.limits import Excess
from .oracle.score import Score
from .oracle.signals import held
from .searches import searched

Rng = np.random.Generator

AGREED = 1e-6
"""Share by which scores may differ on a well-conditioned experiment."""
TOLERANCE: float = results.TOLERANCE
CLEARLY = 3e-3
"""Share of its size by which a limit is kept so clearly that it must not be called broken."""
FINE, SAMPLED = 32, 10
"""Points in each period that limits are looked at; those where the scorer says it looked at points only."""
SEARCHED, BOUNDED = 0.06, 0.3
"""Shares of studies that are searched, and bounded."""
SEARCHABLE, PERIODS = 120, 16
"""Unknowns and periods of a search at most: of more, a minute of search is work and no hang."""
TRIED = 12
"""Choices of readings that the best one is compared with."""
GIVEN_UP = 1e-6
"""Share of a criterion that the best weights may be short of others."""
READ, SCORED, SINGULAR = "valid studies are read", "scores agree", "undetermined is -inf"
FEASIBLE, INFEASIBLE, HELD = "kept is kept", "broken is broken", "signals agree"
BOUND, CHOSEN, WHOLE = (
    "no score above its certificate",
    "no weights above the best",
    "whole weights are whole",
)
GAP = "gap not below 0"


def experiment_case(rng: Rng) -> Iterator[Verdict]:
    """One random study and some experiments of it."""
    study = draw_experiment_study(rng)
    try:
        problem = parse_study(study.text(rng), "campaign.yaml").problem
    except oed.UserMistake as error:
        # A system that is not stable may be predicted beyond all numbers; then the oracle knows none either.
        unbounded = "are not finite: predict less far" in str(error) and not _predictable(rng, study)
        yield Verdict(READ, "" if unbounded else quoted(str(error)))
        return
    yield Verdict(READ)
    yield from _signals(rng, study, problem)
    judged = [JudgedTrial(study, problem, _drawn(rng, study)) for _ in range(2)]
    if "weights" in study.spec:
        yield from _selected(rng, judged[0])
    if rng.random() < SEARCHED and _searchable(problem):
        own = [one.trajectory for one in judged]
        design, verdicts = searched(rng, problem, own)
        yield from verdicts
        judged += [] if design is None else [JudgedTrial(study, problem, trial_of(design))]
    for one in judged:
        yield from one.verdicts()
    if rng.random() < BOUNDED:
        yield from _bounded(problem, judged)


def _predictable(rng: Rng, study: ExperimentStudy) -> bool:
    followed = Experiment(study.spec, _drawn(rng, study))
    try:
        with np.errstate(all="ignore"):
            true = score(followed, shaken(followed))
    except NotSolved:
        return False
    return true.sort == "well" and math.isfinite(true.objective)


def _drawn(rng: Rng, study: ExperimentStudy) -> Trial:
    trial = draw_trial(rng, study.spec)
    if "weights" not in study.spec:
        return trial
    return replace(trial, weights=draw_weights(rng, study.spec, trial))


def _searchable(problem: oed.Problem) -> bool:
    design, states = problem.design, len(problem.model.states)
    count = sum(one.unknowns * design.runs for one in getattr(design, "signals", ())) + states * design.runs
    # Implicit steps of many states are written out, and take minutes.
    implicit = getattr(problem.model, "integrator", "") == "radau" and states
    return count <= SEARCHABLE and design.all_samples <= PERIODS and not implicit


def trial_of(trajectory: oed.Trajectory) -> Trial:
    """A trajectory as the oracle knows it."""
    runs, starts = trajectory.runs, trajectory.starts
    table = np.asarray(trajectory.inputs).reshape(runs, trajectory.samples // runs, -1)
    return Trial(table, np.asarray(starts), trajectory.duration / runs, trajectory.weights)


def trajectory_of(problem: oed.Problem, trial: Trial) -> oed.Trajectory:
    """The package's trajectory of a trial."""
    table = trial.held.reshape(trial.trials * trial.samples, trial.held.shape[2])
    found = problem.design.trajectory(table, problem.start_states(trial.starts))
    knots = found.knots * (trial.duration * trial.trials / found.duration)
    return replace(found, knots=knots, weights=trial.weights)


def _signals(rng: Rng, study: ExperimentStudy, problem: oed.Problem) -> Iterator[Verdict]:
    # What unknowns of a signal hold.
    signals = getattr(problem.design, "signals", ())
    if not signals:
        return
    own = zip(signals, signals_of(study.spec).items(), strict=True)
    for said, (name, signal) in own:
        low, high = study.spec["experiment"]["inputs"][name]["range"]
        unknowns = draw_unknowns(rng, signal, low, high)
        duration, samples = problem.design.duration, samples_of(study.spec)
        apart = np.abs(said.matrix(duration, samples) @ unknowns - held(signal, unknowns, duration, samples))
        wrong = apart.max() > 1e-9 * max(abs(low), abs(high))
        yield Verdict(HELD, f"{name}, {signal}: {apart.max():.3g} apart" if wrong else "")


@dataclass(frozen=True)
class JudgedTrial:
    """An experiment, scored by both."""

    study: ExperimentStudy
    problem: oed.Problem
    trial: Trial

    @cached_property
    def trajectory(self) -> oed.Trajectory:
        """As the package knows it."""
        return trajectory_of(self.problem, self.trial)

    @cached_property
    def said(self) -> oed.Evaluation:
        """What the package says."""
        return scorer.score(self.problem, self.trajectory)

    @cached_property
    def true(self) -> Score:
        """What the oracle says."""
        with np.errstate(all="ignore"):
            return score(self.followed, self.shaken)

    @cached_property
    def followed(self) -> Experiment:
        """By the oracle."""
        return Experiment(self.study.spec, self.trial)

    @cached_property
    def shaken(self) -> Experiment:
        """The same but for next to nothing."""
        return shaken(self.followed)

    @property
    def exceeded(self) -> set[str]:
        """Names of the limits that are exceeded."""
        with np.errstate(all="ignore"):
            return {one.limit for one in self.followed.excesses(SAMPLED) if one.amount > 0}

    def by_finer_steps(self, weights: Any) -> JudgedTrial:
        """The same by the integration steps that `evaluate` takes for these weights."""
        trajectory = replace(self.trajectory, weights=weights)
        times = times_finer(self.problem if weights is not None else self.problem.unselected, trajectory)
        spec = deepcopy(self.study.spec)
        spec["system"]["substeps"] = times * self.followed.system.substeps
        return replace(self, study=replace(self.study, spec=spec), problem=self.problem.refined(times))

    def weighted(self, weights: Any) -> JudgedTrial:
        """The same, its readings weighted otherwise."""
        found = JudgedTrial(self.study, self.problem, replace(self.trial, weights=weights))
        # What is followed does not depend on weights.
        own = {name: getattr(self, name).weighted(weights) for name in ("followed", "shaken")}
        found.__dict__.update(own)
        return found

    @cached_property
    def kind(self) -> str:
        """Of the criterion."""
        return str(self.study.spec["criterion"]["kind"])

    def verdicts(self) -> Iterator[Verdict]:
        """Everything the two disagree about."""
        try:
            true = self.true
        except NotSolved:
            return
        if not all(map(math.isfinite, (true.lambda_min, true.lambda_max))):
            return
        if true.sort == "well":
            yield from self._scores(true)
        elif true.sort == "singular":
            yield from self._singular()
        yield from self._broken()

    def _scores(self, true: Score) -> Iterator[Verdict]:
        said = self.said
        pairs = {
            f"objective {self.kind}": (said.objective, true.objective),
            "lambda_min": (said.lambda_min, true.lambda_min),
            "lambda_max": (said.lambda_max, true.lambda_max),
            **{
                f"deviation of {name}": (said.standard_deviations.get(name, math.nan), size)
                for name, size in true.deviations.items()
            },
        }
        for name, (one, other) in pairs.items():
            # log det is a sum of logarithms: what is a share elsewhere is an amount there.
            agreed = abs(one - other) <= AGREED * max(abs(other), 1.0 if name == "objective D" else 0.0)
            yield Verdict(SCORED, "" if agreed else f"{name}: {one:.9g}, the oracle says {other:.9g}")

    def _singular(self) -> Iterator[Verdict]:
        objective = self.said.objective
        expected = {"E": 0.0, "D": -math.inf, "A": -math.inf, "modified_E": -math.inf}
        if self.kind in expected:
            faint = self.kind == "E" and objective <= 1e-9 * self.said.lambda_max
            right = objective == expected[self.kind] or faint
            yield Verdict(
                SINGULAR, "" if right else f"{self.kind} {objective:.4g} of undetermined parameters"
            )

    @cached_property
    def margins(self) -> dict[str, oed.Margin]:
        """What the package says of limits."""
        return {margin.name: margin for margin in self.said.margins}

    def limits(self) -> list[Excess]:
        """How far each limit is exceeded at most."""
        found = self.followed
        certain = all(margin.certain for margin in self.said.margins)
        with np.errstate(all="ignore"):
            own = found.excesses(FINE if certain else SAMPLED)
        if "weights" in self.study.spec:
            spent, total = max(found.spent(), key=lambda pair: pair[0] / pair[1])
            own.append(Excess("weights", spent - total, total))
            most = float(self.study.spec["weights"].get("most", 1.0))
            weights = 1.0 if self.trial.weights is None else float(self.trial.weights.max())
            own.append(Excess("weight of a reading", weights - most, most))
        return own

    def _broken(self) -> Iterator[Verdict]:
        limits = self.limits()
        for name in set(self.margins) - {one.limit for one in limits}:
            # All is drawn within what the study leaves open.
            margin = self.margins[name]
            wrong = f"{name} of an experiment of the study, called broken by {margin.violation:.4g}"
            yield Verdict(INFEASIBLE, "" if margin.satisfied else wrong)
        for one in limits:
            margin = self.margins[one.limit]
            if margin.satisfied:
                right = one.amount <= TOLERANCE * min(one.size, margin.size) * (1 + 1e-6)
                text = f"{one.limit} exceeded by {one.amount:.4g} (size {one.size:.4g}), called kept"
                yield Verdict(FEASIBLE, "" if right else text)
            else:
                text = f"{one.limit} kept with {-one.amount:.4g} to spare (size {one.size:.4g})"
                broken = f"{text}, called broken by {margin.violation:.4g}"
                yield Verdict(INFEASIBLE, "" if one.amount >= -CLEARLY * one.size else broken)


def _selected(rng: Rng, judged: JudgedTrial) -> Iterator[Verdict]:
    # The best readings of a trial, beside others.
    found = select(judged.problem, judged.trajectory)
    weights = None if found is None else found.weights_of_readings
    # What is chosen is chosen by integration steps as fine as `evaluate` takes them.
    judged = judged.by_finer_steps(weights)
    with np.errstate(all="ignore"):
        draws = [draw_weights(rng, judged.study.spec, judged.trial) for _ in range(TRIED)]
        tried = [judged.weighted(weights) for weights in draws]
    best = judged.weighted(weights)
    # Weights are chosen within budgets of the study, and candidates that break a limit have none.
    broken = set() if found is None else best.exceeded
    within = [one for one in tried if one.exceeded <= broken]
    known = [one.true.objective for one in within if one.true.sort == "well"]
    if len(known) < TRIED // 2:
        return
    if found is None:
        yield Verdict(CHOSEN, f"{max(known):.9g} is known, and no choice said to be any good")
        return
    yield from best.verdicts()
    value, bound = best.said.objective, found.bound
    yield at_most(f"a choice of {max(known):.9g}", max(known), bound, judged.kind, BOUND)
    yield at_most(f"the chosen weights' {value:.9g}", value, bound, judged.kind, BOUND)
    relaxed = found.relaxed.value
    yield at_most(f"a choice of {max(known):.9g}", max(known), relaxed, judged.kind, CHOSEN)
    if found.exact is not None:
        yield whole(best)


def at_most(what: str, value: float, limit: float, kind: str, asked: str) -> Verdict:
    """Whether a criterion's value is no more than its limit, but for what searches leave."""
    spare = GIVEN_UP * max(abs(limit), 1.0 if kind == "D" else 0.0)
    return Verdict(asked, "" if value <= limit + spare else f"{kind}: {what} above {limit:.9g}")


def whole(best: JudgedTrial) -> Verdict:
    """Whether weights are whole numbers, alike in a group, that are the budget."""
    weights = np.asarray(best.trial.weights)
    each = [weights[list(own)] for own in groups_of(best.study.spec, best.trial)]
    alike = all(np.ptp(own) == 0 for own in each)
    whole = all(own[0] == round(own[0]) for own in each)
    spent = all(abs(one - total) <= 1e-9 * total for one, total in best.followed.spent())
    right = alike and whole and spent
    return Verdict(WHOLE, "" if right else f"weights {np.array2string(weights, precision=4)}")


def _bounded(problem: oed.Problem, judged: list[JudgedTrial]) -> Iterator[Verdict]:
    certificate = oed.bound(problem)
    for one in judged:
        if not one.said.feasible or not math.isfinite(one.said.objective) or one.said.objective == 0:
            continue
        if one.trial.samples != problem.design.samples:
            continue
        limit = certificate.bound_on(one.said)
        yield at_most(f"{one.said.objective:.9g}", one.said.objective, limit, one.kind, BOUND)
        gap = certificate.gap(one.said.objective, limit)
        yield Verdict(GAP, "" if gap >= -AGREED else f"{gap:.3g}, {one.said.objective:.9g} of {limit:.9g}")

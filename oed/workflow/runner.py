"""Run a study: every search, baseline and simulation it asks for, into a record."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import is_
from pathlib import Path

from oed.bounds import LATTICE, Certificate, bound
from oed.foundation.arguments import typed
from oed.foundation.extras import package_version
from oed.foundation.files import file_stem
from oed.foundation.work.folders import Draft
from oed.foundation.work.progress import Once
from oed.foundation.work.signals import interrupts_named
from oed.kernel.criteria import Criterion
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.solution import Solution, Status
from oed.optimize import Progress, Silent, Workers, solve
from oed.optimize.selection import rate_trajectory
from oed.records.outcomes import (
    nuisance_table,
    parameter_table,
    provenance,
    result_of,
    state_table,
)
from oed.records.path_file import trajectory_csv
from oed.records.record import FILE, Record
from oed.records.stored.departures import StoredDepartures
from oed.records.stored.door import FORMAT
from oed.records.stored.result import Result
from oed.records.stored.simulation import StoredTrial, StoredValidation
from oed.simulation.trial import require_ready
from oed.study.study import Study
from oed.workflow.after_search import Failures
from oed.workflow.certificates import certified
from oed.workflow.compared import compared
from oed.workflow.criteria import criteria_of, scores_by_criteria
from oed.workflow.departures import departures_on
from oed.workflow.experiments import driven_in_physics, simulated
from oed.workflow.from_baseline import left_out, searched_from_baseline
from oed.workflow.integration_steps import integration_notes, with_enough_steps
from oed.workflow.readings import readings_csv, selection_of
from oed.workflow.robustness import nominal_search, robustness, safe, tried
from oed.workflow.saving import RunFolder, run_folder
from oed.workflow.studies import Work, own_paths
from oed.workflow.usual_drift import usual_drift_deviations

PRACTICALLY_EQUAL = 2e-3
"""Share of the objective by which two designs may differ and still count as equally good."""
AGAINST = "comparison with baselines"
"""Name of that step."""
CUT_SHORT = "The run was interrupted; this is what had been done by then."
"""Note in the record of such a run."""


@typed
def run(
    study: Study,
    out: str | Path | Draft | None = None,
    *,
    seed: int | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
    search_only: bool = False,
) -> Record:
    """Do everything the study asks for. A step that fails after a search is noted in the record.

    Args:
        study: what to do.
        out: folder for record.json and the trajectories' CSV files, which replace those of an earlier run
            when all of them are there; an interrupted run is kept beside. Nothing is written without it.
        seed: instead of the study's.
        workers: processes, or a cluster; does not change the result.
        progress: informed how far the work is.
        search_only: do nothing but the searches.

    Raises:
        StudyError: the study designs no drive.
        UserMistake: `out` cannot be written to, or another process is writing there.
        NotSaved: it could not be written to in the end; the error has the record.
        WrongKind: no study.
    """
    study.require_designed()
    work = Work(study, study.seed if seed is None else seed, workers, progress or Silent())
    # What would fail at the end is better known before the work is done.
    paths = own_paths(study)
    with run_folder(out) as folder:
        running = _Run(work, paths, folder)
        if search_only:
            running.search()
        else:
            running.everything()
        running.simulate_departures()
        return folder.finish(*running.found(running.solutions, interrupted=running.interrupted))


@dataclass
class _Run:
    work: Work
    paths: dict[str, Trajectory]
    folder: RunFolder
    solutions: list[Solution] = field(default_factory=list)
    kept: list[Solution] = field(default_factory=list)
    certificate: Certificate | None = None
    validation: StoredValidation | None = None
    physics: StoredTrial | None = None
    departures: StoredDepartures | None = None
    interrupted: bool = False
    failures: Failures = field(default_factory=Failures)

    def everything(self) -> None:
        """All that the study asks for; an interrupt keeps what is done."""
        study = self.work.study
        if study.physics is not None:
            require_ready(study.problem, study.physics)
        self.search()
        try:
            with interrupts_named():
                if not self.interrupted:
                    self._compare()
                if not self.interrupted:
                    self._simulate()
        except KeyboardInterrupt:
            self.interrupted = True

    def search(self) -> None:
        """The searches; what follows them takes integration steps as fine as their designs need."""
        self.solutions, self.interrupted = search(self.work, self._keep, self.failures)
        self.work = replace(self.work, study=with_enough_steps(self.work.study, self.solutions))

    def simulate_departures(self) -> None:
        """Simulate how many robots leave the workspace on the drives that there are."""
        study = self.work.study
        best = self._best()
        try:
            with interrupts_named():
                self.departures = self.failures.attempt(
                    "simulation of robots that leave the workspace",
                    lambda: departures_on(study, self.solutions, best, self.work.seed),
                    None,
                )
        except KeyboardInterrupt:
            self.interrupted = True

    def _best(self) -> Solution | None:
        return best_of(safe(self.work.study, self.solutions), self.work.study.problem.criterion)

    def _compare(self) -> None:
        work, study, attempt = self.work, self.work.study, self.failures.attempt
        self.certificate = attempt("bound", lambda: _certificate(work), None)
        self.solutions += attempt(
            "score of the bound's own drive", lambda: _lattice_drive(study, self.certificate), []
        )
        searched = list(self.solutions)
        self.solutions += attempt(AGAINST, lambda: compared(work, self.paths, self._best()), [])
        self._try_robots()
        self._search_from_baseline(searched)

    def _try_robots(self) -> None:
        work = self.work
        self.solutions = self.failures.attempt(
            "check of robustness", lambda: tried(work, self.solutions), self.solutions
        )
        self._keep(self.solutions)

    def _search_from_baseline(self, searched: Sequence[Solution]) -> None:
        # Of drives that enough robots keep the limits on.
        work, attempt, best = self.work, self.failures.attempt, self._best()
        further, self.interrupted = attempt(
            "search from a baseline", lambda: searched_from_baseline(work, best), (list[Solution](), False)
        )
        if not further:
            return
        against = self.solutions[len(searched) :]
        if not self.interrupted:
            # Baselines of the same length as the best drive are now of another length.
            against = attempt(AGAINST, lambda: compared(work, self.paths, further[0]), against)
        self.solutions = [*searched, *further, *against]
        if not self.interrupted:
            self._try_robots()

    def _simulate(self) -> None:
        work, attempt = self.work, self.failures.attempt
        self.validation = attempt("validation", lambda: simulated(work, self.solutions), None)
        self.physics = attempt(
            "trial on a simulated robot", lambda: driven_in_physics(work, self.solutions), None
        )
        self.interrupted = self.physics is not None and self.physics.interrupted

    def _keep(self, solutions: Sequence[Solution]) -> None:
        # What is there already takes seconds to write again where there are thousands of readings.
        if len(solutions) == len(self.kept) and all(map(is_, solutions, self.kept)):
            return
        self.kept = list(solutions)
        self.folder.keep(lambda: self.found(solutions, interrupted=True)[1])

    def found(self, solutions: Sequence[Solution], *, interrupted: bool) -> tuple[Record, dict[str, str]]:
        """The record of solutions, and its files."""
        made = record(
            self.work.study,
            list(solutions),
            self.work.seed,
            named=self.folder.draft is not None,
            certificate=self.certificate,
            validation=self.validation,
            physics=self.physics,
            departures=self.departures,
            interrupted=interrupted,
            failures=self.failures,
        )
        return made, record_files(self.work.study, solutions, made)


def search(
    work: Work,
    found: Callable[[Sequence[Solution]], None] | None = None,
    failures: Failures | None = None,
) -> tuple[list[Solution], bool]:
    """Return the solutions of the study's searches, and whether an interrupt ended them early.

    The searches run one after the other, each with the solutions before it. One that fails after another is
    left out.

    Args:
        work: on the study.
        found: called with all solutions after each search.
        failures: takes the searches that failed.

    Raises:
        StudyError: parameters that no drive makes identifiable.
    """
    work.study.require_identifiable()
    # Of the first feasible drive a reader hears at once; what follows is for the end.
    listener, kept = Once(work.progress), failures or Failures()
    done: dict[str, Solution] = {}
    try:
        with interrupts_named():
            for solver in work.study.solvers:
                searched = partial(
                    solve,
                    work.study.problem,
                    solver,
                    seed=work.seed,
                    workers=work.workers,
                    progress=listener,
                    earlier=done,
                )
                # Without an earlier result there is nothing to keep.
                solution = kept.attempt(f"search {solver.label}", searched, None) if done else searched()
                if solution is None:
                    continue
                done[solution.name] = solution
                if solution.status is Status.INTERRUPTED:
                    return list(done.values()), True
                if found is not None:
                    found(list(done.values()))
            plain = partial(nominal_search, replace(work, progress=listener))
            return [*done.values(), *kept.attempt("search without back-off", plain, list[Solution]())], False
    except KeyboardInterrupt:
        return list(done.values()), True


def best_of(solutions: list[Solution], criterion: Criterion) -> Solution | None:
    """The feasible solution of largest objective; among practically equal ones the most informative.

    A search may give up a little of the objective to learn more in all other directions; one that did
    not is no better for it.
    """
    feasible = [(one, one.evaluation) for one in solutions if one.evaluation and one.evaluation.feasible]
    if not feasible:
        return None
    largest = max(evaluation.objective for _, evaluation in feasible)
    enough = criterion.concede(largest, 1 - PRACTICALLY_EQUAL)
    equal = [pair for pair in feasible if pair[1].objective >= enough]
    # A search by another criterion has given up nothing of this one on purpose.
    equal = [pair for pair in equal if pair[0].criterion is None] or equal
    return max(equal, key=lambda pair: pair[1].log_determinant)[0]


def record(
    study: Study,
    solutions: list[Solution],
    seed: int,
    *,
    named: bool = False,
    certificate: Certificate | None = None,
    validation: StoredValidation | None = None,
    physics: StoredTrial | None = None,
    departures: StoredDepartures | None = None,
    interrupted: bool = False,
    failures: Failures | None = None,
) -> Record:
    """The record of solutions.

    Args:
        study: that was run.
        solutions: of its searches and baselines.
        seed: of every random draw.
        named: whether it names the files of their trajectories.
        certificate: an upper bound.
        validation: simulated experiments.
        physics: a trial on a simulated robot.
        departures: robots that leave the workspace or hit an obstacle.
        interrupted: whether the run was.
        failures: steps that failed; those of the record itself that fail are added.
    """
    problem, best = study.problem, best_of(safe(study, solutions), study.problem.criterion)
    failures = failures or Failures()
    attempt = failures.attempt
    return Record.of(
        format=FORMAT,
        version=package_version("oed"),
        echo=study.echo(),
        study_text=study.text,
        seed=seed,
        inputs=problem.model.inputs,
        states=state_table(problem),
        parameters=parameter_table(problem),
        nuisances=nuisance_table(problem),
        results=_results(study, solutions, failures, named=named),
        named=None if best is None else best.name,
        certificate=None
        if certificate is None
        else attempt("gap to the bound", lambda: certified(study, certificate, solutions), None),
        robustness=attempt("report of robustness", lambda: robustness(study, solutions, seed), None),
        departures=departures,
        validation=validation,
        trial=physics,
        interrupted=interrupted,
        notes=[*_notes(certificate, interrupted), *integration_notes(best), *left_out(study, best)],
        failures=failures.sentences,
        provenance=provenance(study.source),
    ).of_study(study.file)


def _results(study: Study, solutions: Sequence[Solution], failures: Failures, *, named: bool) -> list[Result]:
    judges = criteria_of(study)
    return [
        result_of(
            solution,
            _file(solution) if named else None,
            failures.attempt(
                "score by further criteria",
                partial(scores_by_criteria, study, judges, solution),
                dict[str, float | None](),
            ),
            failures.attempt("table of readings", partial(selection_of, study.problem, solution), None),
            failures.attempt(
                "standard errors with usual drift",
                partial(usual_drift_deviations, study.problem, solution),
                dict[str, float](),
            ),
        )
        for solution in solutions
    ]


def record_files(study: Study, solutions: Sequence[Solution], made: Record) -> dict[str, str]:
    """The files of a record and of its solutions' trajectories, by name; the most important first.

    Args:
        study: of the solutions.
        solutions: whose trajectories are saved.
        made: the record.
    """
    drives = {
        _file(one): trajectory_csv(study.problem, one.trajectory, one.evaluation.states)
        for one in solutions
        if one.trajectory is not None and one.evaluation is not None
    }
    readings = {
        f"{file_stem(one.name)}_readings.csv": readings_csv(one.selection)
        for one in made.results
        if one.selection is not None
    }
    return {FILE: made.to_json(), **drives, **readings}


def _file(solution: Solution) -> str:
    return f"{file_stem(solution.name)}.csv"


def _certificate(work: Work) -> Certificate | None:
    if not work.study.file.bound:
        return None
    work.progress.begin("bound what any drive could reach", 1)
    certificate = bound(work.study.problem)
    work.progress.advance()
    return certificate


def _lattice_drive(study: Study, certificate: Certificate | None) -> list[Solution]:
    # The speeds that the bound's own search ended with are a candidate like any other.
    if certificate is None or certificate.drive is None:
        return []
    return [replace(rate_trajectory(study.problem, certificate.drive, LATTICE), kind=LATTICE)]


def _notes(certificate: Certificate | None, interrupted: bool) -> list[str]:
    # What the study asks for and was not done is said, never passed over.
    unbounded = certificate is not None and not math.isfinite(certificate.upper_bound)
    notes = [f"`bound: true`: {certificate.method}."] if certificate is not None and unbounded else []
    return notes + ([CUT_SHORT] if interrupted else [])

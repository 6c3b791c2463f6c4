"""How good was the path that was driven? Logs scored like designs, against the best one and the bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from oed.bounds import Certificate, bound, bound_on
from oed.foundation.arguments import typed
from oed.foundation.errors import LogError
from oed.foundation.work.folders import in_order
from oed.kernel.dynamics.system import System
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.solution import Solution
from oed.logs import Finding, Log, read_logs
from oed.logs.form import is_bag
from oed.optimize.selection import rate_trajectory
from oed.records.outcomes import parameter_table, result_of
from oed.records.path_file import read_trajectory
from oed.records.record import FILE, Record, load_record
from oed.records.stored.departures import StoredDepartures
from oed.records.stored.result import Result
from oed.records.stored.simulation import StoredRobustness
from oed.records.stored.study_record import StoredCertificate, StoredParameter
from oed.study.study import RobotStudyFile, Study
from oed.workflow.departures import departures_on
from oed.workflow.robustness import robustness, tried
from oed.workflow.studies import Work
from oed.workflow.usual_drift import usual_drift_deviations

Proved = Certificate | StoredCertificate
"""What is proved of all drives: those that satisfy the limits exactly, and those within the tolerance."""
MOVING = 0.02
"""Share of a log's fastest motion above which the robot is taken to move."""
MOST_SAMPLES = 5000
"""Of a log that is scored whole: more would take long, and say the same but for how often it is read."""
HEADER = 100_000
"""Characters of a file's first line that are looked at."""
SAME = ("robot", "trajectory", "measurement", "estimate", "prior", "weights", "limits", "criterion")
"""Keys of two studies that have to agree for their designs to be compared."""


@dataclass(frozen=True)
class DrivenPath:
    """A part of a log, as long as the study's drives, scored by the study's problem.

    Attributes:
        name: of the log and the part.
        seconds: how much of it is motion; the rest of the study's duration the robot is taken to stand [s].
        result: its numbers, as records hold them.
        efficiency: against the best design known, None where none is.
        share_of_bound: objective against what is proved that no drive exceeds.
    """

    name: str
    seconds: float
    result: Result
    efficiency: float | None
    share_of_bound: float | None


@dataclass(frozen=True)
class DrivenPaths:
    """What driven paths are worth.

    Attributes:
        paths: part by part, in order.
        best: name and objective of the best design known, or None.
        bound: what the objective of no drive that satisfies the limits exactly exceeds, or None.
        robustness: how many robots violate the limits on them, as a record has it; None where the study has
            no back-off.
        findings: by the name of the log, what was found in it.
        parameters: that the study estimates.
        design: the result of that best design, or None.
        departures: how many robots leave the workspace or hit an obstacle on a path, as a record has it; None
            of logs, which say what was driven.
    """

    paths: tuple[DrivenPath, ...]
    best: tuple[str, float] | None
    bound: float | None
    robustness: StoredRobustness | None = None
    findings: tuple[tuple[str, Finding], ...] = ()
    parameters: tuple[StoredParameter, ...] = ()
    design: Result | None = None
    departures: StoredDepartures | None = None

    def departing(self, path: DrivenPath) -> tuple[str, bool]:
        """Return how many robots leave on a path, in words ("" where unknown), and whether to warn."""
        name, departures = path.result.name, self.departures
        return ("", False) if departures is None else (departures.sentence(name), departures.warns(name))

    @property
    def first(self) -> DrivenPath:
        """The most informative part."""
        return max(self.paths, key=lambda one: -np.inf if (found := one.result.objective) is None else found)

    @property
    def data(self) -> dict[str, Any]:
        """Plain data: the most informative part's result, with what it and the others are worth."""
        worth = [
            {
                "name": one.name,
                "objective": one.result.objective,
                "seconds": one.seconds,
                "share_of_best": one.efficiency,
                "share_of_bound": one.share_of_bound,
            }
            for one in self.paths
        ]
        best = None if self.best is None else {"name": self.best[0], "objective": self.best[1]}
        known = {
            "best_design": best,
            "upper_bound": self.bound,
            "robustness": None if self.robustness is None else self.robustness.plain(),
            "departures": None if self.departures is None else self.departures.plain(),
        }
        findings = [{"log": name, **vars(one)} for name, one in self.findings]
        return {**self.first.result.plain(), "worth": worth, **known, "findings": findings}


@typed
def score_path(study: Study, file: str | Path, designs: str | Path | None = None) -> DrivenPaths:
    """Score a path (trajectory CSV), or what logs say was driven; see `score_logs`.

    A CSV with the columns `t` and the robot's inputs is a path; another file is a log where the study says
    how logs are read, or it is a bag.

    Args:
        study: that scores it.
        file: of the path, or logs.
        designs: folder of a record it is compared with.

    Raises:
        PathFileError: a path that cannot be read.
        LogError: a log that cannot be read, or in which the robot never moves.
    """
    if is_log(study, file):
        return score_logs(study, [file], designs)
    trajectory = read_trajectory(file, study.problem)
    # A path with other samples is measured otherwise, and compares with no design of the study.
    alike = trajectory.samples == study.problem.design.all_samples
    record = _record_of(study, designs) if alike else None
    best, proved = _known(record)
    (solution,) = tried(
        Work(study, study.seed), [rate_trajectory(study.problem, trajectory, Path(file).stem)]
    )
    worth = _worth(study, solution, trajectory.duration, best, proved, str(file))
    robots = robustness(study, [solution], study.seed)
    leaving = departures_on(study, [solution], None, study.seed)
    return DrivenPaths((worth,), best, _exact(proved), robots, departures=leaving, **_beside(study, record))


def is_log(study: Study, file: str | Path) -> bool:
    """Whether a file is to be read as a log rather than as a trajectory CSV.

    Without drives to be designed all of them are logs.
    """
    path = Path(file)
    if is_bag(path) or not study.problem.designed:
        return True
    if not isinstance(study.file, RobotStudyFile) or study.file.log is None or not path.is_file():
        return False
    with open(path, encoding="utf-8-sig", errors="replace") as handle:
        header = [cell.strip() for cell in handle.readline(HEADER).split(",")]
    return not {"t", *study.problem.model.input_names} <= set(header)


def score_logs(study: Study, files: Sequence[str | Path], designs: str | Path | None = None) -> DrivenPaths:
    """Score the paths that logs say were driven.

    Logs are cut to the study's duration and sampled as its drives are, so that they compare with designs
    and with the bound; they are taken to start where the study does. Of a study that designs no drive each
    log is scored whole, as often read as its poses are, and compared with nothing.

    Args:
        study: the problem, and how logs are read.
        files: the logs.
        designs: folder of a record of the same problem, whose best design they are compared with.

    Raises:
        LogError: logs that cannot be read, or in which the robot never moves.
    """
    logs = read_logs(files, study.log, study.problem.model, study.problem.measurement)
    record = _record_of(study, designs) if study.problem.designed else None
    robust = study.problem.robust
    # What was driven needs no tightened limits; and its objective is that of one robot.
    record = record if robust is None or robust.objective == "nominal" else None
    study = replace(study, problem=replace(study.problem, robust=None))
    known, certified = _known(record)
    proved = certified or _bounds(study)
    parts = [
        (own, *part) for log in logs for own in [_as_long(study, log)] for part in driven_parts(own, log)
    ]
    worth = tuple(
        _worth(own, rate_trajectory(own.problem, trajectory, name), seconds, known, proved)
        for own, name, trajectory, seconds in parts
    )
    findings = tuple((log.name, one) for log in logs for one in log.findings)
    return DrivenPaths(worth, known, _exact(proved), findings=findings, **_beside(study, record))


def _beside(study: Study, record: Record | None) -> dict[str, Any]:
    # What standard errors are of, and the design whose own they compare with.
    parameters = tuple(parameter_table(study.problem))
    return {"parameters": parameters, "design": None if record is None else record.best}


def _exact(proved: Proved | None) -> float | None:
    return None if proved is None else proved.upper_bound


def _known(record: Record | None) -> tuple[tuple[str, float] | None, StoredCertificate | None]:
    # The best design of a record, and the bounds it certifies.
    if record is None:
        return None, None
    best = record.best
    known = None if best is None or best.objective is None else (best.name, best.objective)
    return known, record.certificate


def _bounds(study: Study) -> Certificate | None:
    if not study.problem.designed:
        return None
    found = bound(study.problem)
    return found if np.isfinite(found.upper_bound) else None


def _record_of(study: Study, designs: str | Path | None) -> Record | None:
    # A record of another problem says nothing of this one.
    if designs is None or not (in_order(designs) / FILE).is_file():
        return None
    record, own = load_record(designs), study.echo()
    return record if all(record.echo.get(key) == own.get(key) for key in SAME) else None


def _worth(
    study: Study,
    solution: Solution,
    seconds: float,
    best: tuple[str, float] | None,
    proved: Proved | None,
    file: str | None = None,
) -> DrivenPath:
    usual = usual_drift_deviations(study.problem, solution)
    result, evaluation = result_of(solution, file, usual_drift=usual), solution.evaluation
    value, judged = result.objective, sum(len(one.judged) for one in study.problem.any_estimations)

    def share(of: float | None) -> float | None:
        if of is None or value is None:
            return None
        return study.problem.criterion.efficiency(value, of, judged)

    of_bound = None
    if proved is not None and evaluation is not None:
        widened = None if proved.widened is None else proved.widened.upper_bound
        of_bound = share(bound_on(evaluation, proved.upper_bound, widened))
    return DrivenPath(solution.name, seconds, result, share(None if best is None else best[1]), of_bound)


def driven_parts(study: Study, log: Log) -> list[tuple[str, Trajectory, float]]:
    """Name, drive and seconds of motion of each part of a log that is as long as the study's drives.

    The rest is left out; a log that is shorter is ended by standing still.

    Raises:
        LogError: nothing ever drives the robot.
    """
    problem, space = study.problem, study.problem.design
    fixed = problem.fixed_starts
    starts = problem.start_states(np.zeros((space.runs, 3))) if fixed is None else fixed
    first, last = _moving(log, problem.model)
    whole = space.duration * space.runs
    count = max(1, int((last - first) // whole))
    found = []
    for index in range(count):
        begin = first + index * whole
        edges = begin + space.period * np.arange(space.all_samples + 1, dtype=float)
        inputs = log.inputs_between(edges)
        inputs[edges[:-1] >= last] = 0.0
        name = f"{log.name} part {index + 1}" if count > 1 else log.name
        drive = Trajectory.from_samples(
            inputs, space.whole_duration, starts, rest_to_rest=space.rest_to_rest, runs=space.runs
        )
        found.append((name, drive, min(last - begin, whole)))
    return found


def _as_long(study: Study, log: Log) -> Study:
    # With drives as long as the log's motion and read as often as its poses, where it has none of its own.
    if study.problem.designed:
        return study
    first, last = _moving(log, study.problem.model)
    period = float(np.median(np.diff(log.pose_times)))
    samples = int(np.clip(round((last - first) / period), 1, MOST_SAMPLES))
    own = {"duration": last - first, "samples": samples, "rest_to_rest": False}
    space = study.file.space.model_copy(update=own)
    return replace(study, problem=replace(study.problem, design=space))


def _moving(log: Log, model: System) -> tuple[float, float]:
    # From when to when anything drives the robot, on the inputs' own clock.
    driving = [place for place, entry in enumerate(model.inputs) if entry.drives]
    steps = np.diff(log.input_times)
    speeds = np.abs(np.diff(log.integrals[:, driving], axis=0) / steps[:, None]).max(axis=1)
    rows = np.flatnonzero(speeds > MOVING * speeds.max())
    if not len(rows):
        raise LogError.about(log.file, "the robot never moves")
    return float(log.input_times[rows[0]]), float(log.input_times[rows[-1] + 1])

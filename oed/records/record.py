"""Everything a study produced, as plain data: saved as JSON, and a report's only input."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from oed.bounds import LOOSE, Certificate, gap
from oed.foundation.errors import FileFlaw, RecordError, UserMistake
from oed.foundation.files import write_text
from oed.foundation.work.folders import in_order, interrupted_runs
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import TOLERANCE, Evaluation
from oed.kernel.solution import Solution, Start
from oed.records.stored.consistency import require_one_study
from oed.records.stored.door import checked, read_object
from oed.records.stored.echo import checked_echo
from oed.records.stored.study_record import FORMAT as FORMAT
from oed.records.stored.study_record import StudyRecord
from oed.simulation import Validation

FILE = "record.json"
REPORT, ESTIMATE = "report", "estimate"
"""Names, without suffix, of the pages on a design and on an estimate; the latter's figures begin with it."""
RESULTS = (FILE, "estimate.json", "sweep.json")
"""Names of the files that hold what a run, an estimate and a sweep found."""


@dataclass(frozen=True)
class Record:
    """A study's outcome. `data` is what record.json holds; numbers are SI, null where there is none.

    `file` is where it was read from, None of a record that was made here: what a file names is data, and
    code that it names is run only for those who trust it. `folder` is where it was saved, None where it was
    not.
    """

    data: Mapping[str, Any]
    file: Path | None = None
    folder: Path | None = field(default=None, compare=False)

    @property
    def results(self) -> list[Mapping[str, Any]]:
        """One entry per solver and baseline."""
        return list(self.data["results"])

    @property
    def best(self) -> Mapping[str, Any] | None:
        """The best feasible result, None where nothing is feasible.

        A record that does not name it was not made by this package: then the largest objective.
        """
        feasible = [one for one in self.results if one["feasible"] and one["objective"] is not None]
        named = [one for one in feasible if one["name"] == self.data.get("best")]
        return max(named or feasible, key=lambda entry: float(entry["objective"]), default=None)

    def result(self, name: str | None) -> Mapping[str, Any] | None:
        """The result of that name, the best for None; None where there is no such result."""
        if name is None:
            return self.best
        return next((entry for entry in self.results if entry["name"] == name), None)

    def to_json(self) -> str:
        """The text of record.json, every list of numbers on a line of its own."""
        return _layout(self.data, "") + "\n"


def _layout(value: Any, indent: str) -> str:
    # As json.dumps(indent=1) would, but for lists of plain values.
    inner = indent + " "
    if isinstance(value, Mapping) and value:
        lines = [f"{inner}{json.dumps(key)}: {_layout(entry, inner)}" for key, entry in value.items()]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}"
    if isinstance(value, list | tuple) and any(isinstance(entry, Mapping | list | tuple) for entry in value):
        return "[\n" + ",\n".join(f"{inner}{_layout(entry, inner)}" for entry in value) + f"\n{indent}]"
    return json.dumps(value, allow_nan=False)


def save_record(record: Record, folder: str | Path) -> Path:
    """Write record.json into `folder`; returns the file."""
    path = Path(folder) / FILE
    write_text(path, record.to_json())
    return path


def require_no_results(path: str | Path) -> None:
    """Refuse to have a file of another kind take the place of results.

    Raises:
        UserMistake: it would.
    """
    if Path(path).name.lower() in RESULTS and os.path.lexists(path):
        raise UserMistake(f"{path}: cannot be written: it holds results, which would be lost; name another")


def load_record(folder: str | Path) -> Record:
    """Read the record in `folder` (or the record file itself); no code that it names is run.

    Raises:
        RecordError: no record there, or one with keys that are missing or something else than they are to be.
    """
    path = saved_file(folder, FILE)
    expected = f"expected a record of format {FORMAT}; make it again with `oed run`"
    kept = "" if path.exists() else beside(folder)
    data = read_object(path, f"no record there; make one with `oed run`{kept}", expected)
    if data.get("format") != FORMAT or "results" not in data:
        raise RecordError([FileFlaw(str(path), 0, 0, "", expected)])
    return Record(known_record(data, path), path)


def known_record(data: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """What record.json holds as this version knows it, defaults filled in.

    Raises:
        RecordError: as `load_record` does.
    """
    known = checked(StudyRecord, data, path).plain()
    known["study"] = checked_echo(known["study"], path)
    require_one_study(known, path)
    return known


def saved_file(folder: str | Path, name: str) -> Path:
    """The file of that name in a folder, or the file itself where it is given.

    A folder that a process was about to swap when it was killed is put in order first.
    """
    path = in_order(folder)
    return path / name if path.is_dir() else path


def beside(folder: str | Path) -> str:
    """That runs that were cut short are kept beside a folder, in words; "" where there are none."""
    kept = ", ".join(map(str, interrupted_runs(folder)))
    return f"; a run that was cut short is kept in {kept}" if kept else ""


def pages(folder: Path, name: str = REPORT) -> set[str]:
    """Names, relative to a folder, of the files of a report (or an estimate's page) that is there."""
    figures = {
        path.relative_to(folder).as_posix()
        for path in folder.glob("figures/*.svg")
        if path.name.startswith(f"{ESTIMATE}_") == (name == ESTIMATE)
    }
    return figures | {file for file in (f"{name}.html", f"{name}.md") if (folder / file).exists()}


def finite(value: float | None) -> float | None:
    """The value where JSON can hold it, else None."""
    return float(value) if value is not None and math.isfinite(value) else None


def finite_data(value: Any) -> Any:
    """Plain data, null where JSON cannot hold a number."""
    if isinstance(value, Mapping):
        return {key: finite_data(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite_data(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finite_rows(matrix: Any) -> list[list[float | None]]:
    """A matrix as lists, null where JSON cannot hold a number."""
    return [[finite(value) for value in row] for row in np.asarray(matrix)]


def result_data(solution: Solution, trajectory_file: str | None) -> dict[str, Any]:
    """One entry of a record's `results`."""
    evaluation, trajectory = solution.evaluation, solution.trajectory
    return {
        "name": solution.name,
        "kind": solution.kind,
        "criterion": solution.criterion,
        "status": solution.status.value,
        "message": solution.message,
        **_evaluation_data(evaluation),
        "wall_seconds": round(solution.wall_seconds, 6),
        "starts": [_start_data(start) for start in solution.starts],
        "stages": {name: finite(value) for name, value in solution.stages.items()},
        "history": [
            {
                "evaluations": point.evaluations,
                "seconds": round(point.seconds, 6),
                "objective": finite(point.objective),
            }
            for point in solution.history
        ],
        "seed": solution.seed,
        "trajectory": trajectory_file if trajectory is not None else None,
        "drive": None if trajectory is None or evaluation is None else _drive_data(trajectory, evaluation),
    }


def _evaluation_data(evaluation: Evaluation | None) -> dict[str, Any]:
    if evaluation is None:
        numbers = (
            "objective",
            "lambda_min",
            "lambda_max",
            "condition_number",
            "smallest_singular_value",
            "norm_y",
            "path_length",
        )
        return {
            "feasible": False,
            "identifiable": False,
            "singular": True,
            "violations": {},
            **dict.fromkeys(numbers),
            "singular_values": [],
            "standard_deviations": {},
            "covariances": [],
            "margins": [],
        }
    return {
        "feasible": evaluation.feasible,
        "identifiable": evaluation.identifiable,
        "singular": evaluation.singular,
        "violations": evaluation.violations,
        "objective": finite(evaluation.objective),
        "lambda_min": finite(evaluation.lambda_min),
        "lambda_max": finite(evaluation.lambda_max),
        "condition_number": finite(evaluation.condition_number),
        "smallest_singular_value": evaluation.smallest_singular_value,
        "norm_y": evaluation.norm_y,
        "path_length": evaluation.path_length,
        "singular_values": evaluation.singular_values.tolist(),
        "standard_deviations": {
            name: finite(value) for name, value in evaluation.standard_deviations.items()
        },
        "covariances": [
            {"parameters": list(evaluation.parameters[block]), "covariance": finite_rows(covariance)}
            for block, covariance in evaluation.covariances.items()
        ],
        "margins": [
            {
                "limit": margin.name,
                "margin": margin.margin,
                "size": margin.size,
                "unit": margin.unit,
                "active": margin.active,
                "kept": margin.kept,
                "certain": margin.certain,
            }
            for margin in evaluation.margins
        ],
    }


def _start_data(start: Start) -> dict[str, Any]:
    return {
        "objective": finite(start.objective),
        "status": start.status.value,
        "wall_seconds": round(start.wall_seconds, 6),
        "iterations": start.iterations,
    }


def _drive_data(trajectory: Trajectory, evaluation: Evaluation) -> dict[str, Any]:
    # The exact splines, so that nothing is lost; the poses, so that a report need not integrate.
    return {
        "degree": trajectory.degree,
        "knots": trajectory.knots.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
        "start": trajectory.start.tolist(),
        "samples": trajectory.samples,
        "runs": trajectory.runs,
        "poses": rounded(evaluation.poses, 9),
    }


def certificate_data(
    certificate: Certificate, best: Evaluation | None, drive: str | None, spline: float | None
) -> dict[str, Any] | None:
    """A record's `certificate`; None where nothing is proved.

    Args:
        certificate: the bound.
        best: the feasible result of largest objective. Its gap is to the exact bound where it satisfies the
            limits exactly, else to that of the widened limits.
        drive: name of the result that the search for the bound came upon.
        spline: largest objective of a feasible result of a search over splines.
    """
    if not math.isfinite(certificate.upper_bound):
        return None
    against = None if best is None else certificate.bound_on(best)
    share = None if best is None or against is None or best.objective <= 0 else gap(against, best.objective)
    return {
        "upper_bound": certificate.upper_bound,
        "gap": finite(share),
        "method": certificate.method,
        "assumptions": list(certificate.assumptions),
        "multiplier": None if certificate.multiplier is None else np.asarray(certificate.multiplier).tolist(),
        "widened": _widened_data(certificate.widened),
        "gap_to": None if against is None else finite(against),
        "loose": None if share is None else share > LOOSE,
        "complete": certificate.complete,
        "nodes": certificate.nodes,
        "best": None if best is None else best.objective,
        "drive": drive,
        "spline_objective": spline,
        "caps": [
            {"upper_bound": cap.value, "method": cap.method, "assumptions": list(cap.assumptions)}
            for cap in certificate.caps
        ],
        "wall_seconds": round(certificate.wall_seconds, 6),
    }


def _widened_data(widened: Certificate | None) -> dict[str, Any] | None:
    if widened is None or not math.isfinite(widened.upper_bound):
        return None
    return {
        "tolerance": TOLERANCE,
        "upper_bound": widened.upper_bound,
        "method": widened.method,
        "assumptions": list(widened.assumptions),
    }


def validation_data(name: str, validation: Validation) -> dict[str, Any]:
    """One result's entry in a record's `validation`."""
    return {
        "name": name,
        "estimator": validation.estimator,
        "heading": validation.heading,
        "passed": validation.passed,
        "verdict": validation.verdict,
        "parameters": list(validation.parameters),
        "true": validation.true.tolist(),
        "mean": validation.mean.tolist(),
        "promised_covariance": validation.promised.tolist(),
        "sampled_covariance": validation.sampled.tolist(),
        "paired_variance_ratio": validation.paired_ratio.tolist(),
        "paired_standard_error": validation.paired_error.tolist(),
        "checks": [
            {
                "name": check.name,
                "question": check.question,
                "statistic": check.statistic,
                "expected": list(check.expected),
                "p_value": check.p_value,
                "passed": check.passed,
            }
            for check in validation.checks
        ],
        "estimates": rounded(validation.estimates, 10),
    }


def rounded(values: Any, digits: int) -> Any:
    """Nested lists of an array's values, rounded: for series that are drawn, not computed with."""
    return np.round(np.asarray(values, dtype=float), digits).tolist()


def drive_of(entry: Mapping[str, Any]) -> Trajectory | None:
    """The trajectory of a record's result, None where it has none."""
    drive = entry["drive"]
    if drive is None:
        return None
    return Trajectory(
        np.array(drive["knots"]),
        drive["degree"],
        np.array(drive["coefficients"]),
        np.array(drive["start"]),
        drive["samples"],
        drive.get("runs", 1),
    )

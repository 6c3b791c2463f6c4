"""What logs said of a robot, as plain data: saved as estimate.json, and its report's only input."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.estimation import Calibration, Compared, Comparison, HeldOut, Reckoning, Score, correlations
from oed.estimation.setup.noise import group_of, groups, places_of
from oed.foundation.errors import FileFlaw, RecordError
from oed.records.numbers import finite, finite_rows
from oed.records.record import Record, saved_file
from oed.records.stored.door import checked, read_object
from oed.records.stored.echo import checked_echo
from oed.records.stored.estimate import StoredEstimate

Array = npt.NDArray[np.float64]

FORMAT = 1
FILE = "estimate.json"
PATHS, POINTS = 12, 400
"""How many paths are kept for drawing, and how many points of each."""
RESIDUALS = 3000
"""How many residuals of a kind are kept for drawing."""
NUMBERS = (
    "length",
    "rmse_position",
    "rmse_aligned",
    "rmse_heading",
    "end_position",
    "end_heading",
    "drift_position",
    "drift_heading",
)


@dataclass(frozen=True)
class EstimateRecord:
    """The outcome of a calibration. `data` is what estimate.json holds; SI, null where there is none.

    `file` is where it was read from, None of one that was made here.
    """

    data: Mapping[str, Any]
    file: Path | None = None

    @property
    def parameters(self) -> list[Mapping[str, Any]]:
        """One entry per parameter: name, unit, nominal, value, standard_error, interval, ..."""
        return list(self.data["parameters"])

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name, SI."""
        return {entry["name"]: float(entry["value"]) for entry in self.parameters}

    @property
    def models(self) -> list[Mapping[str, Any]]:
        """One entry per model that was compared, the study's own first; [] where none was.

        Each with name, kind, own, comparable, reason, doubt, parameters (name, unit, value, standard_error),
        unknowns, starts, log_likelihood and scores: by `aicc`, `bic` and `held_out` [m] the value, difference
        to the best, interval of that (95 %) and equal (whether as good as the best). What all have in common
        stands beside them in `data["comparison"]`: readings, inflation, inflation_by, best, agree,
        favourites (as good as the best by every measure).
        """
        return list((self.data.get("comparison") or {}).get("models") or [])


def estimate_files(record: EstimateRecord) -> dict[str, str]:
    """The file of an estimate, by its name."""
    return {FILE: Record(record.data).to_json()}


def load_estimate(folder: str | Path) -> EstimateRecord:
    """Read the estimate in `folder` (or the file itself).

    Raises:
        RecordError: no estimate there, or not one of this format.
    """
    path = saved_file(folder, FILE)
    expected = f"expected an estimate of format {FORMAT}; make it again with `oed estimate`"
    data = read_object(path, "no estimate there; make one with `oed estimate`", expected)
    if data.get("format") != FORMAT or "parameters" not in data:
        raise RecordError([FileFlaw(str(path), 0, 0, "", expected)])
    return EstimateRecord(known_estimate(data, path), path)


def known_estimate(data: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """What estimate.json holds as this version knows it.

    Raises:
        RecordError: as `load_estimate` does.
    """
    known = checked(StoredEstimate, data, path).plain()
    if "study" in known:
        known["study"] = checked_echo(known["study"], path)
    return known


def calibration_data(found: Calibration) -> dict[str, Any]:
    """What a record holds of a calibration."""
    return {
        "parameters": _parameters(found),
        "covariance": finite_rows(found.covariance),
        "correlation": finite_rows(_correlation(found.covariance)),
        "covariance_kind": found.covariances[0].name,
        "half_width": finite(found.covariances[0].half_width),
        "coefficients": _coefficients(found),
        "nuisances": _nuisances(found),
        "segments": _segments(found),
        "noise": [
            {
                "about": name,
                "unit": "m" if name == "position" else "rad",
                "at_rest": finite(noise.at_rest),
                "per_speed": finite(noise.per_speed),
                "per_yaw_rate": finite(noise.per_yaw_rate),
            }
            for name, noise in found.fit.noises.items()
        ],
        "converged": found.fit.converged,
        "untold": list(found.untold),
        "notes": list(found.notes),
        "diagnostics": [
            {**vars(one), "statistic": finite(one.statistic), "p_value": finite(one.p_value)}
            for one in found.diagnostics
        ],
        "logs": _logs(found),
        "left_out": [_held_out(found, one) for one in found.left_out],
        "held_out": None if found.held_out is None else _held_out(found, found.held_out),
        "comparison": None if found.comparison is None else _comparison(found.comparison),
        "paths": _paths(found),
        "residuals": _residuals(found),
        "correlations": _correlations(found),
    }


def _parameters(found: Calibration) -> list[dict[str, Any]]:
    table = {parameter.name: parameter for parameter in found.robot.parameters}
    units = dict(zip(found.fit.unknowns.names, found.fit.unknowns.units, strict=True))
    every = {one.name: one.deviations for one in found.covariances}
    width = found.covariances[0].half_width
    entries = []
    for index, name in enumerate(found.parameters):
        value, error = float(found.values[index]), float(found.covariances[0].deviations[index])
        entries.append(
            {
                "name": name,
                "unit": units[name],
                "nominal": table[name].nominal,
                "size": table[name].scale or 1.0,
                "value": finite(value),
                "standard_error": finite(error),
                "interval": [finite(value - width * error), finite(value + width * error)],
                "standard_errors": {kind: finite(sizes[index]) for kind, sizes in every.items()},
            }
        )
    return entries


def _correlation(covariance: Array) -> Array:
    sizes = np.sqrt(np.diag(covariance))
    sizes = np.where(sizes > 0, sizes, 1.0)
    return np.asarray(covariance / np.outer(sizes, sizes))


def _coefficients(found: Calibration) -> list[dict[str, Any]]:
    names, values, errors = found.coefficients
    if not names:
        return []
    units = dict(zip(found.robot.coefficient_names, ("", "m", "m"), strict=False))
    rows = [units[row] for row in found.robot.coefficient_names for _ in row]
    entries = [
        {"name": name, "unit": unit, "value": finite(value), "standard_error": finite(error)}
        for name, unit, value, error in zip(names, rows, values, errors, strict=True)
    ]
    track = found.effective_track
    if track is not None:
        own = {"value": finite(track[0]), "standard_error": finite(track[1])}
        entries.append({"name": "effective_track", "unit": "m", **own})
    return entries


def _nuisances(found: Calibration) -> list[dict[str, Any]]:
    unknowns, first = found.fit.unknowns, len(found.parameters)
    errors = found.covariances[0].deviations
    entries = []
    for index in range(first, unknowns.size):
        clock = index - (unknowns.size - unknowns.clocks)
        value = found.fit.clock_offsets[clock] if clock >= 0 else found.fit.values[index]
        entries.append(
            {
                "name": "clock_offset" if clock >= 0 else unknowns.names[index],
                "unit": unknowns.units[index],
                "value": finite(value),
                "standard_error": finite(errors[index]),
                "file": found.fit.layout.clocks[clock] if clock >= 0 else None,
            }
        )
    return entries


def _segments(found: Calibration) -> dict[str, Any]:
    seconds, chosen = found.fit.layout.seconds, found.segmenting
    tried = {} if chosen is None else chosen.tried
    return {
        "seconds": finite(seconds),
        "count": found.fit.layout.count,
        "chosen": chosen is not None,
        "drifts": None if chosen is None else chosen.drifts,
        "tried": [{"seconds": finite(length), **sizes} for length, sizes in tried.items()],
    }


def _logs(found: Calibration) -> list[dict[str, Any]]:
    offsets = dict(zip(found.fit.layout.clocks, map(float, found.fit.clock_offsets), strict=True))
    return [
        {
            "name": log.name,
            "file": log.file,
            "seconds": log.duration,
            "poses": len(log.pose_times),
            "quantities": list(log.quantities),
            "clock_offset": offsets[log.file],
            "findings": [vars(one) for one in log.findings],
        }
        for log in found.logs
    ]


def _held_out(found: Calibration, one: HeldOut) -> dict[str, Any]:
    known = [parameter.name for parameter in found.robot.parameters]
    return {
        "logs": list(one.names),
        "parameters": {name: finite(one.values[known.index(name)]) for name in found.parameters},
        "before": [_numbers(each) for each in one.before],
        "after": [_numbers(each) for each in one.after],
        "mean": {"before": mean_numbers(one.before), "after": mean_numbers(one.after)},
    }


def _numbers(one: Reckoning) -> dict[str, float | None]:
    return {name: finite(getattr(one, name)) for name in NUMBERS}


def mean_numbers(each: Sequence[Reckoning]) -> dict[str, float | None]:
    """The mean of every number over logs, None where a log has none."""
    found: dict[str, float | None] = {}
    for name in NUMBERS:
        values = [getattr(one, name) for one in each]
        found[name] = None if any(value is None for value in values) else float(np.mean(values))
    return found


def _comparison(found: Comparison) -> dict[str, Any]:
    return {
        "models": [_model(one, own=place == 0) for place, one in enumerate(found.models)],
        "readings": finite(found.readings),
        "inflation": finite(found.inflation),
        "inflation_by": found.inflation_by,
        "best": dict(found.best),
        "agree": found.agree,
        "favourites": list(found.favourites),
    }


def _model(one: Compared, *, own: bool) -> dict[str, Any]:
    likelihood = one.likelihood
    return {
        "name": one.name,
        "kind": one.robot.kind,
        "own": own,
        "comparable": not one.reason,
        "reason": one.reason,
        "doubt": one.doubt,
        "parameters": _fitted_parameters(one),
        "unknowns": None if likelihood is None else finite(likelihood.unknowns),
        "starts": None if likelihood is None else finite(likelihood.starts),
        "log_likelihood": None if likelihood is None else finite(likelihood.each.sum()),
        "scores": {measure: _score(score) for measure, score in one.scores.items()},
    }


def _fitted_parameters(one: Compared) -> list[dict[str, Any]]:
    if one.fit is None or one.covariance is None:
        return [{"name": name, "unit": "", "value": None, "standard_error": None} for name in one.parameters]
    columns = one.parameters, one.fit.unknowns.units, one.fit.values, one.covariance.deviations
    return [
        {"name": name, "unit": unit, "value": finite(value), "standard_error": finite(error)}
        for name, unit, value, error in zip(*columns, strict=False)
    ]


def _score(one: Score) -> dict[str, Any]:
    ends = None if one.interval is None else [finite(end) for end in one.interval]
    own = {"value": finite(one.value), "difference": finite(one.difference)}
    return {**own, "interval": ends, "equal": one.equal}


def _paths(found: Calibration) -> list[dict[str, Any]]:
    # Of logs the estimate did not know first; of its own where there is nothing else.
    parts = [(one, "held out") for one in ([found.held_out] if found.held_out else [])]
    parts += [(one, "left out") for one in found.left_out]
    parts += [(one, "fitted") for one in ([found.own] if found.own else [])]
    each = [
        (name, role, before, after)
        for one, role in parts
        for name, before, after in zip(one.names, one.before, one.after, strict=True)
    ]
    return [_path(*one) for one in each[:PATHS]]


def _path(name: str, role: str, before: Reckoning, after: Reckoning) -> dict[str, Any]:
    # Thinned, but for the ends of stretches, which keep lines apart.
    every = max(1, -(-len(before.times) // POINTS))
    rows = (np.arange(len(before.times)) % every == 0) | np.isnan(before.times)
    columns = {
        "t": before.times,
        "x": before.reference[:, 0],
        "y": before.reference[:, 1],
        "before_x": before.path[:, 0],
        "before_y": before.path[:, 1],
        "after_x": after.path[:, 0],
        "after_y": after.path[:, 1],
    }
    return {"log": name, "role": role, **{key: _rounded(values[rows]) for key, values in columns.items()}}


def _rounded(values: Array, digits: int = 5) -> list[float | None]:
    return [finite(round(float(value), digits)) for value in values]


def _residuals(found: Calibration) -> list[dict[str, Any]]:
    fit, layout = found.fit, found.fit.layout
    entries = []
    every = max(1, -(-int(layout.valid.sum()) // RESIDUALS))
    for number, log in enumerate(layout.logs):
        own = layout.owner == number
        valid = layout.valid[own]
        for place, quantity in enumerate(layout.quantities):
            entries.append(
                {
                    "log": log.name,
                    "quantity": quantity,
                    "unit": "m" if group_of(quantity) == "position" else "rad",
                    "t": _rounded(layout.times[own][valid][::every] - log.pose_times[0], 4),
                    "value": _rounded(fit.residuals[own][valid][:, place][::every], 7),
                    "speed": _rounded(fit.speeds[own][valid][::every], 4),
                    "yaw_rate": _rounded(fit.yaw_rates[own][valid][::every], 4),
                }
            )
    return entries


def _correlations(found: Calibration) -> list[dict[str, Any]]:
    quantities = found.fit.layout.quantities
    entries = []
    for group in groups(quantities):
        places = places_of(group, quantities)
        values, pairs = correlations(found.fit, places)
        bound = 1.96 / np.sqrt(max(pairs, 1))
        entries.append({"about": group, "values": _rounded(values), "bound": finite(bound)})
    return entries

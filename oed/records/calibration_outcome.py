"""What a calibration came to, as estimate.json holds it; SI, null where there is none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.estimation import Calibration, Compared, Comparison, DeadReckoning, HeldOut, Score, correlations
from oed.estimation.setup.noise import Noise, group_of, groups, places_of
from oed.records.numbers import finite, finite_rows
from oed.records.stored.estimate import (
    Along,
    ComparedModel,
    Correlations,
    Estimated,
    Finding,
    FittedParameter,
    FoundNoise,
    Known,
    Models,
    ReadLog,
    Reckoned,
    Residuals,
    Segments,
    StoredEstimate,
    TriedLength,
)
from oed.records.stored.estimate import Diagnostic as StoredDiagnostic
from oed.records.stored.estimate import Score as StoredScore

Array = npt.NDArray[np.float64]

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
"""Of dead reckoning."""


def estimate_of(found: Calibration, **keys: Any) -> StoredEstimate:
    """What estimate.json holds of a calibration; `keys` are further ones, of where it comes from."""
    return StoredEstimate.model_construct(
        **keys,
        parameters=_parameters(found),
        covariance=finite_rows(found.covariance),
        correlation=finite_rows(_correlation(found.covariance)),
        covariance_kind=found.covariances[0].name,
        half_width=finite(found.covariances[0].half_width),
        coefficients=_coefficients(found),
        nuisances=_nuisances(found),
        segments=_segments(found),
        noise=[_noise(name, noise) for name, noise in found.fit.noises.items()],
        converged=found.fit.converged,
        untold=list(found.weak_directions),
        notes=list(found.notes),
        diagnostics=[
            StoredDiagnostic.model_construct(
                **{**vars(one), "statistic": finite(one.statistic), "p_value": finite(one.p_value)}
            )
            for one in found.diagnostics
        ],
        logs=_logs(found),
        left_out=[_held_out(found, one) for one in found.cross_validation],
        held_out=None if found.held_out is None else _held_out(found, found.held_out),
        comparison=None if found.comparison is None else _comparison(found.comparison),
        paths=_paths(found),
        residuals=_residuals(found),
        correlations=_correlations(found),
    )


def _noise(name: str, noise: Noise) -> FoundNoise:
    return FoundNoise.model_construct(
        about=name,
        unit="m" if name == "position" else "rad",
        at_rest=finite(noise.at_rest),
        per_speed=finite(noise.per_speed),
        per_yaw_rate=finite(noise.per_yaw_rate),
    )


def _parameters(found: Calibration) -> list[Estimated]:
    table = {parameter.name: parameter for parameter in found.robot.parameters}
    units = dict(zip(found.fit.unknowns.names, found.fit.unknowns.units, strict=True))
    every = {one.name: one.deviations for one in found.covariances}
    width = found.covariances[0].half_width
    entries = []
    for index, name in enumerate(found.parameters):
        value, error = float(found.values[index]), float(found.covariances[0].deviations[index])
        entries.append(
            Estimated.model_construct(
                name=name,
                unit=units[name],
                nominal=table[name].nominal,
                size=table[name].scale or 1.0,
                value=finite(value),
                standard_error=finite(error),
                interval=[finite(value - width * error), finite(value + width * error)],
                standard_errors={kind: finite(sizes[index]) for kind, sizes in every.items()},
            )
        )
    return entries


def _correlation(covariance: Array) -> Array:
    sizes = np.sqrt(np.diag(covariance))
    sizes = np.where(sizes > 0, sizes, 1.0)
    return np.asarray(covariance / np.outer(sizes, sizes))


def _coefficients(found: Calibration) -> list[Along]:
    names, values, errors = found.coefficients
    if not names:
        return []
    units = dict(zip(found.robot.coefficient_names, ("", "m", "m"), strict=False))
    rows = [units[row] for row in found.robot.coefficient_names for _ in row]
    entries = [
        _along(name, unit, value, error)
        for name, unit, value, error in zip(names, rows, values, errors, strict=True)
    ]
    track = found.effective_track
    return entries if track is None else [*entries, _along("effective_track", "m", *track)]


def _along(name: str, unit: str, value: float, error: float) -> Along:
    return Along.model_construct(name=name, unit=unit, value=finite(value), standard_error=finite(error))


def _nuisances(found: Calibration) -> list[Along]:
    unknowns, first = found.fit.unknowns, len(found.parameters)
    errors = found.covariances[0].deviations
    entries = []
    for index in range(first, unknowns.size):
        clock = index - (unknowns.size - unknowns.clocks)
        value = found.fit.clock_offsets[clock] if clock >= 0 else found.fit.values[index]
        entries.append(
            Along.model_construct(
                name="clock_offset" if clock >= 0 else unknowns.names[index],
                unit=unknowns.units[index],
                value=finite(value),
                standard_error=finite(errors[index]),
                file=found.fit.layout.clocks[clock] if clock >= 0 else None,
            )
        )
    return entries


def _segments(found: Calibration) -> Segments:
    seconds, chosen = found.fit.layout.seconds, found.segmenting
    tried: dict[float, dict[str, Any]] = {} if chosen is None else {**chosen.tried}
    return Segments.model_construct(
        seconds=finite(seconds),
        count=found.fit.layout.count,
        chosen=chosen is not None,
        drifts=None if chosen is None else chosen.drifts,
        tried=[
            TriedLength.model_construct(seconds=finite(length), **sizes) for length, sizes in tried.items()
        ],
    )


def _logs(found: Calibration) -> list[ReadLog]:
    offsets = dict(zip(found.fit.layout.clocks, map(float, found.fit.clock_offsets), strict=True))
    return [
        ReadLog.model_construct(
            name=log.name,
            file=log.file,
            seconds=log.duration,
            poses=len(log.pose_times),
            quantities=list(log.quantities),
            clock_offset=offsets[log.file],
            findings=[Finding.model_construct(**vars(one)) for one in log.findings],
        )
        for log in found.logs
    ]


def _held_out(found: Calibration, one: HeldOut) -> Known:
    known = [parameter.name for parameter in found.robot.parameters]
    return Known.model_construct(
        logs=list(one.names),
        parameters={name: finite(one.values[known.index(name)]) for name in found.parameters},
        before=[_numbers(each) for each in one.before],
        after=[_numbers(each) for each in one.after],
        mean={"before": mean_numbers(one.before), "after": mean_numbers(one.after)},
    )


def _numbers(one: DeadReckoning) -> dict[str, float | None]:
    return {name: finite(getattr(one, name)) for name in NUMBERS}


def mean_numbers(each: Sequence[DeadReckoning]) -> dict[str, float | None]:
    """The mean of every number over logs, None where a log has none."""
    found: dict[str, float | None] = {}
    for name in NUMBERS:
        values = [getattr(one, name) for one in each]
        found[name] = None if any(value is None for value in values) else float(np.mean(values))
    return found


def _comparison(found: Comparison) -> Models:
    return Models.model_construct(
        models=[_model(one, own=place == 0) for place, one in enumerate(found.models)],
        readings=finite(found.readings),
        inflation=finite(found.inflation),
        inflation_by=found.inflation_by,
        best={str(measure): name for measure, name in found.best.items()},
        agree=found.agree,
        favourites=list(found.favourites),
    )


def _model(one: Compared, *, own: bool) -> ComparedModel:
    likelihood = one.likelihood
    return ComparedModel.model_construct(
        name=one.name,
        kind=one.robot.kind,
        own=own,
        comparable=not one.reason,
        reason=one.reason,
        doubt=one.doubt,
        parameters=_fitted_parameters(one),
        unknowns=None if likelihood is None else finite(likelihood.unknowns),
        starts=None if likelihood is None else finite(likelihood.starts),
        log_likelihood=None if likelihood is None else finite(likelihood.each.sum()),
        scores={measure: _score(score) for measure, score in one.scores.items()},
    )


def _fitted_parameters(one: Compared) -> list[FittedParameter]:
    if one.fit is None or one.covariance is None:
        return [
            FittedParameter.model_construct(name=name, unit="", value=None, standard_error=None)
            for name in one.parameters
        ]
    columns = one.parameters, one.fit.unknowns.units, one.fit.values, one.covariance.deviations
    return [
        FittedParameter.model_construct(
            name=name, unit=unit, value=finite(value), standard_error=finite(error)
        )
        for name, unit, value, error in zip(*columns, strict=False)
    ]


def _score(one: Score) -> StoredScore:
    return StoredScore.model_construct(
        value=finite(one.value),
        difference=finite(one.difference),
        interval=None if one.interval is None else [finite(end) for end in one.interval],
        equal=one.equal,
    )


def _paths(found: Calibration) -> list[Reckoned]:
    # Of logs the estimate did not know first; of its own where there is nothing else.
    parts = [(one, "held out") for one in ([found.held_out] if found.held_out else [])]
    parts += [(one, "left out") for one in found.cross_validation]
    parts += [(one, "fitted") for one in ([found.own] if found.own else [])]
    each = [
        (name, role, before, after)
        for one, role in parts
        for name, before, after in zip(one.names, one.before, one.after, strict=True)
    ]
    return [_path(*one) for one in each[:PATHS]]


def _path(name: str, role: str, before: DeadReckoning, after: DeadReckoning) -> Reckoned:
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
    thinned: dict[str, Any] = {key: _rounded(values[rows]) for key, values in columns.items()}
    return Reckoned.model_construct(log=name, role=role, **thinned)


def _rounded(values: Array, digits: int = 5) -> list[float | None]:
    return [finite(round(float(value), digits)) for value in values]


def _residuals(found: Calibration) -> list[Residuals]:
    fit, layout = found.fit, found.fit.layout
    entries = []
    every = max(1, -(-int(layout.valid.sum()) // RESIDUALS))
    for number, log in enumerate(layout.logs):
        own = layout.owner == number
        valid = layout.valid[own]
        for place, quantity in enumerate(layout.quantities):
            entries.append(
                Residuals.model_construct(
                    log=log.name,
                    quantity=quantity,
                    unit="m" if group_of(quantity) == "position" else "rad",
                    t=_rounded(layout.times[own][valid][::every] - log.pose_times[0], 4),
                    value=_rounded(fit.residuals[own][valid][:, place][::every], 7),
                    speed=_rounded(fit.speeds[own][valid][::every], 4),
                    yaw_rate=_rounded(fit.yaw_rates[own][valid][::every], 4),
                )
            )
    return entries


def _correlations(found: Calibration) -> list[Correlations]:
    quantities = found.fit.layout.quantities
    entries = []
    for group in groups(quantities):
        places = places_of(group, quantities)
        values, pairs = correlations(found.fit, places)
        bound = 1.96 / np.sqrt(max(pairs, 1))
        entries.append(
            Correlations.model_construct(about=group, values=_rounded(values), bound=finite(bound))
        )
    return entries

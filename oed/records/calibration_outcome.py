"""What a calibration came to, as estimate.json holds it; SI, null where there is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from oed.estimation import Calibration, Compared, Comparison, DeadReckoning, HeldOut, correlations
from oed.estimation.methods.drift_rates import DriftRates
from oed.estimation.methods.log_errors import DESCRIBED
from oed.estimation.methods.whole_logs import Likeliest
from oed.estimation.setup.noise import group_of, groups, places_of
from oed.foundation.arrays import Array
from oed.records.stored.compared import ComparedModel, FittedParameter, Models
from oed.records.stored.door import FORMAT
from oed.records.stored.estimate import (
    Correlations,
    Estimated,
    EstimateRecord,
    FoundDrift,
    FoundError,
    FoundLasting,
    FoundNoise,
    ReadLog,
    ReadSensor,
    Residuals,
    Segments,
    TriedLength,
    Unknown,
)
from oed.records.stored.reckoned import Reckoned, ReckonedPath, UnseenLogs

PATHS, POINTS = 12, 400
"""How many paths are kept for drawing, and how many points of each."""
RESIDUALS = 3000
"""How many residuals of a kind are kept for drawing."""
COEFFICIENT_UNITS = ("", "m", "m")
"""SI units of the coefficients of eqs 5-6, by the component of the twist that they give."""
WHITE_95 = 1.96
"""Standard deviations within which 95 % of a normal variable lie."""


def estimate_of(found: Calibration, **origin: Any) -> EstimateRecord:
    """What estimate.json holds of a calibration; `origin` is what else it says of where it comes from."""
    lasting = found.fit.correlated
    return EstimateRecord.of(
        found,
        **origin,
        format=FORMAT,
        parameters=_parameters(found),
        correlation=_correlation(found.covariance),
        covariance_kind=found.covariances[0].name,
        half_width=found.covariances[0].half_width,
        half_width_together=found.covariances[0].half_width_together,
        coefficients=_coefficients(found),
        nuisances=_nuisances(found),
        segments=_segments(found),
        drift=_drift(found.drift),
        noise=[
            FoundNoise.of(noise, about=name, unit=_unit_of(found, name))
            for name, noise in found.fit.noises.items()
        ],
        lasting=None if lasting is None else FoundLasting.of(lasting, **lasting.lasting),
        log_errors=[] if found.log_errors is None else _errors(found.log_errors),
        converged=found.fit.converged,
        not_identifiable=found.weak_directions,
        logs=_logs(found),
        cross_validation=[_tested(found, one) for one in found.cross_validation],
        test_set=None if found.held_out is None else _tested(found, found.held_out),
        comparison=None if found.comparison is None else _comparison(found.comparison),
        paths=_paths(found),
        residuals=_residuals(found),
        correlations=_correlations(found),
    )


def _unit_of(found: Calibration, group: str) -> str:
    # The SI unit of readings that share a noise.
    units = {
        group_of(f"{label}{entry}"): unit
        for label, sensor in found.fit.layout.sensors
        for entry, unit in zip(sensor.entries, sensor.units, strict=True)
    }
    return (units | {"position": "m"}).get(group, "rad")


def _parameters(found: Calibration) -> list[Estimated]:
    table = {parameter.name: parameter for parameter in found.robot.parameters}
    units = dict(zip(found.fit.unknowns.names, found.fit.unknowns.units, strict=True))
    width = found.covariances[0].half_width
    entries = []
    for index, name in enumerate(found.parameters):
        value, error = found.values[index], found.covariances[0].deviations[index]
        one = Estimated.of(
            table[name],
            unit=units[name],
            size=table[name].scale or 1.0,
            value=value,
            standard_error=error,
            interval=[value - width * error, value + width * error],
            standard_errors={one.name: one.deviations[index] for one in found.covariances},
            bias=None if found.dilution is None else found.dilution.bias[index],
            input_noise=None if found.dilution is None else found.dilution.shares[index],
        )
        entries.append(one)
    return entries


def _correlation(covariance: Array) -> Array:
    sizes = np.sqrt(np.diag(covariance))
    sizes = np.where(sizes > 0, sizes, 1.0)
    return np.asarray(covariance / np.outer(sizes, sizes))


def _coefficients(found: Calibration) -> list[Unknown]:
    names, values, errors = found.coefficients
    if not names:
        return []
    rows = zip(found.robot.coefficient_names, COEFFICIENT_UNITS, strict=False)
    units = {name: unit for row, unit in rows for name in row}
    each = [(name, units[name], *pair) for name, *pair in zip(names, values, errors, strict=True)]
    if found.effective_track is not None:
        each.append(("effective_track", "m", *found.effective_track))
    # Of several parameters, whose variance together may be less sure than that of any.
    width = found.covariances[0].half_width_together
    intervals = [[value - width * error, value + width * error] for *_, value, error in each]
    pairs = zip(each, intervals, strict=True)
    return [_unknown(*one).model_copy(update={"interval": ends}) for one, ends in pairs]


def _unknown(name: str, unit: str, value: float, error: float) -> Unknown:
    return Unknown.of(name=name, unit=unit, value=value, standard_error=error)


def _nuisances(found: Calibration) -> list[Unknown]:
    # Clocks come last among the unknowns.
    unknowns, fit, first = found.fit.unknowns, found.fit, len(found.parameters)
    clocks = range(unknowns.size - unknowns.clocks, unknowns.size)
    names = [*unknowns.names[: clocks.start], *["clock_offset"] * unknowns.clocks]
    values = [*fit.values[: clocks.start], *fit.clock_offsets]
    files = [*[None] * clocks.start, *fit.layout.clocks]
    errors = found.covariances[0].deviations
    each = list(zip(names, unknowns.units, values, errors, files, strict=False))
    return [_unknown(*one).model_copy(update={"file": file}) for *one, file in each[first:]]


def _segments(found: Calibration) -> Segments:
    chosen, layout = found.segmenting, found.fit.layout
    return Segments.of(
        layout,
        chosen=chosen is not None,
        drifts=found.drifts,
        relative=layout.relative or None,
        tried=[]
        if chosen is None
        else [
            TriedLength.of(seconds=length).model_copy(update=dict(sizes))
            for length, sizes in chosen.tried.items()
        ],
    )


def _drift(rates: DriftRates | None) -> FoundDrift | None:
    if rates is None:
        return None
    ahead, sideways, by_path, by_turning = np.sqrt(rates.values)
    return FoundDrift.of(
        ahead=ahead,
        sideways=sideways,
        turn_by_path=by_path,
        turn_by_turning=by_turning,
        shown=rates.shown,
        seconds=None if rates.seconds == math.inf else rates.seconds,
    )


def _errors(found: Likeliest) -> list[FoundError]:
    # Sizes are known by factors: their logarithms are about normal.
    entries = []
    for place, (name, (kind, about, unit)) in enumerate(DESCRIBED.items()):
        size, factor = found.sizes[name], float(np.exp(WHITE_95 * np.sqrt(found.spread[place, place])))
        interval = [size / factor, size * factor]
        one = FoundError.of(name=name, kind=kind, about=about, unit=unit, size=size, interval=interval)
        entries.append(one)
    return entries


def _logs(found: Calibration) -> list[ReadLog]:
    offsets = dict(zip(found.fit.layout.clocks, found.fit.clock_offsets, strict=True))
    return [
        ReadLog.of(
            log,
            seconds=log.duration,
            poses=len(log.pose_times if log.motions is None else log.motions),
            clock_offset=offsets[log.file],
            sensors=[
                ReadSensor.of(
                    one, readings=len(one.times), entries=np.isfinite(one.values).sum(axis=0).tolist()
                )
                for one in log.sensors
            ],
        )
        for log in found.logs
    ]


def _tested(found: Calibration, one: HeldOut) -> UnseenLogs:
    known = [parameter.name for parameter in found.robot.parameters]
    return UnseenLogs.of(
        one,
        logs=one.names,
        parameters={name: one.values[known.index(name)] for name in found.parameters},
        mean={"before": mean_errors(one.before), "after": mean_errors(one.after)},
    )


def mean_errors(each: Sequence[DeadReckoning]) -> Reckoned:
    """The mean of every error over logs, None where a log has none."""
    found: dict[str, float | None] = {}
    for name in Reckoned.model_fields:
        values = [getattr(one, name) for one in each]
        found[name] = None if any(value is None for value in values) else float(np.mean(values))
    return Reckoned.of(**found)


def _comparison(found: Comparison) -> Models:
    return Models.of(found, models=[_model(one, own=place == 0) for place, one in enumerate(found.models)])


def _model(one: Compared, *, own: bool) -> ComparedModel:
    likelihood = one.likelihood
    return ComparedModel.of(
        one,
        kind=one.robot.kind,
        own=own,
        comparable=not one.reason,
        parameters=_fitted_parameters(one),
        unknowns=None if likelihood is None else likelihood.unknowns,
        starts=None if likelihood is None else likelihood.starts,
        log_likelihood=None if likelihood is None else likelihood.each.sum(),
    )


def _fitted_parameters(one: Compared) -> list[FittedParameter]:
    if one.fit is None or one.covariance is None:
        return [
            FittedParameter.of(name=name, unit="", value=None, standard_error=None) for name in one.parameters
        ]
    columns = one.parameters, one.fit.unknowns.units, one.fit.values, one.covariance.deviations
    return [
        FittedParameter.of(name=name, unit=unit, value=value, standard_error=error)
        for name, unit, value, error in zip(*columns, strict=False)
    ]


def _paths(found: Calibration) -> list[ReckonedPath]:
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


def _path(name: str, role: str, before: DeadReckoning, after: DeadReckoning) -> ReckonedPath:
    # Thinned, but for the ends of stretches, which keep lines apart.
    every = max(1, -(-len(before.times) // POINTS))
    rows = (np.arange(len(before.times)) % every == 0) | np.isnan(before.times)
    return ReckonedPath.of(
        log=name,
        role=role,
        t=before.times[rows],
        x=before.reference[rows, 0],
        y=before.reference[rows, 1],
        before_x=before.path[rows, 0],
        before_y=before.path[rows, 1],
        after_x=after.path[rows, 0],
        after_y=after.path[rows, 1],
        heading=before.turns[rows, 0],
        before_heading=before.turns[rows, 1],
        after_heading=after.turns[rows, 1],
        before=Reckoned.of(before),
        after=Reckoned.of(after),
    )


def _residuals(found: Calibration) -> list[Residuals]:
    # Of a pose quantity by quantity; of other sensors all readings of a kind together, of whatever point.
    fit, layout = found.fit, found.fit.layout
    shown = list(dict.fromkeys([*layout.states, *map(group_of, layout.quantities[len(layout.states) :])]))
    entries = []
    every = max(1, -(-int(layout.valid.sum(axis=(0, 1)).max()) // RESIDUALS))
    for number, log in enumerate(layout.logs):
        own = layout.owner == number
        for name in shown:
            places = [place for place, one in enumerate(layout.quantities) if name in (one, group_of(one))]
            rows, columns = np.nonzero(layout.valid[own][..., places].reshape(-1, len(places)))
            rows, columns = rows[::every], columns[::every]
            one = Residuals.of(
                log=log.name,
                quantity=name,
                unit=_unit_of(found, group_of(name)),
                t=layout.times[own][:, : layout.valid.shape[1]].ravel()[rows] - log.pose_times[0],
                value=fit.residuals[own][..., places].reshape(-1, len(places))[rows, columns],
                speed=fit.speeds[own].ravel()[rows],
                yaw_rate=fit.yaw_rates[own].ravel()[rows],
            )
            entries.append(one)
    return entries


def _correlations(found: Calibration) -> list[Correlations]:
    quantities = found.fit.layout.quantities
    entries = []
    for group in groups(quantities):
        values, pairs = correlations(found.fit, places_of(group, quantities))
        bound = WHITE_95 / np.sqrt(max(pairs, 1))
        entries.append(Correlations.of(about=group, values=values, bound=bound))
    return entries

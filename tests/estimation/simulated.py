"""Drives of any robot with known truth, and the logs that its wheels and a pose sensor would have made.

Inputs are held between knots, so that every twist is constant there and the path an arc: nothing is lost
where a pose is read at every knot. Arcs are written out here; nothing is integrated by the package.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import casadi as ca
import numpy as np
from builders import input_limits, problem_of
from twin_drives import arcs

from oed.estimation import CalibrationOptions
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.joint import JointSearch
from oed.estimation.prediction.layout import SegmentLayout, cut
from oed.estimation.setup.unknowns import Knowledge, Unknowns
from oed.kernel.criteria import E
from oed.logs.log import Log
from oed.robots.models import DifferentialDrive, Model
from oed.robots.sensors import Poses
from oed.robots.sensors.poses import AbsoluteNoise

ROBOT = DifferentialDrive(wheel_radius=0.05, track=0.2)
TRUTH = {"wheel_radius_right": 0.0515, "wheel_radius_left": 0.0492, "track": 0.213}
"""The usual robot, and what it truly is."""
XYH = ("x", "y", "heading")
ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Course:
    """A true drive.

    Attributes:
        model: that drove.
        times: knots (N + 1,) [s].
        inputs: held from knot to knot, (N, inputs).
        states: at the knots, (N + 1, states).
    """

    model: Model
    times: np.ndarray
    inputs: np.ndarray
    states: np.ndarray


def truth_of(model: Model, **values: float) -> np.ndarray:
    """Nominal parameters but for those named."""
    names = [parameter.name for parameter in model.parameters]
    assert set(values) <= set(names)
    return np.array([values.get(name, nominal) for name, nominal in zip(names, model.nominal, strict=True)])


def rich_inputs(model: Model, times: np.ndarray, seed: int = 0, size: float = 1.0) -> np.ndarray:
    """Smooth inputs (times, inputs) that do all a robot can: wheels of mean 2 rad/s, angles of mean 0."""
    rng, columns = np.random.default_rng(seed), []
    for entry in model.inputs:
        speed = entry.quantity == "wheel_speed"
        waves = rng.uniform(0.15, 0.9, 4)[:, None] * times + rng.uniform(0, 2 * np.pi, 4)[:, None]
        swing = np.sin(waves).sum(axis=0)
        columns.append(2 + 2.2 * swing if speed else 0.14 * swing)
    return size * np.column_stack(columns)


def twists_of(model: Model, inputs: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Body twists (N, 3) of inputs (N, inputs); of the differential drive without the package."""
    if model.kind == "differential_drive":
        right, left = inputs[:, 0] * parameters[0], inputs[:, 1] * parameters[1]
        return np.column_stack([(right + left) / 2, 0 * right, (right - left) / parameters[2]])
    return np.array(_twist(model).map(len(inputs))(inputs.T, ca.repmat(ca.DM(parameters), 1, len(inputs)))).T


@cache
def _twist(model: Model) -> ca.Function:
    inputs, parameters = ca.SX.sym("u", len(model.inputs)), ca.SX.sym("p", len(model.parameters))
    return ca.Function("twist", [inputs, parameters], [model.twist(inputs, parameters)])


def trailer_angles(
    start: float, twists: np.ndarray, steps: np.ndarray, offset: float, length: float, parts: int = 20
) -> np.ndarray:
    """A trailer's angle at the knots (N + 1,): no velocity across it, by fine Runge-Kutta steps."""

    def rate(angle: float, forward: float, yaw_rate: float) -> float:
        across = -offset * yaw_rate * np.cos(angle) - forward * np.sin(angle)
        return float(across / length - yaw_rate)

    angles = [start]
    for (forward, _, yaw_rate), step in zip(twists, steps, strict=True):
        angle, part = angles[-1], step / parts
        for _ in range(parts):
            first = rate(angle, forward, yaw_rate)
            second = rate(angle + part / 2 * first, forward, yaw_rate)
            third = rate(angle + part / 2 * second, forward, yaw_rate)
            fourth = rate(angle + part * third, forward, yaw_rate)
            angle += part / 6 * (first + 2 * second + 2 * third + fourth)
        angles.append(angle)
    return np.array(angles)


def following(
    asked: np.ndarray, steps: np.ndarray, lag: float, start: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Means (N,) of a rate that follows with a lag [s], and the rate itself (N + 1,)."""
    means, rates = [], [start]
    for wanted, step in zip(asked, steps, strict=True):
        left = np.exp(-step / lag)
        means.append(wanted + (rates[-1] - wanted) * lag * (1 - left) / step)
        rates.append(wanted + (rates[-1] - wanted) * left)
    return np.array(means), np.array(rates)


def lagging(
    twists: np.ndarray, steps: np.ndarray, lag: float, ahead: float, start: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Mean twists (N, 3) of a robot whose yaw rate follows with a lag [s], and that yaw rate (N + 1,)."""
    turned, rates = following(twists[:, 2], steps, lag, start)
    return np.column_stack([twists[:, 0], -ahead * turned, turned]), rates


def course(
    model: Model = ROBOT,
    parameters: np.ndarray | None = None,
    *,
    seconds: float = 20.0,
    period: float = 0.1,
    seed: int = 0,
    start: Sequence[float] = (0.3, -0.2, 0.7),
    inputs: np.ndarray | None = None,
    times: np.ndarray | None = None,
    drift: float = 0.0,
) -> Course:
    """A drive with rich motion.

    Args:
        model: the robot.
        parameters: true ones (p,), SI; the usual robot's by default.
        seconds: how long.
        period: between knots [s].
        seed: of the inputs and the drift.
        start: the first pose.
        inputs: instead of the rich ones, (N, inputs).
        times: instead of even ones, (N + 1,).
        drift: deviation after a second of a random walk that the twist makes besides the wheels [m/s, rad/s].
    """
    own = truth_of(model, **TRUTH) if parameters is None else np.asarray(parameters)
    knots = period * np.arange(round(seconds / period) + 1) if times is None else times
    held = rich_inputs(model, (knots[1:] + knots[:-1]) / 2, seed) if inputs is None else inputs
    steps, twists = np.diff(knots), twists_of(model, held, own)
    walk = np.random.default_rng([seed, 1]).normal(size=(len(steps), 2)) * np.sqrt(steps)[:, None]
    twists = twists + drift * np.cumsum(walk, axis=0) @ np.array([[1.0, 0, 0], [0, 0, 1]])
    further = np.zeros((len(knots), 0))
    if model.kind == "skid_steer_slip" and "yaw_rate" in model.states:
        twists, yaw_rates = lagging(twists, steps, *own[[3, -1]])
        further = yaw_rates[:, None]
    if model.kind == "unicycle" and len(model.states) == 5:
        ahead, turned = (
            following(twists[:, place], steps, lag) for place, lag in ((0, own[-2]), (2, own[-1]))
        )
        twists = np.column_stack([ahead[0], np.zeros(len(steps)), turned[0]])
        further = np.column_stack([ahead[1], turned[1]])
    states = np.column_stack([arcs(start, twists, steps), further])
    if model.kind == "tractor_trailer":
        states = np.column_stack([states, trailer_angles(0.1, twists, steps, *own[3:5])])
    return Course(model, knots, held, states)


def readings(states: np.ndarray, place: Sequence[float] = ORIGIN, quantities: Sequence[str] = XYH):
    """What a pose sensor at `place` reads of states (n, states)."""
    x, y, heading = states[:, :3].T
    ahead, left, turned = place
    table = {
        "x": x + ahead * np.cos(heading) - left * np.sin(heading),
        "y": y + ahead * np.sin(heading) + left * np.cos(heading),
        "heading": heading + turned,
        "trailer_angle": states[:, -1],
    }
    return np.column_stack([table[name] for name in quantities])


def log_of(
    drive: Course,
    *,
    place: Sequence[float] = ORIGIN,
    offset: float = 0.0,
    noise: tuple[float, float] = (0.0, 0.0),
    per_speed: tuple[float, float] = (0.0, 0.0),
    per_yaw_rate: tuple[float, float] = (0.0, 0.0),
    outliers: float = 0.0,
    quantum: float = 0.0,
    every: int = 1,
    rows: np.ndarray | None = None,
    quantities: tuple[str, ...] = XYH,
    seed: int = 0,
    name: str = "drive",
    file: str | None = None,
) -> Log:
    """The log of a drive.

    Args:
        drive: as it truly was.
        place: of the sensor: ahead, to the left [m], turned [rad].
        offset: what the inputs' clock shows when the poses' shows 0 [s].
        noise: standard deviations of positions [m] and angles [rad].
        per_speed: what they grow by with the speed [s, rad s/m].
        per_yaw_rate: what they grow by with the yaw rate [m s/rad, s].
        outliers: share of readings that are wrong by ten to forty times their noise.
        quantum: of the wheels' encoders [rad].
        every: knots between poses.
        rows: knots at which there are poses, instead.
        quantities: read.
        seed: of the noise.
        name: of the drive.
        file: it was read from; by default its own.
    """
    rng = np.random.default_rng([seed, 2])
    chosen = np.arange(0, len(drive.times), every) if rows is None else rows
    true = readings(drive.states, place, quantities)[chosen]
    path = readings(drive.states, place, ("x", "y"))
    speeds = np.linalg.norm(np.gradient(path, drive.times, axis=0), axis=1)[chosen]
    own = [0 if quantity in ("x", "y") else 1 for quantity in quantities]
    turning = np.gradient(drive.states[:, 2], drive.times)[chosen]
    sizes = np.sqrt(
        np.take(noise, own) ** 2
        + (np.take(per_speed, own) * speeds[:, None]) ** 2
        + (np.take(per_yaw_rate, own) * turning[:, None]) ** 2
    )
    errors = sizes * rng.normal(size=true.shape)
    wrong = rng.random(true.shape) < outliers
    errors += wrong * sizes * rng.uniform(10, 40, true.shape) * rng.choice([-1, 1], true.shape)
    turned = np.cumsum(
        np.vstack([0 * drive.inputs[:1], drive.inputs * np.diff(drive.times)[:, None]]), axis=0
    )
    if quantum:
        turned = quantum * np.floor(turned / quantum)
    return Log(
        name=name,
        file=file or f"{name}.csv",
        input_times=drive.times + offset,
        integrals=turned,
        pose_times=drive.times[chosen],
        poses=true + errors,
        quantities=quantities,
    )


def several(
    count: int, *, drift: float = 0.0, seconds: float = 12.0, seed: int = 0, **keys: Any
) -> list[Log]:
    """Logs of different drives of the usual robot."""
    drives = [course(seconds=seconds, seed=seed + number, drift=drift) for number in range(count)]
    return [
        log_of(drive, name=f"drive {number}", seed=seed + number, **keys)
        for number, drive in enumerate(drives)
    ]


def with_losses(log: Log, seed: int = 0, share: float = 0.3, seconds: float = 0.1) -> Log:
    """The same without the poses of bursts in which the tracker lost the robot.

    Args:
        log: with all poses.
        seed: of the bursts.
        share: of the poses lost.
        seconds: mean length of a burst [s].
    """
    rng, times = np.random.default_rng([seed, 4]), log.pose_times
    lost, end = np.zeros(len(times), dtype=bool), times[0]
    while end < times[-1]:
        begin = end + rng.exponential(seconds * (1 - share) / share)
        end = begin + rng.exponential(seconds)
        lost |= (times > begin) & (times < end)
    lost[[0, -1]] = False
    return replace(log, pose_times=times[~lost], poses=log.poses[~lost])


def lasting(log: Log, size: float, seconds: float, seed: int = 0) -> Log:
    """The same with errors of the positions that last, as those by satellites do: a Gauss-Markov process.

    Args:
        log: with x and y.
        size: standard deviation [m].
        seconds: after which the correlation has fallen to 1/e [s].
        seed: of the errors.
    """
    new = np.random.default_rng([seed, 5]).normal(size=(len(log.pose_times), 2))
    left = np.exp(-np.diff(log.pose_times, prepend=-np.inf) / seconds)
    errors = np.zeros(2)
    poses = log.poses.copy()
    for row, share in enumerate(left):
        errors = share * errors + size * np.sqrt(1 - share**2) * new[row]
        poses[row, :2] += errors
    return replace(log, poses=poses)


def exchanged(log: Log, first: int = 0, second: int = 1) -> Log:
    """The same with two inputs' columns exchanged."""
    order = list(range(log.integrals.shape[1]))
    order[first], order[second] = second, first
    return replace(log, integrals=log.integrals[:, order])


def negated(log: Log, *places: int) -> Log:
    """The same with some inputs' signs wrong."""
    signs = np.ones(log.integrals.shape[1])
    signs[list(places)] = -1
    return replace(log, integrals=log.integrals * signs)


def heading_times(log: Log, factor: float) -> Log:
    """The same with its headings in another unit, or of the other sign."""
    factors = [factor if name == "heading" else 1.0 for name in log.quantities]
    return replace(log, poses=log.poses * factors)


logged_problem = partial(
    problem_of,
    model=ROBOT,
    limits=input_limits,
    measurement=Poses(noise=AbsoluteNoise(position=0.002, heading=0.005), initial_pose="unknown"),
    criterion=E(),
)
"""A problem about a robot; its drive does not matter."""


def options(**keys: Any) -> CalibrationOptions:
    return CalibrationOptions(**keys)


def unknowns_of(
    model: Model = ROBOT,
    place: tuple[str, ...] = (),
    clocks: int = 0,
    names: tuple[str, ...] | None = None,
    sits: tuple[float, float, float] = ORIGIN,
) -> Unknowns:
    every = tuple(parameter.name for parameter in model.parameters)
    return Unknowns(model, names or every, place, clocks, sits)


def search_of(
    logs: Sequence[Log], unknowns: Unknowns | None = None, seconds: float = np.inf, **keys: Any
) -> JointSearch:
    """A search over segments of logs, without anything known beforehand and without clocks unless told."""
    own = unknowns or unknowns_of()
    layout: SegmentLayout = cut(logs, seconds, [0.0] * len(logs))
    nothing = Knowledge.nothing(own.size)
    usual = {"offsets": np.zeros(len(layout.clocks)), "known": nothing, "grows": False}
    return JointSearch(layout, own, **{**usual, **keys})


def fit_of(
    logs: Sequence[Log], unknowns: Unknowns | None = None, seconds: float = np.inf, **keys: Any
) -> Fit:
    """The solution."""
    return search_of(logs, unknowns, seconds, **keys).fit()


def loosely(unknowns: Unknowns, size: float = 1.0) -> Knowledge:
    """Next to nothing known: `size` times each unknown's scale."""
    return Knowledge(np.diag((size * unknowns.scale) ** -2.0), unknowns.nominal)


def by_name(fit: Fit) -> Mapping[str, float]:
    return dict(zip(fit.unknowns.names, map(float, fit.values), strict=True))

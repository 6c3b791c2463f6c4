"""Random drives of a study: anywhere within the inputs' bounds, or scaled until they seem to keep every
limit; and studies whose limits are drawn around a drive, so that it breaks them between the points that are
looked at first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..oracle.limits import excesses
from ..oracle.robots import robot_of
from ..oracle.shapes import room_clearance
from ..oracle.splines import Run, clamped_run, polygon_run
from ..oracle.track import Track
from .quantities import Quantity, log_uniform, one_of, plain
from .rooms import clear_of, draw_obstacle, inner_point
from .studies import Study

Rng = np.random.Generator
Array = np.ndarray[Any, Any]

COARSE = 10
"""Points per sample at which a drive seems to keep its limits."""
BISECTIONS = 7
SEEMINGLY = 9e-4
"""Share of a limit's size by which a drive may seem to exceed it, just below what a scorer tolerates."""


@dataclass(frozen=True)
class Drive:
    """Runs as the oracle knows them, and what makes the package's trajectory of them.

    Attributes:
        runs: of equal length.
        polygon: whether they are a path's straight lines, not splines of the study.
    """

    runs: tuple[Run, ...]
    polygon: bool = False

    @property
    def coefficients(self) -> Array:
        """Of all runs, one below the other."""
        return np.vstack([run.coefficients for run in self.runs])

    @property
    def held(self) -> Array:
        """Inputs of all periods."""
        return np.vstack([run.held for run in self.runs])

    @property
    def starts(self) -> Array:
        """Poses (runs, 3)."""
        return np.array([run.start for run in self.runs])


def draw_drive(rng: Rng, study: Study) -> Drive:
    """Any drive within the bounds of the inputs' coefficients."""
    space = plain(study.spec["trajectory"])
    shares = _shares(rng, space, len(study.bounds))
    return _built(study, shares, _starts(rng, study), log_uniform(rng, 0.05, 1.0))


def _shares(rng: Rng, space: Mapping[str, Any], inputs: int) -> Array:
    # Shares of the inputs' ranges, in [0, 1], of all coefficients: noise, steps, or smooth.
    count, runs = space["spline"]["coefficients"], space["runs"]
    sort = rng.random()
    if sort < 0.4:
        return rng.random((runs, count, inputs))
    if sort < 0.6:
        return np.round(rng.random((runs, count, inputs)))
    grid = np.linspace(0, 1, count)[None, :, None]
    waves = rng.uniform(0.3, 3, (runs, 1, inputs)), rng.uniform(0, 2 * np.pi, (runs, 1, inputs))
    return 0.5 + 0.5 * np.sin(2 * np.pi * waves[0] * grid + waves[1])


def _starts(rng: Rng, study: Study) -> Array:
    space, runs = plain(study.spec["trajectory"]), study.spec["trajectory"]["runs"]
    start = space["start"]
    if start == "free":
        room = plain(study.spec["limits"]["workspace"])
        places = [inner_point(rng, room, study.size)[0] for _ in range(runs)]
        return np.array([[*place, rng.uniform(-np.pi, np.pi)] for place in places])
    poses = start if isinstance(start, list) else [start] * runs
    return np.array([[pose["x"], pose["y"], pose["heading"]] for pose in poses])


def _built(study: Study, shares: Array, starts: Array, amplitude: float) -> Drive:
    space = plain(study.spec["trajectory"])
    low, high = study.bounds.T
    calm = np.clip(0.0, low, high)
    coefficients = calm + amplitude * (low + shares * (high - low) - calm)
    if space["rest_to_rest"]:
        coefficients[:, [0, -1]] = 0.0
    degree, samples = space["spline"]["degree"], space["samples"]
    runs = [
        clamped_run(space["duration"], degree, own, start, samples)
        for own, start in zip(coefficients, starts, strict=True)
    ]
    return Drive(tuple(runs))


def draw_seemingly_feasible(rng: Rng, study: Study) -> Drive:
    """A drive scaled until it seems to keep every limit at `COARSE` points a sample; as it is where no scale
    does.
    """
    space = plain(study.spec["trajectory"])
    shares, starts = _shares(rng, space, len(study.bounds)), _starts(rng, study)
    spec, best = plain(study.spec), None
    low, high = 0.0, 1.0
    for step in range(BISECTIONS):
        amplitude = high if step == 0 else (low + high) / 2
        drive = _built(study, shares, starts, amplitude)
        if seemingly_feasible(spec, drive.runs):
            best, low = drive, amplitude
            if step == 0:
                break
        else:
            high = amplitude
    return best or _built(study, shares, starts, high)


def seemingly_feasible(spec: Mapping[str, Any], runs: Sequence[Run]) -> bool:
    """Whether a drive keeps every limit at a few points."""
    return all(one.amount <= SEEMINGLY * one.size for one in excesses(spec, runs, COARSE))


def draw_polygon(rng: Rng, study: Study) -> Drive:
    """A path as files give it: held inputs, straight lines in between."""
    space = plain(study.spec["trajectory"])
    low, high = study.bounds.T
    samples, rest = space["samples"], space["rest_to_rest"]
    held = log_uniform(rng, 0.1, 1.0) * rng.uniform(low, high, (space["runs"], samples, len(low)))
    held = np.clip(held, low, high)
    runs = [
        polygon_run(own, space["duration"], start, rest=rest)
        for own, start in zip(held, _starts(rng, study), strict=True)
    ]
    return Drive(tuple(runs), polygon=True)


# --- limits around a drive ---


def pinched(rng: Rng, study: Study) -> tuple[Study, Drive]:
    """A study whose limits a drive seems to touch, or that has a thing in the way between two points."""
    drive = draw_drive(rng, study)
    for change in rng.permutation(np.array(_PINCHES, dtype=object))[: int(rng.integers(1, 3))]:
        study = change(rng, study, drive)
    return study, drive


def _with_limit(study: Study, **limits: Any) -> Study:
    spec = {**study.spec, "limits": {**study.spec["limits"], **limits}}
    given = {**study.given, "limits": {**study.given["limits"], **limits}}
    return replace(study, spec=spec, given=given)


def _tightened(rng: Rng, study: Study, drive: Drive) -> Study:
    # Bounds on motion and inputs at what a few points see of them, and hardly more.
    spec = plain(study.spec)
    names = [name for name in _UNITS if name in _possible(study)]
    name = one_of(rng, names)
    probe = {**spec, "limits": {name: 1e-12}}
    seen = [one for one in excesses(probe, drive.runs, COARSE) if one.limit == name]
    if not seen or not np.isfinite(seen[0].amount) or seen[0].amount <= 1e-9:
        return study
    return _with_limit(study, **{name: Quantity(seen[0].amount * rng.uniform(1.0, 1.001), _UNITS[name])})


_UNITS = {
    "wheel_acceleration": "rad/s^2",
    "wheel_jerk": "rad/s^3",
    "commanded_acceleration": "m/s^2",
    "commanded_yaw_acceleration": "rad/s^2",
    "body_speed": "m/s",
    "yaw_rate": "rad/s",
    "lateral_acceleration": "m/s^2",
    "trailer_angle": "rad",
    "path_length": "m",
}


def _possible(study: Study) -> set[str]:
    found = set(_UNITS)
    robot = study.robot
    if study.spec["trajectory"]["spline"]["degree"] < 2:
        found.discard("wheel_jerk")
    if robot.inputs == ("v", "omega"):
        found -= {"wheel_acceleration", "wheel_jerk"}
    else:
        found -= {"commanded_acceleration", "commanded_yaw_acceleration"}
    if robot.trailer is None:
        found.discard("trailer_angle")
    return found


def _obstructed(rng: Rng, study: Study, drive: Drive) -> Study:
    # A post, a wall or more on the path, between two of the points that are looked at.
    track = _track(rng, study, drive)
    samples = track.run.samples
    share = (int(rng.integers(COARSE)) + 0.5) / COARSE
    period = np.array([int(rng.integers(samples))])
    place = np.concatenate(track.places(period, np.array([share])))
    way = max(float(np.hypot(track.mean[0], track.mean[1]).max()) * track.run.period, 1e-6 * study.size)
    obstacle = draw_obstacle(rng, way * log_uniform(rng, 1.0, 30.0), place)
    starts = drive.starts[:, :2]
    radius = study.robot.body_radius
    if not clear_of(obstacle, starts, radius):
        return study
    return _with_limit(study, obstacles=[*study.spec["limits"].get("obstacles", []), obstacle])


def _walled(rng: Rng, study: Study, drive: Drive) -> Study:
    # A turned room that holds the points of a path, and hardly more: arcs bulge out of it.
    track = _track(rng, study, drive)
    periods = np.repeat(np.arange(track.run.samples), COARSE)
    x, y = track.places(periods, np.tile(np.arange(COARSE) / COARSE, track.run.samples))
    turn = rng.uniform(-np.pi, np.pi)
    ahead, left = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    along, across = x * ahead[0] + y * ahead[1], x * left[0] + y * left[1]
    spare = study.robot.body_radius + 1e-6 * study.size
    pairs = [(one.min() - spare, one.max() + spare) for one in (along, across)]
    least = 0.05 * max(high - low for low, high in pairs) + 3 * spare
    (a, b), (c, d) = ((low, max(high, low + least)) for low, high in pairs)
    corners = [u * ahead + v * left for u, v in ((a, c), (b, c), (b, d), (a, d))]
    room = {"kind": "polygon", "points": [[Quantity(p, "m"), Quantity(q, "m")] for p, q in corners]}
    clearances = room_clearance(plain(room), *drive.starts[:, :2].T)
    if np.any(clearances < study.robot.body_radius * (1 + 1e-9) + 1e-9 * study.size):
        return study
    return _with_limit(study, workspace=room)


def _track(rng: Rng, study: Study, drive: Drive) -> Track:
    rule = study.spec["trajectory"]["integration"]
    robot = robot_of(plain(study.spec["robot"]))
    return Track(robot, drive.runs[int(rng.integers(len(drive.runs)))], rule)


_PINCHES: tuple[Callable[[Rng, Study, Drive], Study], ...] = (_tightened, _obstructed, _walled)

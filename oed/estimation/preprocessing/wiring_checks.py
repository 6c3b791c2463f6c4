"""Wiring checks: wheels exchanged, signs and units wrong, tried out where a log does not fit the robot."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations, product

import numpy as np

from oed.estimation.preprocessing.bends import Bends
from oed.estimation.preprocessing.moves import AS_READ, FEWEST, Axes, Moves, unexplained
from oed.foundation.arrays import Array

BAD = 0.3
"""Share of the motion that may be left unexplained before a wiring fault is looked for."""
BETTER = 0.3
"""Crossed wires are suspected where they leave at most this share of what is left otherwise."""
SIZES = (0.75, 0.85, 1.0, 1.15, 1.35)
"""Factors of a wheel's size that are tried before a fault is looked for."""
BARELY = {"turn": 0.02, "distance": 0.01}
"""Root mean square of moves [rad, m] below which they are taken for noise, or for what is not driven."""

STIRRING, STANDING = 1e-3, 0.1
"""Root mean square of moves [rad, m] from which wheels drive, and the share of it below which poses that are
measured meanwhile stand still."""
PLAINLY = 5.0
"""How many times more than barely the wheels have to drive for poses that stand still in one way only."""

WANDER = {"turn": 0.2, "distance": 0.1}
"""Standard deviation of a log's headings [rad] or positions [m] up to which the robot does not turn, or stays
in its place, whatever makes them wander: slow noise, or slip."""

SPEEDS = {
    "the wheels' speeds were in rpm; give them unit: rpm": math.pi / 30,
    "the wheels' speeds were in deg/s; give them unit: deg/s": math.pi / 180,
    "the wheels' speeds were in turns a second; give them unit: turn/s": 2 * math.pi,
    "the wheels' speeds were in rad/s, not in rpm; give them unit: rad/s": 30 / math.pi,
    "the wheels' speeds were in rad/s, not in deg/s; give them unit: rad/s": 180 / math.pi,
}
"""Units of wheel speeds that are read as rad/s, or the other way round, and their factors."""
TIMES = {
    "the times were in ms; give time unit: ms": 1e-3,
    "the times were in us; give time unit: us": 1e-6,
    "the times were in ns; give time unit: ns": 1e-9,
}
"""Units of times that are read as seconds, and their factors."""
LENGTHS = {
    "positions were in mm; give x and y unit: mm": 1e-3,
    "positions were in cm; give x and y unit: cm": 1e-2,
    "positions were in m, not in cm; give x and y unit: m": 1e2,
    "positions were in m, not in mm; give x and y unit: m": 1e3,
}
"""Units of positions that are read as metres, or the other way round, and their factors."""
MIRRORED: tuple[Axes, ...] = ((1j, 1), (-1, 1j), (1, -1j))
"""Axes of positions that are exchanged, or of which one points the other way."""
MIRROR = "positions are mirrored: are x and y exchanged, or has one of them the wrong sign?"
"""In words."""
MIRRORED_FRAME = (
    "positions are mirrored and headings turn clockwise, as where x points north and y east: exchange the "
    "columns of x and y, or negate one of them, and negate the heading"
)
"""In words, of positions and headings."""
ALIKE = 0.02
"""By how much faults may differ in the share that they leave to be the same to a log."""
Possibility = tuple[str, tuple[Array, float, float, Axes]]
"""What may be wrong, in words, and how the log is then to be read: inputs, the sign and unit of headings, the
unit and axes of positions."""

ACROSS = 0.2
"""Share of its motion that a robot has to drive across a line for neither coordinate to stand still."""
TURNING = 0.1
"""Share of the distances that has to be left unexplained where turns are the wheels' word alone."""


def wiring_fault(moves: Moves) -> str | None:
    """What is most likely wrong with how a log is read, in words; None where nothing is."""
    if moves.layout.count < FEWEST:
        return None
    # A sensor may look backwards; a fault has to explain the log without such an excuse.
    as_given = worst(moves, moves.inputs, any_side=True)
    fault = None
    if as_given >= BAD and not explained_by_other_sizes(moves):
        fault = _most_likely(moves, _possibilities(moves), as_given, ALIKE)
    # Positions alone: distances are the same whatever side a robot turns to.
    turned = _turned_over(moves) if {*moves.layout.quantities} == {"x", "y"} else None
    return turned or fault


def unit_fault(moves: Moves) -> str | None:
    """The unit in which a log most likely is, by how much too far its wheels or poses go; None where that is
    the one it was read in.
    """
    if moves.layout.count < FEWEST:
        return None
    as_given, longer = worst(moves, moves.inputs, any_side=True), moves.lengthening()
    if as_given < BAD:
        return None
    text = _most_likely(moves, _units(moves), as_given)
    known = "heading" in moves.layout.quantities and "x" not in moves.layout.quantities
    ratio = "" if known else f"measured distances are {longer:.2g} times those of the wheels, as if "
    return None if text is None else f"{ratio}{text}"


def _most_likely(
    moves: Moves, possibilities: Iterable[Possibility], as_given: float, alike: float = 0.0
) -> str | None:
    # What explains a log best, with all that leaves no more than `alike` beside it; units differ in size.
    tried = [(worst(moves, *what), text) for text, what in possibilities]
    left = min((share for share, _ in tried), default=math.inf)
    if left < min(BETTER * as_given, BAD):
        before = f"{100 * as_given:.0f} %" if as_given < 1 else "all of it"
        rest = f"{100 * max(left, 0.0):.0f} %"
        return (
            f"{_alike(tried, left + alike)}: that leaves {rest} of the motion unexplained instead of {before}"
        )
    return None


def _alike(tried: Iterable[tuple[float, str]], most: float) -> str:
    # All faults that explain a log as well as the best, for the log does not tell them apart.
    return "; or ".join(dict.fromkeys(text for share, text in tried if share <= most))


def _turned_over(moves: Moves) -> str | None:
    # What makes a robot turn to the other side, by the bends of its path; all that does so alike is named.
    bends = Bends(moves)
    as_given = float(bends.unexplained(moves.inputs).min())
    if as_given < BAD or not math.isfinite(as_given):
        return None

    def left(inputs: Array, sign: float = 1.0, unit: float = 1.0, axes: Axes = AS_READ) -> float:
        return max(worst(moves, inputs, sign, unit, axes), float(bends.unexplained(inputs, axes).min()))

    mirrored: Possibility = (MIRROR, (moves.inputs, 1.0, 1.0, MIRRORED[-1]))
    tried = [(left(*what), text) for text, what in (*_possibilities(moves), mirrored)]
    least = min(one for one, _ in tried)
    if least >= min(BETTER * as_given, BAD) or any(left(inputs) < BAD for inputs in _other_sizes(moves)):
        return None
    before = f"{100 * as_given:.0f} %" if as_given < 1 else "all"
    rest, named = f"{100 * least:.0f} %", _alike(tried, least + ALIKE)
    return f"{named}: that leaves {rest} of the path's bends unexplained instead of {before}"


def explained_by_other_sizes(moves: Moves) -> bool:
    """Whether wheels of other sizes would move as measured.

    Nominal sizes far off do as much harm on gentle turns as exchanged wheels: they are to be estimated.
    """
    return any(worst(moves, inputs, any_side=True) < BAD for inputs in _other_sizes(moves))


def _other_sizes(moves: Moves) -> Iterator[Array]:
    # The inputs of wheels of other sizes.
    driving = [place for place, entry in enumerate(moves.robot.inputs) if entry.drives]
    for pair in combinations(driving, min(2, len(driving))):
        for factors in product(SIZES, repeat=len(pair)):
            scale = np.ones(len(moves.robot.inputs))
            scale[list(pair)] = factors
            yield moves.inputs * scale


def poorly_explained(moves: Moves) -> float | None:
    """Share of the motion that the wheels do not explain, where it is too large to be believed."""
    measured = moves.measured()
    left = unexplained(measured, moves.predicted(), moves.noise(), any_side=True)
    sizes = _sizes(measured)
    worst = max((share for name, share in left.items() if sizes[name] > BARELY[name]), default=0.0)
    return worst if worst >= BAD else None


def moves_one_way(moves: Moves) -> bool:
    """Whether the robot goes straight, or turns in place, by poses and wheels, and the wheels explain that.

    Of the other kind of motion there is nothing to be explained then, though its noise may be slow.
    """
    headings, quantities, readings = moves.headings(), moves.layout.quantities, moves.layout.readings
    if headings is None or "x" not in quantities:
        return False
    x, y = (readings[:, 0, quantities.index(name)] for name in ("x", "y"))
    ways = moves.rolled()["forward"]
    left = unexplained(moves.measured(), moves.predicted(), moves.noise(), any_side=True)
    straight = max(_wander(moves, one) for one in (headings, _headings_by_wheels(moves))) < WANDER["turn"]
    in_place = max(_wander(moves, one) for one in (x, y, _by_wheels(moves, ways))) < WANDER["distance"]
    return (straight and left.get("distance", 1.0) < BAD) or (in_place and left.get("turn", 1.0) < BAD)


def _wander(moves: Moves, values: Array) -> float:
    # The largest standard deviation within a log.
    owner = moves.layout.owner
    return max(float(np.std(values[owner == number])) for number in np.unique(owner))


def stands_still(moves: Moves) -> bool:
    """Whether the measured poses go nowhere, or never turn, while the wheels plainly do.

    Of such a log any fit would make wheels of no size.
    """
    measured, driven = _sizes(moves.measured()), _sizes(moves.predicted())
    still = {name: measured[name] < STANDING * size for name, size in driven.items() if size > STIRRING}
    plainly = any(still.get(name, False) and driven[name] > PLAINLY * BARELY[name] for name in driven)
    return plainly or (bool(still) and all(still.values()))


def frozen(moves: Moves) -> str | None:
    """The coordinate that hardly changes, though the robot plainly drives across every line; None if none.

    Whatever the frame, each coordinate changes by as much as the robot drives across its main direction.
    """
    x, y, heading = moves.changes("x"), moves.changes("y"), moves.headings()
    if x is None or y is None or moves.layout.count < FEWEST:
        return None
    if heading is None:
        heading = _headings_by_wheels(moves)
        if unexplained(moves.measured(), moves.predicted(), moves.noise()).get("distance", 0.0) < TURNING:
            return None
    rolled = moves.rolled()
    way = (rolled["forward"] + 1j * rolled["left"]) * np.exp(1j * heading)
    size, along = float(np.mean(np.abs(way) ** 2)), float(np.abs(np.mean(way**2)))
    across = math.sqrt(max(size - along, 0.0) / 2)
    if across < max(STIRRING, ACROSS * math.sqrt(size)):
        return None
    still = [name for name, own in (("x", x), ("y", y)) if np.sqrt(np.mean(own**2)) < STANDING * across]
    return still[0] if still else None


def _headings_by_wheels(moves: Moves) -> Array:
    # At the start of each move, as the wheels turn the robot.
    return _by_wheels(moves, moves.rolled()["turn"])


def _by_wheels(moves: Moves, changes: Array) -> Array:
    # What changes add up to before each move; from 0 in each log.
    owner = moves.layout.owner
    before = np.concatenate([[0.0], np.cumsum(changes)[:-1]])
    return np.asarray(before - before[np.searchsorted(owner, owner)])


def _sizes(moves: Mapping[str, Array]) -> dict[str, float]:
    # Root mean square of distances [m] and turns [rad], as far as they are known.
    found = {name: moves[name] for name in ("distance", "turn") if name in moves}
    if "forward" in moves:
        found["distance"] = np.hypot(moves["forward"], moves["left"])
    return {name: float(np.sqrt(np.mean(values**2))) for name, values in found.items()}


def worst(
    moves: Moves,
    inputs: Array,
    sign: float = 1.0,
    unit: float = 1.0,
    axes: Axes = AS_READ,
    *,
    any_side: bool = False,
) -> float:
    """Share of the motion that is left unexplained, of turns or distances that of which it is the larger.

    Args:
        moves: of logs.
        inputs: of the wheels, (S, n, inputs).
        sign: of headings, as `Moves.measured` takes it.
        unit: of these.
        axes: of positions.
        any_side: whether the sensor may be turned by any angle.
    """
    measured, predicted = moves.measured(sign, unit, axes), moves.predicted(inputs)
    left = unexplained(measured, predicted, moves.noise(unit, axes), any_side=any_side)
    return max(left.values(), default=0.0)


def _units(moves: Moves) -> Iterator[Possibility]:
    driving = np.array([entry.drives for entry in moves.robot.inputs])
    turning = [entry.unit == "rad/s" for entry in moves.robot.inputs if entry.drives]
    for what, factor in (SPEEDS if all(turning) else {}).items() | TIMES.items():
        yield what, (np.where(driving, factor, 1.0) * moves.inputs, 1.0, 1.0, AS_READ)
    for text, factor in LENGTHS.items() if "x" in moves.layout.quantities else ():
        yield text, (moves.inputs, 1.0, 1.0, (factor, factor * 1j))


def inputs_misread(moves: Moves) -> Iterator[tuple[str, Array]]:
    """What may be wrong with wheels, in words, and their inputs if it is."""
    robot, inputs = moves.robot, moves.inputs
    for first, second in combinations(range(len(robot.inputs)), 2):
        if robot.inputs[first].quantity != robot.inputs[second].quantity:
            continue
        order = np.arange(inputs.shape[-1])
        order[[first, second]] = second, first
        names = f"{robot.input_names[first]} and {robot.input_names[second]}"
        yield f"{names} are exchanged; exchange their columns", inputs[..., order]
    for places in _sign_groups(len(robot.inputs)):
        names = " and ".join(robot.input_names[place] for place in places)
        signs = np.where(np.isin(np.arange(inputs.shape[-1]), places), -1.0, 1.0)
        has, it = ("has", "it") if len(places) == 1 else ("have", "them")
        yield f"{names} {has} the wrong sign; give {it} sign: -1", inputs * signs
    if len(robot.inputs) > 1:
        yield "all inputs have the wrong sign; give them sign: -1", -inputs


def _possibilities(moves: Moves) -> Iterator[Possibility]:
    inputs = moves.inputs
    for text, misread in inputs_misread(moves):
        yield text, (misread, 1.0, 1.0, AS_READ)
    if "heading" in moves.layout.quantities:
        yield "the heading has the wrong sign (it turns to the left)", (inputs, -1.0, 1.0, AS_READ)
        yield "the heading is in degrees; give it unit: deg", (inputs, 1.0, math.pi / 180, AS_READ)
        yield "the heading is in radians, not in degrees", (inputs, 1.0, 180 / math.pi, AS_READ)
        for axes in MIRRORED if "x" in moves.layout.quantities else ():
            yield MIRROR, (inputs, 1.0, 1.0, axes)
            yield MIRRORED_FRAME, (inputs, -1.0, 1.0, axes)


def _sign_groups(count: int) -> Iterator[tuple[int, ...]]:
    # Inputs whose signs may be wrong: one, or two of more than two.
    yield from combinations(range(count), 1)
    if count > 2:
        yield from combinations(range(count), 2)

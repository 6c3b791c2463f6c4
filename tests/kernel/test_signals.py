"""What inputs may do: signals against their formulas, and spaces that are made of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

import oed
from oed.foundation.errors import PartError, ProblemError
from oed.kernel.dynamics.embedding import Embedding
from oed.kernel.dynamics.signals import (
    SIGNALS,
    Constant,
    Fourier,
    PiecewiseConstant,
    PiecewiseLinear,
    Signal,
    SplineSignal,
)
from oed.kernel.dynamics.starts import StartStates

EXAMPLES: tuple[Signal, ...] = (
    Constant(),
    PiecewiseConstant(pieces=7),
    PiecewiseConstant(pieces=24),
    PiecewiseLinear(pieces=5),
    PiecewiseLinear(pieces=23),
    SplineSignal(degree=3, coefficients=6),
    SplineSignal(degree=2, coefficients=9, rest_to_rest=True),
    SplineSignal(degree=0, coefficients=5),
    Fourier(harmonics=3),
    Fourier(harmonics=2, period="1500 ms"),
)
DURATION, SAMPLES = 4.0, 24


def at(signal: Signal, unknowns: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The signal at times, by its definition."""
    if isinstance(signal, Constant):
        return np.full(len(times), unknowns[0])
    if isinstance(signal, PiecewiseConstant):
        ends = np.linspace(0, DURATION, signal.pieces + 1)[1:]
        # A middle where two pieces meet is of the later one.
        return unknowns[[int(np.sum(ends <= time + 1e-9)) for time in times]]
    if isinstance(signal, PiecewiseLinear):
        return np.interp(times, np.linspace(0, DURATION, signal.pieces + 1), unknowns)
    if isinstance(signal, SplineSignal):
        padded = np.pad(unknowns, 1) if signal.rest_to_rest else unknowns
        inner = np.linspace(0, DURATION, signal.coefficients - signal.degree + 1)
        knots = np.concatenate([[0.0] * signal.degree, inner, [DURATION] * signal.degree])
        return BSpline(knots, padded, signal.degree)(times)
    assert isinstance(signal, Fourier)
    period = signal.period or DURATION
    found = np.full(len(times), unknowns[0])
    for order in range(1, signal.harmonics + 1):
        phase = 2 * np.pi * order * times / period
        found += unknowns[order] * np.cos(phase) + unknowns[signal.harmonics + order] * np.sin(phase)
    return found


@pytest.mark.parametrize("signal", EXAMPLES, ids=lambda one: f"{one.kind}-{one.unknowns}")
class TestEverySignal:
    def test_holds_its_value_in_the_middle_of_each_period(self, signal: Signal):
        times = (np.arange(SAMPLES) + 0.5) * DURATION / SAMPLES
        unknowns = np.random.default_rng(0).normal(size=signal.unknowns)
        matrix = signal.matrix(DURATION, SAMPLES)
        assert matrix.shape == (SAMPLES, signal.unknowns)
        np.testing.assert_allclose(matrix @ unknowns, at(signal, unknowns, times), atol=1e-12)

    def test_its_unknowns_are_told_apart(self, signal: Signal):
        assert signal.doubts(DURATION, SAMPLES, -1.0, 1.0) == ""
        assert np.linalg.matrix_rank(signal.matrix(DURATION, SAMPLES)) == signal.unknowns

    def test_what_is_drawn_stays_in_its_range(self, signal: Signal):
        low, high = signal.bounds(-1.0, 3.0).T
        drawn = np.random.default_rng(0).uniform(low, high, (500, signal.unknowns))
        held = signal.within(drawn, -1.0, 3.0) @ signal.matrix(DURATION, SAMPLES).T
        assert held.min() >= -1 - 1e-12
        assert held.max() <= 3 + 1e-12
        assert np.ptp(held) > 2


def test_every_signal_has_an_example():
    assert {type(one) for one in EXAMPLES} == set(SIGNALS)


def test_amplitudes_of_waves_are_half_a_range_either_way():
    np.testing.assert_array_equal(
        Fourier(harmonics=1).bounds(1.0, 4.0), [[1.0, 4.0], [-1.5, 1.5], [-1.5, 1.5]]
    )


def test_waves_that_have_room_are_left_as_they_are():
    unknowns = np.array([[1.0, 0.3, -0.1, 0.2, 0.05]])
    np.testing.assert_array_equal(Fourier(harmonics=2).within(unknowns, 0.0, 2.0), unknowns)


def mixed(**parts) -> oed.SignalSpace:
    signals = (PiecewiseConstant(pieces=5), Constant(), Fourier(harmonics=2, shared=True))
    return oed.SignalSpace(
        **{"duration": DURATION, "samples": SAMPLES, "runs": 2, "signals": signals, **parts}
    )


class TestMixedSpaces:
    def test_are_held_like_splines_of_degree_0(self):
        space = mixed()
        drive = space.trajectory(np.arange(2.0 * SAMPLES * 3).reshape(-1, 3), np.zeros((2, 1)))
        assert drive.degree == 0
        np.testing.assert_array_equal(drive.inputs, drive.coefficients)
        assert space.rest_to_rest is False

    def test_a_table_and_its_unknowns(self):
        embedding = Embedding(mixed(), 3)
        assert embedding.sizes == (10, 2, 5)
        unknowns = np.random.default_rng(0).normal(size=embedding.size)
        table = embedding.table(unknowns)
        times = (np.arange(SAMPLES) + 0.5) * DURATION / SAMPLES
        for run in range(2):
            own = table[run * SAMPLES : (run + 1) * SAMPLES]
            parts = [unknowns[5 * run : 5 * run + 5], unknowns[10 + run : 11 + run], unknowns[12:]]
            for place, (signal, part) in enumerate(zip(mixed().signals, parts, strict=True)):
                np.testing.assert_allclose(own[:, place], at(signal, part, times), atol=1e-12)
        np.testing.assert_allclose(embedding.unknowns(table), unknowns, atol=1e-12)

    @pytest.mark.parametrize("place", [0, 1, 2])
    def test_of_other_drives_there_are_no_unknowns(self, place: int):
        embedding = Embedding(mixed(), 3)
        table = embedding.table(np.random.default_rng(0).normal(size=embedding.size))
        table[3, place] += 1e-3
        with pytest.raises(ValueError, match=rf"^input {place + 1} of the trajectory is not"):
            embedding.unknowns(table)

    def test_what_is_shared_is_the_same_in_all_runs(self):
        embedding = Embedding(mixed(), 3)
        table = embedding.table(np.random.default_rng(0).normal(size=embedding.size))
        table[SAMPLES:, 2] *= 2
        with pytest.raises(ValueError, match="fourier, the same in all runs"):
            embedding.unknowns(table)

    def test_one_spline_is_as_it_was(self):
        space = oed.SignalSpace(duration=4, samples=24, spline=oed.Spline(coefficients=7), runs=2)
        embedding = Embedding(space, 2)
        unknowns = np.random.default_rng(0).normal(size=embedding.size)
        expected = np.zeros((14, 2))
        expected[space.free_rows] = unknowns.reshape(-1, 2, order="F")
        np.testing.assert_array_equal(embedding.table(unknowns), expected)
        np.testing.assert_array_equal(embedding.unknowns(expected), unknowns)

    def test_as_data_and_back(self):
        space = mixed()
        assert oed.SignalSpace.model_validate(space.as_data()) == space

    def test_a_signal_by_its_name(self):
        assert mixed(signals=("constant",)).signals == (Constant(),)


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        ({"rest_to_rest": True}, "spline and rest_to_rest are of spaces without signals"),
        ({"spline": oed.Spline(coefficients=4)}, "spline and rest_to_rest are of spaces without signals"),
        ({"start": (1.0,), "start_bounds": ((0, 1),)}, "expected start or start_bounds, got both"),
        ({"start_bounds": ((1.0, 0.0),)}, r"start_bounds: expected finite \(low, high\), got \(1, 0\)"),
        ({"start_bounds": ((0.0, np.inf),)}, r"start_bounds: expected finite \(low, high\)"),
        ({"signals": ("constnat",)}, "did you mean constant"),
    ],
)
def test_spaces_that_contradict_themselves(parts, reason):
    with pytest.raises(PartError, match=reason):
        mixed(**parts)


def decay(least: str = "0 1/s", **parts) -> oed.Problem:
    """A state that decays while it is fed."""
    system = oed.Equations(
        states={"a": ""},
        derivatives={"a": "u - k * a"},
        parameters={"k": "0.5 1/s"},
        inputs={"u": "1/s"},
        outputs={"a": "a"},
    )
    space = {"duration": DURATION, "samples": SAMPLES, "signals": (PiecewiseConstant(pieces=5),)}
    return oed.Problem(
        model=system,
        design=oed.SignalSpace(**{**space, **parts}),
        measurement=oed.Outputs(noise={"a": 0.1}),
        limits=[oed.InputRange(input="u", range=(least, "2 1/s"))],
        criterion="D",
    )


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        (
            {"signals": ("constant", "constant")},
            r"trajectory.signals: expected one for each input \(u\), got 2",
        ),
        (
            {"signals": (PiecewiseConstant(pieces=25),)},
            "trajectory.signals.0: u: 25 unknowns need as many samples in a run, got 24",
        ),
        ({"signals": (PiecewiseLinear(pieces=24),)}, "u: 25 unknowns need as many samples"),
        (
            {"signals": (SplineSignal(degree=3, coefficients=5, rest_to_rest=True),)},
            "u: a degree-3 spline at rest at both ends needs at least 6 coefficients, got 5",
        ),
        (
            {"signals": (Fourier(harmonics=12),)},
            "u: 12 waves of the last harmonic in a run need more than 24",
        ),
        ({"signals": (Fourier(harmonics=4, period=1),)}, "u: 16 waves of the last harmonic"),
        (
            {"signals": (SplineSignal(rest_to_rest=True),), "least": "0.1 1/s"},
            r"trajectory.signals.0: u: \[0.1, 2\] \(SI\) excludes 0, which rest_to_rest needs",
        ),
        ({"start": (1.0, 2.0)}, r"trajectory.start: expected at most one for each state \(a\), got 2"),
        ({"start_bounds": ((0, 1), (0, 1))}, "trajectory.start_bounds: expected at most one for each state"),
    ],
)
def test_spaces_that_do_not_fit_the_system(parts, reason):
    with pytest.raises(ProblemError, match=reason):
        decay(**parts)


@pytest.mark.parametrize(("rest", "least"), [(False, "0.1 1/s"), (True, "-0.1 1/s"), (True, "0 1/s")])
def test_a_spline_fits_a_range_with_the_rest_that_it_needs(rest, least):
    (spline,) = decay(signals=(SplineSignal(rest_to_rest=rest),), least=least).design.signals
    assert spline.rest_to_rest is rest


class TestStarts:
    def test_between_bounds_and_fixed(self):
        chosen = StartStates.between(np.array([[1.0, 3.0], [5.0, 5.0], [-2.0, 0.0]]), 4, 2)
        assert chosen.size == 4
        np.testing.assert_array_equal(chosen.bounds, [[-1.0, 1.0]] * 4)
        starts = chosen.states(np.array([-1.0, 0.5, 0.0, 1.0]))
        np.testing.assert_array_equal(starts, [[1.0, 5.0, -0.5, 0.0], [2.0, 5.0, 0.0, 0.0]])
        np.testing.assert_array_equal(chosen.unknowns(starts), [-1.0, 0.5, 0.0, 1.0])

    @pytest.mark.parametrize("place", [0, 1])
    def test_outside(self, place: int):
        chosen = StartStates.between(np.array([[1.0, 3.0], [5.0, 5.0]]), 2, 1)
        start = np.array([[2.0, 5.0]])
        start[0, place] += 1.5
        assert chosen.excess(start) == pytest.approx([0.5 / 3, 1.5 / 5][place])
        with pytest.raises(ValueError, match="starts outside the design space's start_bounds"):
            chosen.unknowns(start)

    def test_bounds_that_leave_no_choice_are_a_fixed_start(self):
        problem = decay(start_bounds=((0.3, 0.3),), runs=2)
        np.testing.assert_array_equal(problem.fixed_starts, [[0.3], [0.3]])
        assert problem.starts.size == 0

    def test_a_start_outside_is_a_violation(self):
        problem = decay(start_bounds=((0.2, 1.0),))
        for start, violation in ((0.2, 0.0), (1.0, 0.0), (1.2, 0.2), (0.1, 0.1)):
            drive = problem.design.trajectory(np.ones((SAMPLES, 1)), [[start]])
            margins = {one.name: one for one in oed.evaluate(problem, drive).margins}
            assert margins["start"].violation == pytest.approx(violation, abs=1e-12)
            assert margins["start"].satisfied == (violation == 0)

"""Readings of segments against plain NumPy, and their derivatives against difference quotients."""

from __future__ import annotations

from functools import cache
from itertools import cycle

import casadi as ca
import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_robots import ROBOTS, Example, cases, draw_inputs, motion_by_parameters

from oed.estimation.prediction.segments import Driven, SegmentReadings
from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.measurement.readings import readings
from oed.kernel.measurement.sensor import Sensor
from oed.robots.sensors import Poses, Ranges, YawRate
from oed.robots.sensors.mounting import LeverArm

COUNT, PERIODS = 3, 6
XYH = ("x", "y", "heading")
every_robot = pytest.mark.parametrize("robot", cases(ROBOTS))


def drawn(robot: Example, seed: int = 0) -> dict[str, np.ndarray]:
    """Arguments of the readings of a few segments."""
    rng, model = np.random.default_rng(seed), robot.model
    inputs = draw_inputs(rng, COUNT * PERIODS, model)
    return {
        "starts": rng.uniform(-0.5, 0.5, (COUNT, len(model.states))),
        "inputs": inputs.reshape(COUNT, PERIODS, -1),
        "times": rng.uniform(0.05, 0.2, (COUNT, PERIODS)),
        "parameters": np.array(model.nominal) * (1 + rng.uniform(-0.02, 0.02, len(model.nominal))),
        "nuisances": np.array([0.12, -0.07, 0.3]),
    }


@cache
def readings_of(robot: Example, quantities=None, rule="arc", periods: int = PERIODS) -> SegmentReadings:
    return SegmentReadings.logged(robot.model.system(rule), quantities or robot.model.states, COUNT, periods)


def plain(robot: Example, rule: str, starts, inputs, times, parameters, nuisances) -> np.ndarray:
    """The same, period by period."""
    motion, found = motion_by_parameters(robot), []
    for start, held, steps in zip(starts, inputs, times, strict=True):
        states = [start]
        for values, step in zip(held, steps, strict=True):
            if robot.motion:
                twist, inner = robot.motion(states[-1], values, step, parameters)
            else:
                asked = motion(values, parameters)
                twist = robot.mean(states[-1], asked, step, parameters) if robot.mean else asked
                inner = robot.internal(states[-1], asked, step, parameters) if robot.internal else []
            pose = oracle.advance(states[-1], twist, step, rule)
            states.append(np.concatenate([pose, inner]))
        x, y, heading, *rest = np.array(states).T
        ahead, left, turned = nuisances
        across = np.cos(heading), np.sin(heading)
        read = [
            x + ahead * across[0] - left * across[1],
            y + ahead * across[1] + left * across[0],
            heading + turned,
            *rest,
        ]
        found.append(np.column_stack(read))
    return np.array(found)


class TestReadings:
    @pytest.mark.parametrize(
        ("robot", "rule"),
        list(zip(ROBOTS, cycle(["arc", "midpoint"]), strict=False)),
        ids=lambda one: one if isinstance(one, str) else one.name,
    )
    def test_are_those_of_plain_steps(self, robot: Example, rule: str):
        arguments = drawn(robot)
        found = readings_of(robot, rule=rule)(Driven(**arguments))
        assert found == pytest.approx(plain(robot, rule, **arguments), abs=1e-9)

    def test_any_quantities_in_any_order(self):
        robot = ROBOTS[0]
        arguments = drawn(robot)
        every = readings_of(robot)(Driven(**arguments))
        found = readings_of(robot, ("heading", "x"))(Driven(**arguments))
        assert np.array_equal(found, every[..., [2, 0]])

    # Each number of states and of inputs: what is added knows nothing else of a robot.
    @pytest.mark.parametrize(
        "robot", cases({(len(one.model.states), len(one.model.inputs)): one for one in ROBOTS}.values())
    )
    def test_padding_changes_nothing(self, robot: Example):
        arguments = drawn(robot)
        more = {
            **arguments,
            "inputs": np.pad(arguments["inputs"], ((0, 0), (0, 3), (0, 0)), constant_values=5.0),
            "times": np.pad(arguments["times"], ((0, 0), (0, 3))),
        }
        short, slopes = readings_of(robot).derivatives(Driven(**arguments))
        padded, padded_slopes = readings_of(robot, periods=PERIODS + 3).derivatives(Driven(**more))
        assert np.allclose(padded[:, : PERIODS + 1], short, rtol=0, atol=1e-14)
        assert np.allclose(padded_slopes[:, : PERIODS + 1], slopes, rtol=0, atol=1e-12)
        # What is beyond the end is the end.
        assert np.allclose(padded[:, PERIODS:], short[:, -1:], rtol=0, atol=1e-14)
        assert np.allclose(padded_slopes[:, PERIODS:], slopes[:, -1:], rtol=0, atol=1e-12)

    def test_a_single_segment_of_a_single_period(self):
        robot = ROBOTS[0]
        arguments = drawn(robot)
        one = {
            name: values[:1] if name in ("starts", "inputs", "times") else values
            for name, values in arguments.items()
        }
        one |= {"inputs": one["inputs"][:, :1], "times": one["times"][:, :1]}
        found = SegmentReadings.logged(robot.model, XYH, 1, 1)(Driven(**one))
        assert found.shape == (1, 2, 3)
        assert found[0] == pytest.approx(readings_of(robot)(Driven(**arguments))[0, :2], abs=1e-14)

    @given(turn=st.floats(-3, 3), x=st.floats(-5, 5), y=st.floats(-5, 5))
    def test_turn_and_shift_with_their_starts(self, turn: float, x: float, y: float):
        robot = ROBOTS[0]
        arguments = drawn(robot)
        places = (arguments["starts"][:, 0] + 1j * arguments["starts"][:, 1]) * np.exp(1j * turn) + x + 1j * y
        moved = np.column_stack([places.real, places.imag, arguments["starts"][:, 2] + turn])
        before, after = (
            readings_of(robot)(Driven(**{**arguments, "starts": s})) for s in (arguments["starts"], moved)
        )
        wanted = (before[..., 0] + 1j * before[..., 1]) * np.exp(1j * turn) + x + 1j * y
        assert after[..., 0] + 1j * after[..., 1] == pytest.approx(wanted, abs=1e-9)
        assert after[..., 2] == pytest.approx(before[..., 2] + turn, abs=1e-9)


class TestDerivatives:
    @every_robot
    def test_are_difference_quotients(self, robot: Example):
        arguments, readings = drawn(robot, 1), readings_of(robot)
        found, slopes = readings.derivatives(Driven(**arguments))
        assert np.array_equal(found, readings(Driven(**arguments)))
        size, states = len(robot.model.nominal), len(robot.model.states)

        def shifted(point: np.ndarray) -> np.ndarray:
            return readings(
                Driven(
                    **{
                        **arguments,
                        "parameters": arguments["parameters"] + point[:size],
                        # Every start moves by the same: rows of other segments do not depend on it.
                        "starts": arguments["starts"] + point[size : size + states],
                        "nuisances": arguments["nuisances"] + point[size + states :],
                    }
                )
            )

        wanted = oracle.central_difference(shifted, np.zeros(size + states + 3), 1e-5)
        scale = np.abs(slopes).max()
        assert slopes.reshape(wanted.shape) / scale == pytest.approx(wanted / scale, abs=1e-6)

    def test_a_start_is_its_own_segments_business(self):
        robot = ROBOTS[0]
        arguments, readings = drawn(robot), readings_of(robot)
        other = {**arguments, "starts": arguments["starts"] + np.array([[0.0], [0.1], [0.0]])}
        changed = readings(Driven(**other)) != readings(Driven(**arguments))
        assert changed[1].any()
        assert not changed[[0, 2]].any()


SENSORS = (
    Ranges(beacons=((4.0, 3.0), (-3.5, 2.5)), noise=3e-3, every=2, lever_arm=LeverArm(x=0.1, known=False)),
    YawRate(noise=0.02),
    YawRate(noise=0.02, every=4, bias="known"),
    Poses(quantities=("heading", "x"), noise={"position": 1e-3, "position_per_speed": 0.02, "heading": 0.01}),
)


class TestAnySensor:
    """A segment is a drive: what a sensor reads of it is what a design counts on."""

    @pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: f"{sensor.kind} {sensor.every}")
    @pytest.mark.parametrize("robot", [ROBOTS[0], ROBOTS[-1]], ids=lambda robot: robot.name)
    def test_reads_what_it_reads_of_a_drive(self, robot: Example, sensor: Sensor):
        arguments = drawn(robot)
        arguments["times"][:] = 0.1
        arguments["nuisances"] = np.array([one.nominal for one in sensor.nuisances])
        segments = SegmentReadings(robot.model, sensor, COUNT, PERIODS)
        found, slopes = segments.derivatives(Driven(**arguments))
        assert np.array_equal(segments(Driven(**arguments)), found)
        white = segments.whitening(Driven(**arguments))
        for index in range(COUNT):
            drive = roll_out(
                robot.model,
                inputs=ca.DM(arguments["inputs"][index]),
                start=ca.DM(arguments["starts"][index]),
                parameters=ca.DM(arguments["parameters"]),
                period=ca.DM(0.1),
            )
            response, jacobian = readings(sensor, drive)
            own_rows = slice(index * found[index].size, (index + 1) * found[index].size)
            weights = white[own_rows, own_rows].toarray()
            own = slopes[index].reshape(found[index].size, -1)
            np.testing.assert_allclose(weights @ found[index].ravel(), np.array(response).ravel(), rtol=1e-10)
            np.testing.assert_allclose(weights @ own, jacobian, rtol=1e-10, atol=1e-8)

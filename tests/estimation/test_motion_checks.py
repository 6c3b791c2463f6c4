"""Clocks apart, and columns that are not what they are taken for."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sample_robots import PLANAR, ROBOTS, Example, cases
from simulated import (
    ROBOT,
    TRUTH,
    course,
    exchanged,
    heading_times,
    log_of,
    logged_problem,
    negated,
    options,
    rich_inputs,
    truth_of,
)

from oed.estimation import calibrate
from oed.estimation.preprocessing.moves import Moves, clock_offsets, unexplained
from oed.estimation.preprocessing.outliers import without_outliers
from oed.estimation.preprocessing.preprocess import preprocess
from oed.estimation.preprocessing.wiring_checks import (
    MIRRORED_FRAME,
    poorly_explained,
    unit_fault,
    wiring_fault,
)
from oed.foundation.errors import LogError
from oed.logs.findings import IN_DEGREES
from oed.logs.log import Finding, Log
from oed.robots.models import Mecanum, Model, SkidSteer

NOISE = (0.003, 0.005)
DRIVE = course(seconds=20.0, period=0.05)
LOG = log_of(DRIVE, noise=NOISE)
SWAPPED = "wheel_speed_right and wheel_speed_left are exchanged"


def moves_of(*logs: Log, model=ROBOT) -> Moves:
    return Moves.of(model, logs)


def suspected(log: Log, model=ROBOT) -> str | None:
    return wiring_fault(moves_of(log, model=model))


def doubted(log: Log, model=ROBOT) -> float | None:
    return poorly_explained(moves_of(log, model=model))


class TestClocks:
    @pytest.mark.parametrize("offset", [-0.97, -0.31, 0.0, 0.12, 0.84])
    def test_are_found_to_a_hundredth(self, offset: float):
        log = log_of(course(ROBOT, np.array(ROBOT.nominal), period=0.05), noise=NOISE, offset=offset)
        assert clock_offsets(moves_of(log)) == pytest.approx([offset], abs=0.0101)

    @pytest.mark.parametrize("offset", [-0.31, 0.84])
    def test_are_nearly_found_where_wheels_are_of_another_size(self, offset: float):
        log = log_of(DRIVE, noise=NOISE, offset=offset)
        assert clock_offsets(moves_of(log)) == pytest.approx([offset], abs=0.08)

    @pytest.mark.parametrize("quantities", [("heading",), ("x", "y")])
    def test_of_some_quantities_alone(self, quantities):
        log = log_of(DRIVE, noise=NOISE, offset=0.4, quantities=quantities)
        assert clock_offsets(moves_of(log)) == pytest.approx([0.4], abs=0.08)

    def test_of_each_file(self):
        logs = [
            log_of(course(seconds=20.0, seed=seed), noise=NOISE, offset=offset, name=str(seed))
            for seed, offset in enumerate((0.5, -0.25))
        ]
        assert clock_offsets(moves_of(*logs)) == pytest.approx([0.5, -0.25], abs=0.08)

    @pytest.mark.parametrize("noise", [NOISE, (0.0, 0.0)])
    def test_are_left_alone_where_motion_is_steady(self, noise):
        for speeds in ((4.0, 4.0), (4.0, 2.0), (0.0, 0.0)):
            log = log_of(course(inputs=np.tile(speeds, (200, 1))), noise=noise)
            assert clock_offsets(moves_of(log)) == pytest.approx([0.0]), speeds

    def test_are_not_guessed_from_a_few_moves(self):
        log = log_of(DRIVE, rows=np.array([0, 200, 400]))
        assert clock_offsets(moves_of(log)) == pytest.approx([0.0])

    @pytest.mark.slow
    def test_the_fit_refines_them_and_says_so(self):
        log = log_of(course(seconds=8.0), noise=NOISE, offset=0.534)
        found = calibrate(logged_problem(), [log], options(segment="log", sensor_place=()))
        assert found.fit.clock_offsets == pytest.approx([0.534], abs=0.004)
        assert [one.name for one in found.logs[0].findings] == ["clock_offset"]
        asked = options(segment="log", sensor_place=(), clock_offset=False)
        kept = calibrate(logged_problem(), [log], asked)
        assert kept.fit.clock_offsets == pytest.approx([0.0])
        assert "clock_offset" not in kept.fit.unknowns.names


@pytest.mark.parametrize(("quantities", "goes"), [(("heading",), False), (("x", "y"), True)])
def test_headings_alone_show_no_distance(quantities, goes):
    assert moves_of(log_of(DRIVE, noise=NOISE, quantities=quantities)).goes_places == goes


class TestUnexplained:
    MEASURED = moves_of(LOG).measured()

    def predicted(self, factor: complex = 1.0) -> dict[str, np.ndarray]:
        moved = factor * (self.MEASURED["forward"] + 1j * self.MEASURED["left"])
        turn = abs(factor) * self.MEASURED["turn"]
        return {"forward": moved.real, "left": moved.imag, "turn": turn}

    @pytest.mark.parametrize("factor", [0.5, 1.0, 2.5, np.exp(0.8j)])
    def test_nothing_but_for_a_factor_and_how_the_sensor_is_turned(self, factor):
        left = unexplained(self.MEASURED, self.predicted(factor))
        assert left["turn"] == pytest.approx(0, abs=1e-12)
        assert left["distance"] == pytest.approx(0, abs=1e-12)

    def test_everything_where_wheels_stand_still(self):
        still = {name: 0 * values for name, values in self.MEASURED.items()}
        left = unexplained(self.MEASURED, still)
        assert left["turn"] == 1
        assert left["distance"] <= 1

    @pytest.mark.parametrize("factor", [-1.0, 10.0, 0.05])
    def test_more_than_bad_where_the_factor_is_not_to_be_believed(self, factor):
        assert max(unexplained(self.MEASURED, self.predicted(factor)).values()) > 0.3

    def test_a_robot_at_rest_has_nothing_to_explain(self):
        still = {name: 0 * values for name, values in self.MEASURED.items()}
        assert unexplained(still, self.MEASURED) == {}


class TestNamed:
    @pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.15, -0.1, 0.4)])
    def test_each_mistake(self, place):
        own = log_of(DRIVE, noise=NOISE, place=place)
        for log, text in (
            (exchanged(LOG), SWAPPED),
            (negated(LOG, 0), "wheel_speed_right has the wrong sign"),
            (negated(LOG, 1), "wheel_speed_left has the wrong sign"),
            (negated(LOG, 0, 1), "all inputs have the wrong sign"),
            (heading_times(LOG, -1.0), "the heading has the wrong sign"),
            (heading_times(LOG, 180 / math.pi), "the heading is in degrees"),
            (heading_times(LOG, math.pi / 180), "the heading is in radians"),
        ):
            moved = replace(log, poses=own.poses * (log.poses / LOG.poses))
            assert text in (suspected(moved) or "")

    def test_wheels_exchanged_where_only_headings_are_read(self):
        log = log_of(DRIVE, noise=NOISE, quantities=("heading",))
        text = suspected(exchanged(log)) or ""
        assert SWAPPED in text
        assert "the heading has the wrong sign" in text

    @pytest.mark.parametrize(
        ("axes", "zero", "wrong", "text"),
        [
            ([[0, 1], [1, 0]], math.pi / 2, exchanged, SWAPPED),
            ([[1, 0], [0, -1]], 0.0, exchanged, SWAPPED),
            ([[-1, 0], [0, 1]], 0.0, lambda log: negated(log, 0, 1), "all inputs have the wrong sign"),
        ],
        ids=["x north, y east", "y to the right", "x backwards"],
    )
    def test_a_mirrored_frame_and_wheels_that_explain_it_alike_are_both_named_whichever_is_true(
        self, axes, zero: float, wrong, text: str
    ):
        poses = np.column_stack([LOG.poses[:, :2] @ np.array(axes), zero - LOG.poses[:, 2]])
        for log in (replace(LOG, poses=poses), wrong(LOG)):
            fault = suspected(log) or ""
            assert text in fault
            assert MIRRORED_FRAME in fault
            assert fault.count("; or ") == 1

    @pytest.mark.parametrize("robot", cases(PLANAR))
    def test_inputs_of_any_robot_of_the_wrong_sign(self, robot: Example):
        log = log_of(course(robot.model, np.array(robot.model.nominal)), noise=NOISE)
        driving = [place for place, entry in enumerate(robot.model.inputs) if entry.drives]
        text = suspected(negated(log, *driving), robot.model)
        assert "wrong sign" in (text or "")

    @pytest.mark.slow
    def test_two_of_four_wheels_of_the_wrong_sign(self):
        robot = Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.35)
        log = log_of(course(robot, np.array(robot.nominal)), noise=NOISE)
        names = " and ".join(robot.input_names[place] for place in (1, 3))
        assert f"{names} have the wrong sign" in (suspected(negated(log, 1, 3), robot) or "")

    UNITS = (
        (30 / math.pi, 1.0, 1.0, "times those of the wheels, as if the wheels' speeds were in rpm;"),
        (180 / math.pi, 1.0, 1.0, "times those of the wheels, as if the wheels' speeds were in deg/s;"),
        (1e3, 1e3, 1.0, "times those of the wheels, as if the times were in ms"),
        (1.0, 1.0, 1e3, "positions were in mm; give x and y unit: mm"),
        (1.0, 1.0, 1e2, "positions were in cm"),
        (1.0, 1.0, 1e-2, "positions were in m, not in cm; give x and y unit: m"),
        (1.0, 1.0, 1e-3, "positions were in m, not in mm; give x and y unit: m"),
        (math.pi / 30, 1.0, 1.0, "the wheels' speeds were in rad/s, not in rpm; give them unit: rad/s"),
        (math.pi / 180, 1.0, 1.0, "the wheels' speeds were in rad/s, not in deg/s"),
    )
    """What inputs, times and positions are multiplied by, and what is said of it."""

    @pytest.mark.parametrize("quantities", [("x", "y", "heading"), ("x", "y"), ("heading",)])
    def test_units(self, quantities):
        log = log_of(DRIVE, noise=NOISE, quantities=quantities)
        for turning, lasting, length, text in self.UNITS:
            factors = [1.0 if name == "heading" else length for name in quantities]
            moved = replace(
                log,
                integrals=turning * log.integrals,
                input_times=lasting * log.input_times,
                pose_times=lasting * log.pose_times,
                poses=log.poses * factors,
            )
            found = unit_fault(moves_of(moved)) or ""
            if "x" in quantities:
                assert text in found
            elif length == 1.0:
                assert found.startswith(text.rpartition("as if ")[2]), text
            else:
                assert found == "", text

    @pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.15, -0.1, 0.4)])
    def test_mirrored_positions(self, place):
        log, text = log_of(DRIVE, noise=NOISE, place=place), "positions are mirrored: are x and y exchanged, "
        for axes in ([[0, 1], [1, 0]], [[-1, 0], [0, 1]], [[1, 0], [0, -1]]):
            mirrored = np.column_stack([log.poses[:, :2] @ np.array(axes), log.poses[:, 2]])
            found = suspected(replace(log, poses=mirrored)) or ""
            assert found.startswith(f"{text}or has one of them the wrong"), axes

    @pytest.mark.parametrize(
        ("wrong", "text", "seed"),
        [
            (lambda log: negated(log, 0, 1), "all inputs have the wrong sign", 0),
            (lambda log: heading_times(log, -1.0), "the heading has the wrong sign", 1),
            (exchanged, SWAPPED, 2),
            (exchanged, SWAPPED, 0),
        ],
    )
    def test_though_clocks_are_taken_to_be_apart(self, wrong, text: str, seed: int):
        times = np.arange(200) / 10
        speeds = [
            3 + 4 * np.sin(0.7 * times + seed) + 2 * np.cos(1.7 * times),
            3 - 4 * np.cos(0.5 * times + seed) + 2 * np.sin(1.3 * times),
        ]
        log = wrong(log_of(course(ROBOT, inputs=np.column_stack(speeds), seconds=20.0), noise=NOISE))
        with pytest.raises(LogError, match=text):
            calibrate(logged_problem(), [log])

    @pytest.mark.slow
    def test_headings_in_degrees_that_were_unwrapped_as_radians(self):
        found = replace(LOG, findings=(Finding(IN_DEGREES, "say `unit: deg`"),))
        random = np.random.default_rng(0).normal(size=len(LOG.poses)).cumsum()
        poses = np.column_stack([LOG.poses[:, :2], random])
        with pytest.raises(LogError, match=r"next to nothing of .* units right\?; say `unit: deg`"):
            calibrate(logged_problem(), [replace(found, poses=poses)])

    def test_is_refused_with_the_files_name(self):
        with pytest.raises(LogError, match=rf"drive\.csv: {SWAPPED}.* instead of all of it"):
            calibrate(logged_problem(), [exchanged(LOG)])


def test_of_a_fault_it_is_said_how_much_motion_it_leaves_unexplained():
    text = suspected(negated(LOG, 0)) or ""
    assert re.search(r"leaves 0 % of the motion unexplained instead of [1-9]\d %$", text)


def mirrored(log: Log) -> Log:
    return replace(log, poses=log.poses * [1.0, -1.0])


class TestPositionsAlone:
    """They show to which side a robot turns, by their bends."""

    SKID = SkidSteer(wheel_radius=0.05, track=0.2)
    LOGS = (
        (ROBOT, log_of(DRIVE, noise=NOISE, quantities=("x", "y"))),
        # A robot that skids, and turns half as much as its geometry says.
        (
            SKID,
            log_of(
                course(SKID, truth_of(SKID, track=0.42), period=0.05, seed=1),
                noise=NOISE,
                quantities=("x", "y"),
            ),
        ),
    )
    MIRROR_IMAGES = (SWAPPED, "all inputs have the wrong sign", "positions are mirrored")

    @pytest.mark.parametrize(("model", "log"), LOGS, ids=("differential", "skid steer"))
    @pytest.mark.parametrize("wrong", [exchanged, lambda log: negated(log, 0, 1), mirrored])
    def test_a_path_in_a_mirror_has_three_causes_that_are_all_named(self, model, log: Log, wrong):
        text = suspected(wrong(log), model) or ""
        assert all(one in text for one in self.MIRROR_IMAGES)
        assert "of the path's bends unexplained" in text

    @pytest.mark.slow
    @pytest.mark.parametrize(("model", "log"), LOGS, ids=("differential", "skid steer"))
    @pytest.mark.parametrize(("place", "side"), [(0, "right"), (1, "left")])
    def test_which_of_two_signs_is_wrong(self, model, log: Log, place: int, side: str):
        assert (suspected(negated(log, place), model) or "").startswith(
            f"wheel_speed_{side} has the wrong sign; give it sign: -1: that leaves"
        )

    @pytest.mark.parametrize(("model", "log"), LOGS, ids=("differential", "skid steer"))
    def test_true_ones(self, model, log: Log):
        assert suspected(log, model) is None

    @pytest.mark.slow
    def test_are_refused_with_the_files_name(self):
        (_, log), _ = self.LOGS
        with pytest.raises(LogError, match=rf"drive\.csv: {SWAPPED}.*bends unexplained instead of all"):
            calibrate(logged_problem(), [exchanged(log)], options(segment=2.0))

    @pytest.mark.parametrize("noise", [0.03, 0.3])
    def test_noise_is_no_bend(self, noise: float):
        for seed in range(3):
            assert suspected(log_of(DRIVE, noise=(noise, 0.0), quantities=("x", "y"), seed=seed)) is None

    def test_a_gentle_turn_by_wheels_of_other_sizes(self):
        # By nominal sizes it would be a turn to the other side.
        inputs = np.tile([3.6, 4.0], (200, 1)) * (1 + 0.1 * np.sin(np.arange(200) / 9))[:, None]
        drive = course(parameters=np.array([0.06, 0.05, 0.2]), inputs=inputs)
        log = log_of(drive, noise=(0.001, 0.0), quantities=("x", "y"))
        assert suspected(log) is None

    @pytest.mark.parametrize("robot", cases(PLANAR))
    def test_of_any_robot(self, robot: Example):
        drive = course(robot.model, np.array(robot.model.nominal))
        log = log_of(drive, noise=(0.001, 0.0), quantities=("x", "y"))
        assert suspected(log, robot.model) is None


class TestTrueLogs:
    @pytest.mark.parametrize("robot", cases(ROBOTS))
    def test_of_any_robot_with_a_sensor_anywhere(self, robot: Example):
        # Of which wheels explain less than of other drives: a limit near what they leave would be seen.
        drive = course(robot.model, np.array(robot.model.nominal), seconds=10.0, seed=1)
        for place in ((0.4, -0.2, 0.0), (0.1, 0.1, 1.2)):
            moves = moves_of(log_of(drive, noise=NOISE, place=place), model=robot.model)
            assert wiring_fault(moves) is None
            assert unit_fault(moves) is None
            assert poorly_explained(moves) is None

    def test_of_wheels_of_another_size(self):
        for right, left in ((1.2, 1.2), (0.8, 0.8), (1.2, 1.0), (1.0, 0.8)):
            own = truth_of(ROBOT, wheel_radius_right=0.05 * right, wheel_radius_left=0.05 * left)
            assert suspected(log_of(course(ROBOT, own), noise=NOISE)) is None, (right, left)

    def test_of_a_skid_steer_that_turns_half_as_much(self):
        model = SkidSteer(wheel_radius=0.05, track=0.2)
        log = log_of(course(model, truth_of(model, track=0.4)), noise=NOISE)
        assert suspected(log, model) is None
        assert doubted(log, model) is None

    def test_of_circles_in_one_direction(self):
        own = truth_of(ROBOT, wheel_radius_right=0.052)
        for speeds in ((4.0, 2.0), (2.0, 4.0), (3.0, -3.0)):
            inputs = speeds * (1 + 0.2 * np.sin(0.05 * np.arange(200)))[:, None]
            log = log_of(course(ROBOT, own, inputs=inputs), noise=NOISE)
            assert suspected(log) is None, speeds
            assert doubted(log) is None, speeds

    def test_of_straight_lines(self):
        for ratio in (1.0, 0.96):
            own = truth_of(ROBOT, wheel_radius_right=0.05 / ratio)
            log = log_of(course(ROBOT, own, inputs=np.tile([4.0 * ratio, 4.0], (200, 1))), noise=NOISE)
            assert suspected(log) is None, ratio
            assert doubted(log) is None, ratio

    @pytest.mark.parametrize("noise", [NOISE, (0.0, 0.0)])
    def test_of_a_robot_that_stands_still(self, noise):
        log = log_of(course(inputs=np.zeros((200, 2))), noise=noise)
        assert suspected(log) is None
        assert doubted(log) is None

    def test_of_encoders_with_few_ticks(self):
        assert suspected(log_of(DRIVE, noise=NOISE, quantum=0.1)) is None

    def test_wheels_that_have_nothing_to_do_with_the_poses_are_doubted(self):
        other = course(inputs=rich_inputs(ROBOT, DRIVE.times[:-1], seed=9), period=0.05)
        log = replace(LOG, integrals=log_of(other).integrals)
        assert (doubted(log) or 0) > 0.3


MECANUM = Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.35)
WAVES = np.sin(np.arange(400) / 15)[:, None]


def steadily(*speeds: float) -> np.ndarray:
    """Inputs (400, wheels) that keep their ratio."""
    return np.array([speeds]) * (1 + 0.3 * WAVES)


def as_driven(model: Model, inputs: np.ndarray, **keys: Any) -> Log:
    drive = course(model, np.array(model.nominal), inputs=inputs, seconds=20.0, period=0.05)
    return log_of(drive, **keys)


def with_outliers(log: Log, share: float, lasting: int = 1) -> Log:
    """The same with some poses off by about a metre and a radian, for as many poses each time."""
    rng = np.random.default_rng(7)
    begin = np.flatnonzero(rng.random(len(log.poses)) < share / lasting)
    poses = log.poses.copy()
    for row in begin:
        poses[row : row + lasting] += rng.normal(size=poses.shape[1])
    return replace(log, poses=poses)


class TestNoise:
    @pytest.mark.parametrize(
        ("model", "inputs"),
        [(ROBOT, steadily(2.0, 2.0)), (MECANUM, 4 * WAVES * [1, 1, 1, 1] + 3 * WAVES[::-1] * [-1, 1, 1, -1])],
        ids=["wheels", "mecanum"],
    )
    @pytest.mark.parametrize("noise", [(0.003, 0.02), (0.001, 0.2)])
    def test_headings_of_a_pure_translation_are_no_turns(self, model, inputs, noise):
        log = as_driven(model, inputs, noise=noise)
        assert preprocess(model, [log], compare_clocks=True).logs == (log,)

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("inputs", "sizes"),
        [
            (steadily(3.0, 3.0), [0.0, 0.0, 0.035]),
            (steadily(3.0, 3.0), [0.0, 0.0, 0.1]),
            (steadily(3.0, -3.0), [0.03, 0.03, 0.0]),
        ],
        ids=["2 deg", "6 deg", "3 cm"],
    )
    def test_nor_is_slow_noise_motion(self, inputs: np.ndarray, sizes: list[float]):
        log = as_driven(ROBOT, inputs, noise=NOISE)
        rng, kept, slow = np.random.default_rng(0), np.exp(-0.05 / 0.3), [np.zeros(3)]
        for shock in rng.normal(size=(len(log.poses) - 1, 3)):
            slow.append(kept * slow[-1] + np.sqrt(1 - kept**2) * shock)
        preprocess(ROBOT, [replace(log, poses=log.poses + slow * np.array(sizes))], compare_clocks=True)

    @pytest.mark.parametrize("noise", [0.01, 0.05])
    def test_positions_of_a_pure_rotation_are_no_ways(self, noise: float):
        log = as_driven(ROBOT, steadily(2.0, -2.0), noise=(noise, 0.005))
        assert preprocess(ROBOT, [log], compare_clocks=True).logs == (log,)

    @pytest.mark.parametrize("noise", [(0.003, 0.005), (0.05, 0.05)])
    @pytest.mark.parametrize("share", [0.5, 0.97])
    def test_of_a_robot_that_stands_most_of_the_time(self, noise, share: float):
        inputs = rich_inputs(ROBOT, np.arange(400) * 0.05)
        inputs[round(400 * (1 - share)) :] = 0
        log = as_driven(ROBOT, inputs, noise=noise)
        assert preprocess(ROBOT, [log], compare_clocks=True).logs == (log,)

    @pytest.mark.slow
    def test_turns_beyond_it_have_to_be_explained(self):
        # One column for both wheels: ways are explained, turns are not.
        log = log_of(DRIVE, noise=(0.005, 0.1))
        same = replace(log, integrals=log.integrals.mean(axis=1, keepdims=True) * [1.0, 1.0])
        with pytest.raises(LogError, match="next to nothing of the measured motion"):
            preprocess(ROBOT, [same], compare_clocks=True)

    def test_a_fault_is_found_in_it(self):
        assert SWAPPED in (suspected(exchanged(log_of(DRIVE, noise=(0.02, 0.1)))) or "")


class TestOutliers:
    @pytest.mark.parametrize("quantities", [("x", "y", "heading"), ("x", "y"), ("heading",)])
    def test_are_neither_doubt_nor_fault(self, quantities):
        plain = log_of(DRIVE, noise=NOISE, quantities=quantities)
        for share, lasting in ((0.026, 1), (0.1, 1), (0.05, 6)):
            log = with_outliers(plain, share, lasting)
            assert preprocess(ROBOT, [log], compare_clocks=True).logs == (log,), (share, lasting)

    @pytest.mark.parametrize(
        ("wrong", "text"),
        [
            (exchanged, SWAPPED),
            (lambda log: negated(log, 0), "wheel_speed_right has the wrong sign"),
            (lambda log: heading_times(log, -1.0), "the heading has the wrong sign"),
        ],
    )
    def test_hide_no_fault(self, wrong, text: str):
        assert text in (suspected(wrong(with_outliers(LOG, 0.026))) or "")

    @pytest.mark.parametrize("offset", [-0.31, 0.84])
    def test_hide_no_offset_of_the_clocks(self, offset: float):
        log = with_outliers(log_of(DRIVE, noise=NOISE, offset=offset), 0.026)
        assert clock_offsets(moves_of(log)) == pytest.approx([offset], abs=0.08)

    @pytest.mark.slow
    def test_a_robust_loss_estimates_as_if_there_were_none(self):
        asked = options(loss="huber", segment="log", sensor_place=(), clock_offset=False)
        log = with_outliers(log_of(DRIVE, noise=NOISE, every=4), 0.05)
        assert np.abs(log.poses - log_of(DRIVE, every=4).poses).max() > 0.5
        found = calibrate(logged_problem(), [log], asked)
        errors = np.abs(found.values - [*TRUTH.values()]) / found.covariances[0].deviations[:3]
        assert errors.max() < 4

    def test_poses_that_jump_and_no_others_are_left_out(self):
        jumping = [50, 120, 121]
        poses = LOG.poses.copy()
        poses[jumping, :2] += 3.0
        found = without_outliers(replace(LOG, poses=poses))
        np.testing.assert_array_equal(found.pose_times, np.delete(LOG.pose_times, jumping))
        np.testing.assert_array_equal(found.poses, np.delete(LOG.poses, jumping, axis=0))

    def test_poses_that_jump_all_the_time_are_the_drive(self):
        log = as_driven(ROBOT, rich_inputs(ROBOT, np.arange(400) * 0.05), every=40)
        assert without_outliers(log) is log

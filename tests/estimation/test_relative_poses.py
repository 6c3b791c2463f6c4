"""Relative poses of a lidar that is matched from scan to scan: wheels and mounting, as Censi's Kheperas have
them, from logs of known truth.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import input_limits, problem_of
from pulls import fewest_held, require_pulls
from scan_matching import LOG, MOUNTED, NOISE, NOMINAL, TRUTH, Matched, matched, seen

from oed.estimation import Calibration, CalibrationOptions, calibrate
from oed.estimation.assessment.covariance import Covariance
from oed.estimation.prediction.layout import without_turns
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.prediction.motion_layout import motion_parts, motion_segments, with_usual_motions
from oed.estimation.preprocessing.motion_checks import motion_fault, without_strays
from oed.estimation.preprocessing.motion_comparison import STRAY, MotionComparison, Off, _left
from oed.estimation.preprocessing.moves import Moves
from oed.estimation.setup.unknowns import PLACE, Unknowns
from oed.foundation.errors import LogError, ProblemError
from oed.kernel.criteria import D, E
from oed.kernel.measurement.prior import Prior
from oed.logs import CsvForm, Log, TupleForm, read_logs
from oed.logs.motions import Motions
from oed.records.calibration_outcome import estimate_of
from oed.robots.models import SkidSteerSlip
from oed.robots.sensors import RelativePoses

PROBLEM = problem_of(
    model=NOMINAL,
    limits=input_limits,
    criterion=E(),
    measurement=RelativePoses(noise={"position": NOISE[0], "heading": NOISE[1]}),
)
TRUE = [*TRUTH.values(), *MOUNTED]


def logs_of(folder: Path, *drives: Matched, **more: Any) -> list[Log]:
    keys = LOG | {"relative_poses": LOG["relative_poses"] | more}
    files = [drive.write(folder, f"drive{number}")[0] for number, drive in enumerate(drives)]
    return read_logs(files, CsvForm(**keys), NOMINAL)


def estimated(logs: list[Log], problem: Any = PROBLEM, **options: Any) -> Calibration:
    return calibrate(problem, logs, CalibrationOptions(**{"replicates": 100, **options}))


def information(found: Calibration) -> Covariance:
    (plain,) = (one for one in found.covariances if one.name == "information")
    return plain


def errors(found: Calibration) -> np.ndarray:
    """Of parameters and mounting, in standard errors of F^-1."""
    return (found.fit.values[:6] - TRUE) / information(found).deviations[:6]


def exact(errors: np.ndarray) -> np.ndarray:
    return 0 * errors


class TestEstimates:
    @pytest.mark.slow
    def test_exact_motions_give_wheels_mounting_and_clock(self, tmp_path: Path):
        found = estimated(logs_of(tmp_path, matched(noise=exact, offset=0.13, seconds=30)))
        np.testing.assert_allclose(found.fit.values[:6], TRUE, rtol=1e-5)
        np.testing.assert_allclose(found.fit.clock_offsets, 0.13, atol=1e-5)
        assert found.fit.unknowns.place == ("sensor_x", "sensor_y", "sensor_heading")
        assert any("the path that the relative poses make up" in note for note in found.notes)

    @pytest.mark.slow
    def test_drift_shows_in_none_and_too_few_come_with_a_warning(self, tmp_path: Path):
        logs = logs_of(tmp_path, matched(seconds=60))
        with pytest.raises(ProblemError, match=r"calibration\.covariance: .*relative_poses"):
            estimated(logs, covariance="drift")
        found = estimated(logs, block=60.0, clock_offset=False)
        assert [one.name for one in found.covariances] == ["information"]
        assert any("true errors are several times as large" in one.message for one in found.doubts)

    @pytest.mark.slow
    def test_a_mounting_that_is_known_is_not_estimated(self, tmp_path: Path):
        mounting = dict(zip(("x", "y", "heading"), MOUNTED, strict=True))
        sensor = RelativePoses(mounting={**mounting, "known": True})
        sensor = sensor.model_copy(update={"noise": PROBLEM.sensors[0].noise})
        problem = problem_of(model=NOMINAL, limits=input_limits, criterion=E(), measurement=sensor)
        found = estimated(logs_of(tmp_path, matched(noise=exact, seconds=30)), problem, clock_offset=False)
        assert found.fit.unknowns.place == ()
        np.testing.assert_allclose(found.fit.values[:3], TRUE[:3], rtol=1e-5)

    @pytest.mark.slow
    def test_a_search_begins_from_a_mounting_that_the_study_has_right(self, tmp_path: Path):
        sensor = RelativePoses(noise=PROBLEM.sensors[0].noise, mounting={"heading": MOUNTED[2]})
        problem = problem_of(model=NOMINAL, limits=input_limits, criterion=E(), measurement=sensor)
        found = estimated(logs_of(tmp_path, matched(noise=exact, seconds=30)), problem, clock_offset=False)
        assert found.fit.unknowns.sits[2] == MOUNTED[2]
        np.testing.assert_allclose(found.fit.values, TRUE, rtol=1e-5)

    @pytest.mark.slow
    def test_a_prior_of_the_mounting_counts(self, tmp_path: Path):
        logs = logs_of(tmp_path, matched(seconds=60))
        asked = partial(problem_of, model=NOMINAL, limits=input_limits, criterion=D())
        sensor = RelativePoses(noise=PROBLEM.sensors[0].noise, mounting={"x": -0.003, "y": 0.02})
        names = (*TRUTH, "sensor_y")
        free = estimated(logs, asked(measurement=sensor, estimate=names), clock_offset=False)
        assert free.parameters == tuple(TRUTH)
        assert free.fit.values[4] == pytest.approx(MOUNTED[1], abs=2e-3)
        prior = Prior(standard_deviations={"sensor_y": 1e-6})
        known = estimated(logs, asked(measurement=sensor, estimate=names, prior=prior), clock_offset=False)
        assert known.fit.values[4] == pytest.approx(0.02, abs=1e-5)

    @pytest.mark.slow
    def test_motions_may_overlap_and_be_missing(self, tmp_path: Path):
        drive = matched(noise=exact, seconds=60)
        # Every motion across two scans as well, and a hole.
        both = np.column_stack([drive.spans[:-1, 0], drive.spans[1:, 1]])
        turned = np.exp(1j * drive.motions[:-1, 2])
        moves = drive.motions[:, 0] + 1j * drive.motions[:, 1]
        far = moves[:-1] + turned * moves[1:]
        longer = np.column_stack([far.real, far.imag, drive.motions[:-1, 2] + drive.motions[1:, 2]])
        kept = np.r_[0:20, 30:74]
        spans, motions = np.vstack([drive.spans[kept], both]), np.vstack([drive.motions[kept], longer])
        (log,) = logs_of(tmp_path, replace(drive, spans=spans, motions=motions))
        assert log.motions is not None
        assert len(log.motions) == len(spans)
        assert np.all(np.diff(log.pose_times) > 0)
        found = estimated([log], clock_offset=False)
        np.testing.assert_allclose(found.fit.values, TRUE, rtol=1e-5)

    @pytest.mark.parametrize("apart", [(8, 200), (40, 40), (8, 8, 8, 400)], ids=str)
    def test_motions_of_any_length_are_driven_as_finely_as_wheels_are_read(
        self, tmp_path: Path, apart: tuple[int, ...]
    ):
        drives = [matched(noise=exact, seconds=60, every=every, held=5) for every in apart]
        spans, motions = (np.vstack([getattr(one, name) for one in drives]) for name in ("spans", "motions"))
        (log,) = logs_of(tmp_path, replace(drives[0], spans=spans, motions=motions))
        layout = motion_segments([log], [0.0])
        readings = LoggedReadings.of(layout, Unknowns(NOMINAL, tuple(TRUTH), PLACE, 0), np.zeros(1))
        predicted = readings(np.array(TRUE), np.zeros((layout.count, 0)))
        left = without_turns(predicted - layout.readings, readings.wrapping)
        assert np.abs(layout.readings[:, -1, 2]).max() <= np.pi
        np.testing.assert_allclose(left[:, -1], 0, atol=1e-7)

    @pytest.mark.parametrize(("longest", "left_out"), [(4.0, 0), (4.5, 1)])
    def test_a_search_begins_without_those_much_longer_than_the_usual_one(
        self, longest: float, left_out: int
    ):
        ends = np.arange(1.0, 21.0)
        times = np.column_stack([ends - np.r_[np.ones(19), longest], ends])
        log = Log("drive", "drive", ends, np.zeros((20, 2)), ends, np.zeros((20, 3)))
        log = replace(log, motions=Motions(times, np.zeros((20, 3))))
        found = with_usual_motions([log])
        # Where all are usual there is nothing to begin with instead.
        assert [len(one.motions) for one in found] == ([20 - left_out] if left_out else [])

    @pytest.mark.slow
    def test_a_long_motion_leads_no_search_astray(self, tmp_path: Path):
        truth = {**TRUTH, "wheel_radius_right": 0.0214}
        short, long = (matched(noise=exact, seconds=610, every=every, truth=truth) for every in (8, 6000))
        spans, motions = (
            np.vstack([getattr(one, name) for one in (short, long)]) for name in ("spans", "motions")
        )
        (log,) = logs_of(tmp_path, replace(short, spans=spans, motions=motions))
        found = estimated([log], clock_offset=False, block=60.0)
        np.testing.assert_allclose(found.values, [*truth.values()], rtol=1e-5)

    def test_motions_are_driven_in_bounded_numbers_of_parts(self):
        assert set(motion_parts(np.full(1000, 0.4), 0.001).tolist()) == {20}
        assert motion_parts(np.full(100_000, 2.0), 0.01).sum() <= 2.1e6
        assert motion_parts(np.array([0.39, 0.4, 20.0, 1e5]), 0.02).tolist() == [20, 20, 1000, 10_000]

    @pytest.mark.slow
    @pytest.mark.parametrize("known", [False, True], ids=["estimated", "stated"])
    def test_covariances_weight_each_motion(self, tmp_path: Path, known: bool):
        rng = np.random.default_rng(5)
        sizes = rng.choice([0.3, 3.0], (200, 1)) * [NOISE[0], NOISE[0], NOISE[1]]
        root = np.linalg.cholesky(np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.6], [0.0, 0.6, 1.0]]))
        drive = matched(2, noise=lambda white: (white @ root.T) * sizes[: len(white)], seconds=70)
        each = np.einsum("si,ij,sj->sij", sizes, root @ root.T, sizes)[: len(drive.spans)]
        # What is given is four times too large: the factor is found, unless it is to be believed.
        given = each * (1.0 if known else 4.0)
        keys = {"xx": (0, 0), "xy": (0, 1), "xh": (0, 2), "yy": (1, 1), "yh": (1, 2), "hh": (2, 2)}
        columns = {name: given[:, row, column] for name, (row, column) in keys.items()}
        (file,) = drive.write(tmp_path, **columns)
        form = CsvForm(
            **LOG | {"relative_poses": LOG["relative_poses"] | {"covariance": {k: k for k in keys}}}
        )
        asked = {"noise": "specified" if known else "estimated", "clock_offset": False}
        found = estimated(read_logs([file], form, NOMINAL), **asked)
        assert np.abs(errors(found)).max() < 3.5
        assert found.fit.misfit == pytest.approx(1.0, abs=0.3)
        typical = np.sqrt(np.median(given[:, 0, 0]))
        assert found.fit.noises["position"].at_rest == pytest.approx(typical / (1 if known else 2), rel=0.15)
        # Those ten times as sure count a hundred times as much.
        blind = estimated(logs_of(tmp_path, drive), clock_offset=False)
        own, other = (one.covariances[-1].deviations[:6] for one in (found, blind))
        assert np.all(own < 0.7 * other)

    @pytest.mark.slow
    def test_a_robot_whose_yaw_rate_lags_has_it_estimated_for_each_motion(self, tmp_path: Path):
        robot = SkidSteerSlip(wheel_radius=0.02, track=0.09)
        problem = problem_of(
            model=robot,
            limits=input_limits,
            criterion=E(scaling="none"),
            measurement=PROBLEM.measurement,
            estimate=("wheel_radius_right", "wheel_radius_left", "track"),
        )
        found = estimated(logs_of(tmp_path, matched(noise=exact, seconds=30)), problem, clock_offset=False)
        assert found.fit.starts.shape[1] == len(robot.states) - 3

    @pytest.mark.slow
    def test_matches_without_wheels_are_counted(self, tmp_path: Path):
        drive = matched(noise=exact, seconds=60)
        gone = np.r_[0:200, 230:500]
        short = replace(drive, times=drive.times[gone], turned=drive.turned[gone])
        found = estimated(logs_of(tmp_path, short), clock_offset=False)
        (text,) = (one.message for one in found.logs[0].findings if one.name == "motions_left_out")
        # 4 across the gap from 19.9 to 23 s, and those after 49.9 s.
        assert text.startswith("18 of 75 relative poses are outside")
        np.testing.assert_allclose(found.fit.values, TRUE, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("offset", "track"), [(0.4, 0.05), (-0.8, TRUTH["track"])])
def test_an_offset_of_the_clocks_is_found_to_a_hundredth_whatever_the_sizes(
    tmp_path: Path, offset: float, track: float
):
    (log,) = logs_of(tmp_path, matched(seconds=60, offset=offset, truth={**TRUTH, "track": track}))
    assert MotionComparison.of(NOMINAL, [log], 0.0).offset() == pytest.approx(offset, abs=0.006)


def test_what_is_far_off_counts_alike_where_clocks_are_compared():
    best = Off.of(*NOISE[1] * np.random.default_rng(0).standard_normal((2, 50)))
    beyond, farther = best.by.copy(), best.by.copy()
    beyond[:, 0], farther[:, 0] = 1.1 * STRAY * best.sizes, 100 * STRAY * best.sizes
    assert _left(best._replace(by=farther), best) == _left(best._replace(by=beyond), best) > _left(best, best)


class TestBadMatches:
    @pytest.mark.slow
    @pytest.mark.parametrize(("bad", "name"), [(0.1, "stray_motions"), (0.38, "many_stray_motions")])
    def test_a_robust_loss_bounds_what_they_do(self, tmp_path: Path, bad: float, name: str):
        drive = matched(4, bad=bad, seconds=60)
        found = estimated(logs_of(tmp_path, drive), loss="cauchy")
        assert np.abs(errors(found)).max() < 3.5
        # Clocks that agree are not taken apart for them.
        assert np.abs(found.fit.clock_offsets).max() < 0.01
        (text,) = (one.message for one in found.logs[0].findings if one.name == name)
        # Those that happen to be hardly wrong are not seen.
        count = int(text.split()[0])
        assert drive.wrong.sum() - 2 <= count <= drive.wrong.sum()
        outliers = {one.about: one for one in found.diagnostics if one.name == "outliers"}
        assert not outliers["position"].passed

    @pytest.mark.parametrize(("seed", "bad"), [(4, 0.8), (0, 0.6), (2, 0.95)])
    def test_where_most_go_wrong_no_reading_is_said_to_explain_them(
        self, tmp_path: Path, seed: int, bad: float
    ):
        drive, rng = matched(seed, seconds=40), np.random.default_rng(seed)
        astray = rng.normal(size=drive.motions.shape) * [0.3, 0.3, 1.0]
        wrong = rng.random(len(astray)) < bad
        (log,) = logs_of(tmp_path, replace(drive, motions=np.where(wrong[:, None], astray, drive.motions)))
        moves = Moves.of(NOMINAL, [without_strays(NOMINAL, log)])
        assert motion_fault(moves, [log]) is None

    @pytest.mark.slow
    @pytest.mark.parametrize(("loss", "said"), [("linear", True), ("cauchy", False)])
    def test_so_many_that_they_decide_a_plain_fit_are_its_first_doubt(
        self, tmp_path: Path, loss: str, said: bool
    ):
        logs = logs_of(tmp_path, matched(4, bad=0.38, seconds=60))
        doubts = estimated(logs, loss=loss, clock_offset=False, block=60.0).doubts
        assert (doubts[0].name == "stray_motions") == said

    @pytest.mark.slow
    def test_they_are_no_drift(self, tmp_path: Path):
        found = estimated(
            logs_of(tmp_path, matched(4, bad=0.05, seconds=60)), loss="cauchy", clock_offset=False
        )
        assert found.drift is None
        plain, chosen = (
            one.deviations[:3]
            for one in (next(w for w in found.covariances if w.name == "information"), found.covariances[0])
        )
        assert np.all(chosen < 3 * plain)
        texts = [one.message for one in found.diagnostics if one.name == "outliers" and not one.passed]
        assert texts
        assert all(text.endswith("outliers; the loss bounds what they do") for text in texts)

    @pytest.mark.slow
    def test_they_are_left_out_of_the_path(self, tmp_path: Path):
        drive = matched(4, noise=exact, bad=0.05, seconds=60)
        found = estimated(logs_of(tmp_path, drive), loss="cauchy", clock_offset=False)
        assert drive.wrong.any()
        assert found.own is not None
        assert found.own.after[0].rmse_position < 0.2 * found.own.before[0].rmse_position
        everything = logs_of(tmp_path, drive)[0]
        assert np.ptp(everything.poses - everything.poses[:1], axis=0).max() > 1


def corrected_on_a_grid(drive: Matched, step: float) -> Matched:
    """The same with headings from a matcher that corrects those of odometry by multiples of a step [rad]."""
    turned = np.array([np.interp(drive.spans, drive.times, wheel) for wheel in drive.turned.T])
    right, left = turned[..., 1] - turned[..., 0]
    odometry = NOMINAL.wheel_radius * (right - left) / NOMINAL.track
    motions = drive.motions.copy()
    motions[:, 2] = odometry + step * np.round((motions[:, 2] - odometry) / step)
    assert np.mean(motions[:, 2] == odometry) > 0.5
    return replace(drive, motions=motions)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_every_loss_has_like_error_bars_of_matches_on_a_grid_of_corrections(tmp_path: Path, seed: int):
    truth = {"wheel_radius_right": 0.0201, "wheel_radius_left": 0.02, "track": 0.0897}
    logs = logs_of(tmp_path, corrected_on_a_grid(matched(seed, truth=truth), 0.005))
    deviations = {}
    for loss in ("linear", "huber", "cauchy"):
        found = estimated(logs, loss=loss, clock_offset=False)
        assert not [finding for finding in found.logs[0].findings if "stray" in finding.name]
        assert not [doubt for doubt in found.doubts if doubt.name == "stray_motions"]
        # What headings show: how fast the robot turns by its wheels.
        right, _, track = found.values[:3]
        slopes = np.array([1 / track, 0, -right / track**2])
        deviations[loss] = np.sqrt(slopes @ found.covariance[:3, :3] @ slopes)
        error = right / track - truth["wheel_radius_right"] / truth["track"]
        assert abs(error) < 3 * deviations[loss]
    assert 0.5 < deviations["huber"] / deviations["linear"] < 2
    assert 0.5 < deviations["cauchy"] / deviations["linear"] < 2


@pytest.mark.slow
def test_other_robots_are_compared(tmp_path: Path):
    other = {"kind": "skid_steer", "wheel_radius": 0.02, "track": 0.09, "estimate": list(TRUTH)}
    logs = logs_of(tmp_path, matched(1, seconds=30), matched(2, seconds=30))
    found = estimated(logs, models=[other], clock_offset=False)
    assert found.comparison is not None
    own, alike = found.comparison.models
    # Without slip it is the same robot.
    assert not alike.reason
    assert own.fit is not None
    assert alike.fit is not None
    np.testing.assert_allclose(own.fit.values, alike.fit.values, rtol=1e-3)


@pytest.mark.slow
def test_the_page_says_what_was_fitted(tmp_path: Path):
    found = estimated(logs_of(tmp_path, matched(1, seconds=60)), clock_offset=False)
    outcome = estimate_of(found)
    assert outcome.segments is not None
    assert (outcome.segments.relative, outcome.segments.count) == (True, 75)
    assert outcome.logs[0].poses == 75


@pytest.mark.slow
def test_tuples_say_the_same(tmp_path: Path):
    drive = matched(4, seconds=60)
    rows, lengths = range(0, len(drive.times) - 1, 8), np.diff(drive.spans)[:, 0]
    speeds = (drive.turned[8::8] - drive.turned[:-1:8][: len(rows)]) / lengths[:, None]
    tuples = (
        {"T": length, "phi_r": right, "phi_l": left, "sm": motion}
        for length, (right, left), motion in zip(
            lengths, speeds.tolist(), drive.motions.tolist(), strict=True
        )
    )
    file = tmp_path / "drive.tuple"
    file.write_text("\n".join(map(json.dumps, tuples)), encoding="utf-8")
    found = estimated(read_logs([file], TupleForm(), NOMINAL), clock_offset=False)
    # Speeds that change within a tuple are not in it.
    assert np.abs(errors(found)).max() < 5


class TestRefused:
    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("options", "key", "words"),
        [
            ({"method": "gls"}, "method", "method: joint"),
            ({"method": "two_stage"}, "method", "method: joint"),
            ({"segment": 5.0}, "segment", "a segment of its own"),
            ({"segment": "log"}, "segment", "a segment of its own"),
        ],
    )
    def test_options_for_poses(self, tmp_path: Path, options: dict[str, Any], key: str, words: str):
        with pytest.raises(ProblemError, match=words) as error:
            estimated(logs_of(tmp_path, matched(seconds=40)), clock_offset=False, **options)
        assert error.value.issues[0].key == ("calibration", key)

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("wrong", "words"),
        [
            (lambda motions: backwards(motions), "inverse: true"),
            (lambda motions: motions * [1, 1, 180 / np.pi], "give it unit: deg"),
            (lambda motions: motions * [1, -1, 1], "mirrored"),
            (lambda motions: along_fixed_axes(motions), "along fixed axes"),
            (lambda motions: motions * [1000, 1000, 1], "unit: mm"),
            (lambda motions: motions * [1, 1, 0], "hardly move while the wheels drive"),
        ],
        ids=["backwards", "degrees", "mirrored", "fixed axes", "millimetres", "no turns"],
    )
    def test_motions_that_are_read_wrongly(self, tmp_path: Path, wrong: Any, words: str):
        drive = matched(3, every=24, seconds=100)
        with pytest.raises(LogError, match=words):
            estimated(logs_of(tmp_path, replace(drive, motions=wrong(drive.motions))), clock_offset=False)

    @pytest.mark.slow
    def test_exchanged_wheels(self, tmp_path: Path):
        drive = matched(3, seconds=60)
        with pytest.raises(LogError, match="exchange their columns"):
            estimated(logs_of(tmp_path, replace(drive, turned=drive.turned[:, ::-1])), clock_offset=False)

    @pytest.mark.slow
    def test_backwards_motions_are_read_when_the_study_says_so(self, tmp_path: Path):
        drive = matched(noise=exact, seconds=30)
        logs = logs_of(tmp_path, replace(drive, motions=backwards(drive.motions)), inverse=True)
        np.testing.assert_allclose(estimated(logs, clock_offset=False).fit.values, TRUE, rtol=1e-5)

    def test_poses_and_relative_poses_together(self, tmp_path: Path):
        (relative,) = logs_of(tmp_path, matched(seconds=60))
        with pytest.raises(LogError, match=r"holds x, y, heading, .* relative x, y, heading"):
            estimated([relative, replace(relative, name="other", file="other.csv", motions=None)])


def backwards(motions: np.ndarray) -> np.ndarray:
    """Where a sensor was, seen from where it came to."""
    at_first = np.zeros_like(motions)
    return seen(motions, at_first, (0.0, 0.0, 0.0))


def along_fixed_axes(motions: np.ndarray) -> np.ndarray:
    """Differences of the path that the motions make up."""
    headings = np.concatenate([[0.0], np.cumsum(motions[:-1, 2])])
    moved = (motions[:, 0] + 1j * motions[:, 1]) * np.exp(1j * headings)
    return np.column_stack([moved.real, moved.imag, motions[:, 2]])


@pytest.mark.slow
@pytest.mark.parametrize(("bad", "loss"), [(0.0, "linear"), (0.06, "cauchy")])
def test_intervals_cover_the_truth(tmp_path: Path, bad: float, loss: str):
    off, plain, held = [], [], []
    for seed in range(20):
        logs = logs_of(tmp_path, matched(seed, bad=bad, seconds=60))
        found = estimated(logs, loss=loss, clock_offset=False, noise="constant")
        off.append(found.fit.values - TRUE)
        held.append(np.abs(off[-1]) < found.covariances[0].half_width * found.covariances[0].deviations)
        plain.append(information(found).matrix)
    assert np.sum(held, axis=0).min() >= fewest_held(len(held))
    require_pulls(np.array(off), plain)

"""Other robots fitted to the same logs: which explains them best, and how sure that is."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from places import PROBLEMS
from scipy.stats import norm
from simulated import (
    ROBOT,
    TRUTH,
    XYH,
    course,
    fit_of,
    log_of,
    logged_problem,
    options,
    several,
    truth_of,
    unknowns_of,
)
from windowed import gls

from oed.cli.terminal.console import print_estimate
from oed.estimation import Alternative, Calibration, Comparison, DeadReckoning, HeldOut, calibrate
from oed.estimation.assessment.likelihood import FittedReadings, Likelihood, inflation
from oed.estimation.assessment.model_selection import SLIGHT, Compared, _why_not, scored
from oed.foundation.errors import PartError, ProblemError, StudyError
from oed.kernel.measurement.prior import Prior
from oed.records.calibration_outcome import estimate_of
from oed.records.record import load_estimate
from oed.report import page, write_estimate
from oed.robots.models import DifferentialDrive, Mecanum, SkidSteer, SkidSteerIcr, SkidSteerSlip
from oed.study.study import Study
from oed.workflow.estimate_logs import estimate
from oed.workflow.studies import parse_study

NOISE = (0.002, 0.005)
WIDE = SkidSteerSlip(wheel_radius=0.05, track=0.2, track_per_yaw_rate=0.01)
NARROW, WIDER = "differential_drive", "skid_steer_slip"
SLIP = Alternative(robot=WIDE)


@cache
def compared(growth: float, seed: int = 0, logs: int = 4, seconds: float = 5.0, **keys) -> Comparison:
    """A differential drive and one whose track grows with the yaw rate, where that is what it does."""
    true = truth_of(WIDE, **TRUTH, track_per_yaw_rate=growth)
    made = [
        log_of(
            course(WIDE, true, seconds=seconds, seed=10 * seed + k),
            noise=NOISE,
            seed=10 * seed + k,
            name=f"{k}",
        )
        for k in range(logs)
    ]
    chosen = options(**{"segment": "log", "noise": "constant", "models": (SLIP,), **keys})
    found = calibrate(logged_problem(), made, chosen).comparison
    assert found is not None
    return found


@pytest.mark.slow
class TestChoice:
    def test_the_wider_model_wins_where_it_is_true(self):
        found = compared(0.02)
        assert found.best == dict.fromkeys(("aicc", "bic", "held_out"), WIDER)
        assert found.agree
        assert found.favourites == (WIDER,)
        narrow = found.models[0]
        assert not any(score.equal for score in narrow.scores.values())
        assert narrow.scores["aicc"].interval[0] > SLIGHT
        values = dict(zip(found.models[1].parameters, found.models[1].fit.values, strict=False))
        assert values["track_per_yaw_rate"] == pytest.approx(0.02, rel=0.05)

    @pytest.mark.slow
    def test_the_narrower_one_is_preferred_where_it_is_true(self):
        few = {"logs": 3, "seconds": 2.0, "sensor_place": (), "clock_offset": False}
        each = [compared(0.0, seed, **few) for seed in range(4)]
        assert sum(one.best["bic"] == NARROW for one in each) >= 3
        assert sum(one.favourites[:1] == (NARROW,) for one in each) >= 3
        # A superfluous parameter costs 2 and earns a chi-square of one degree of freedom, four of which are 1
        # on average to 0.7.
        gains = [one.models[0].scores["aicc"].value - one.models[1].scores["aicc"].value for one in each]
        assert np.mean(gains) == pytest.approx(-1, abs=1.5)

    def test_a_single_log_has_no_intervals_and_predicts_nothing(self):
        found = compared(0.02, logs=1)
        assert found.best == dict.fromkeys(("aicc", "bic"), WIDER)
        assert all(score.interval is None for one in found.models for score in one.scores.values())

    @pytest.mark.slow
    @pytest.mark.parametrize("method", ["gls", "two_stage"])
    def test_by_windows(self, method: str):
        found = compared(0.02, method=method, segment=0.5)
        # The lone robot without coefficients cannot be fitted in two stages.
        if method == "two_stage":
            assert found.models[1].reason == "skid_steer_slip has no coefficients; use method: joint or gls"
            assert found.best["bic"] == NARROW
        else:
            assert found.best == dict.fromkeys(("aicc", "bic", "held_out"), WIDER)

    @pytest.mark.slow
    def test_a_robust_loss_is_compared_by_prediction_alone(self):
        found = compared(0.02, logs=3, loss="huber", sensor_place=(), clock_offset=False)
        assert found.best == {"held_out": WIDER}
        assert found.agree is None
        assert found.models[0].likelihood is None

    def test_what_was_known_before_is_left_out(self):
        logs = several(2, seconds=4.0, noise=NOISE)
        problem = logged_problem(prior=Prior(standard_deviations={"track": "1 um"}))
        asked = options(segment="log", noise="constant", sensor_place=(), clock_offset=False, models=[SLIP])
        found = calibrate(problem, logs, asked).comparison
        assert found.models[0].fit.values[2] == pytest.approx(TRUTH["track"], rel=0.02)


class TestLikelihood:
    LOGS = several(2, seconds=4.0, noise=NOISE)

    def test_of_constant_noise_is_that_of_normal_residuals(self):
        fit = fit_of(self.LOGS)
        readings = FittedReadings.of([fit])
        assert readings.count == pytest.approx(fit.layout.valid.sum() - 6)
        found = readings.likelihood(fit, options(noise="constant"))
        wanted = 0.0
        for places in ([0, 1], [2]):
            residuals = fit.residuals[..., places][fit.layout.valid[..., places]]
            left = readings.shares[..., places].sum()
            size = np.sqrt((residuals**2).sum() / left)
            wanted += -left * np.log(size * np.sqrt(2 * np.pi)) - left / 2
        assert found.each.sum() == pytest.approx(wanted)
        assert found.unknowns == pytest.approx(3 + 2, abs=1e-3)
        assert found.starts == pytest.approx(0, abs=1e-3)

    def test_of_stated_noise_is_as_stated(self):
        specified = fit_of(self.LOGS).noises
        fit = fit_of(self.LOGS, specified=specified)
        readings = FittedReadings.of([fit])
        found = readings.likelihood(fit, options(noise="specified"))
        sizes = np.array([specified["position"].at_rest] * 2 + [specified["heading"].at_rest])
        valid = fit.layout.valid.all(axis=-1)
        rest, shares = fit.residuals[valid] / sizes, readings.shares[valid]
        wanted = -(shares * np.log(sizes * np.sqrt(2 * np.pi))).sum() - (rest**2).sum() / 2
        assert found.each.sum() == pytest.approx(wanted)
        assert found.unknowns == pytest.approx(3, abs=1e-3)

    @pytest.mark.slow
    def test_noise_grows_for_all_where_it_grows_for_one(self):
        logs = several(2, seconds=6.0, noise=NOISE, per_yaw_rate=(0.01, 0.02))
        growing, constant = (fit_of(logs, grows=grows) for grows in (True, False))
        assert growing.noises["heading"].per_yaw_rate > 0
        both = FittedReadings.of([constant, growing])
        assert both.growth == {"position": [1], "heading": [1]}
        found, alone = (one.likelihood(constant, options()) for one in (both, FittedReadings.of([constant])))
        assert found.each.sum() > alone.each.sum() + 10
        assert found.unknowns == pytest.approx(alone.unknowns + 2)

    def test_of_windows_is_that_of_all_together(self):
        fit = gls(several(3, seconds=12.0, noise=NOISE))
        found = FittedReadings.of([fit]).likelihood(fit, options(noise="specified"))
        # Whitened residuals are those of a normal distribution times the volume.
        white = fit.white[fit.layout.valid]
        wanted = norm.logpdf(white).sum() - fit.volumes.sum() / 2
        assert found.each.sum() == pytest.approx(wanted)
        scaled = FittedReadings.of([fit]).likelihood(fit, options(noise="estimated"))
        assert scaled.each.sum() >= found.each.sum()

    def test_states_that_others_do_not_have_are_counted(self):
        lagging = SkidSteerSlip(wheel_radius=0.05, track=0.2, yaw_lag=0.2)
        narrow = fit_of(self.LOGS, seconds=1.0)
        true = truth_of(lagging, **TRUTH, yaw_lag=0.2)
        logs = [log_of(course(lagging, true, seconds=4.0, seed=k), noise=NOISE, name=f"{k}") for k in (0, 1)]
        wide = fit_of(logs, unknowns_of(lagging), seconds=1.0)
        found = FittedReadings.of([narrow]).likelihood(wide, options(noise="constant"))
        assert found.starts == pytest.approx(wide.layout.count, rel=0.2)


class TestInflation:
    def test_of_white_residuals_is_next_to_one(self):
        each = [
            inflation(fit_of(several(4, seconds=12.0, noise=NOISE, seed=s), seconds=1.0), None)
            for s in (0, 50)
        ]
        assert all(1 <= factor < 2 for factor, _ in each)
        assert {way for _, way in each} == {"blocks"}

    def test_of_drifting_robots_is_more(self):
        factor, way = inflation(fit_of(several(4, seconds=12.0, noise=NOISE, drift=0.01), seconds=2.0), None)
        assert way == "blocks"
        assert factor > 2

    def test_of_too_few_blocks_is_by_correlations(self):
        white, drifting = (
            inflation(fit_of(several(1, seconds=20.0, noise=NOISE, drift=drift)), None) for drift in (0, 0.01)
        )
        assert {white[1], drifting[1]} == {"correlations"}
        assert white[0] < 2 < drifting[0]


def entry(name: str, each: list[float], errors: list[float] = (), parameters: int = 2, **keys) -> Compared:
    """A model whose logs have those likelihoods and position errors."""
    fit = fit_of(FEW)
    blank = dict.fromkeys(DeadReckoning.__dataclass_fields__)
    runs = tuple(DeadReckoning(**{**blank, "rmse_position": size}) for size in errors)
    left = (HeldOut(("x",), np.zeros(1), runs, runs),) if errors else ()
    names = tuple(f"p{index}" for index in range(parameters))
    likelihood = Likelihood(np.array(each), float(parameters))
    return Compared(name, ROBOT, names, fit=fit, likelihood=likelihood, cross_validation=left, **keys)


FEW = several(4, seconds=1.0, noise=NOISE)
ICR = SkidSteerIcr(wheel_radius=0.05, y_icr_left=0.1, y_icr_right=-0.1)


@cache
def with_loose_ones() -> Calibration:
    """Beside the study's own robot one that the logs tell, one that they do not, and part of that."""
    loose = SkidSteer(wheel_radius=0.05, track=0.2)
    alternatives = [
        Alternative(robot=ICR),
        Alternative(robot=loose),
        Alternative(robot=loose, name="fixed", estimate=["track"]),
    ]
    logs = several(3, seconds=2.0, noise=NOISE)
    asked = options(segment="log", noise="constant", sensor_place=(), clock_offset=False, models=alternatives)
    return calibrate(logged_problem(), logs, asked)


class TestScores:
    def test_are_the_textbooks(self):
        found = scored(
            [entry("a", [10.0] * 4), entry("b", [11.0, 11.0, 10.0, 11.0], parameters=4)], 50.0, 1.0, "blocks"
        )
        first, second = (one.scores for one in found.models)
        assert first["bic"].value == pytest.approx(-2 * 40 + 2 * np.log(50))
        assert second["bic"].value == pytest.approx(-2 * 43 + 4 * np.log(50))
        assert first["aicc"].value == pytest.approx(-80 + 4 + 12 / 47)
        assert second["aicc"].value == pytest.approx(-86 + 8 + 40 / 45)
        assert found.best == {"aicc": "b", "bic": "a"}
        assert found.agree is False

    def test_states_of_starts_cost_by_their_segments(self):
        plain = entry("a", [10.0] * 4)
        wide = replace(plain, name="b", likelihood=replace(plain.likelihood, starts=4.0))
        for readings, price in ((400.0, np.log(100)), (12.0, 2.0)):
            first, second = (one.scores for one in scored([plain, wide], readings, 1.0, "blocks").models)
            assert second["bic"].difference == pytest.approx(4 * price)
            assert second["aicc"].difference > 8
            assert first["bic"].difference == 0

    def test_intervals_are_vuongs(self):
        each = [9.0, 8.0, 10.5, 8.5]
        found = scored([entry("a", [10.0] * 4), entry("b", each)], 50.0, 1.0, "blocks")
        score = found.models[1].scores["aicc"]
        half = 2 * 3.182446 * 2 * np.std(10.0 - np.array(each), ddof=1)
        assert score.difference == pytest.approx(8.0)
        assert score.interval == pytest.approx((8.0 - half, 8.0 + half))
        assert score.equal
        sure = scored([entry("a", [10.0] * 4), entry("b", [8.0, 8.1, 7.9, 8.0])], 50.0, 1.0, "blocks")
        assert not sure.models[1].scores["aicc"].equal

    def test_correlated_readings_count_less(self):
        models = [entry("a", [10.0] * 4), entry("b", [12.0] * 4, parameters=4)]
        assert scored(models, 500.0, 1.0, "blocks").best["bic"] == "b"
        assert scored(models, 500.0, 5.0, "blocks").best["bic"] == "a"

    def test_prediction_goes_by_ratios(self):
        sizes = np.array([0.01, 0.1, 0.02, 1.0])
        models = [entry("a", [1.0] * 4, list(sizes)), entry("b", [1.0] * 4, list(1.3 * sizes))]
        score = scored(models, 50.0, 1.0, "blocks").models[1].scores["held_out"]
        assert score.value == pytest.approx(1.3 * np.prod(sizes) ** 0.25)
        assert score.interval == pytest.approx((score.difference, score.difference))
        assert not score.equal
        close = [models[0], entry("c", [1.0] * 4, list(1.04 * sizes))]
        assert scored(close, 50.0, 1.0, "blocks").models[1].scores["held_out"].equal

    def test_what_cannot_be_compared_has_none(self):
        models = [entry("a", [1.0] * 4), entry("b", [9.0] * 4, reason="the logs do not identify p0")]
        found = scored(models, 50.0, 1.0, "blocks")
        assert found.best == {"aicc": "a", "bic": "a"}
        assert found.models[1].scores == {}

    @pytest.mark.parametrize("what", ["values", "residuals"])
    def test_a_search_that_failed_cannot_be_compared(self, what: str):
        fit = fit_of(TestLikelihood.LOGS)
        assert _why_not(fit) == ""
        failed = replace(fit, **{what: np.full_like(getattr(fit, what), np.nan)})
        assert _why_not(failed).startswith("the search failed")

    def test_too_few_readings_for_the_correction_leave_it_out(self):
        found = scored([entry("a", [1.0] * 4, parameters=6)], 6.0, 1.0, "blocks")
        assert list(found.models[0].scores) == ["bic"]


class TestErrors:
    def refused(self, *models: Alternative, match: str, logs=FEW):
        with pytest.raises(ProblemError, match=match):
            calibrate(logged_problem(), logs, options(models=models))

    def test_a_robot_of_other_inputs(self):
        other = Alternative(robot=Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.3))
        self.refused(
            other, match=r"calibration\.models\.0: mecanum needs the inputs .*; logged are wheel_speed_r"
        )

    def test_the_name_of_the_studys_own(self):
        other = DifferentialDrive(wheel_radius=0.06, track=0.2)
        self.refused(
            Alternative(robot=other), match="a second model named differential_drive; give each a `name`"
        )

    def test_parameters_that_it_has_not(self):
        self.refused(
            Alternative(robot=WIDE, estimate=["slip"]), match=r"expected some of its parameters \(wheel"
        )
        self.refused(Alternative(robot=WIDE, estimate=["track", "track"]), match="listed twice")

    def test_two_of_one_name(self):
        with pytest.raises(PartError, match="two models named skid_steer_slip; give each a `name`"):
            options(models=[SLIP, SLIP])

    @pytest.mark.slow
    def test_parameters_that_the_logs_do_not_tell(self):
        _, _, open_, fixed = with_loose_ones().comparison.models
        assert "the logs do not identify wheel_radius_right, wheel_radius_left, slip_outer" in open_.reason
        assert open_.reason.endswith("leave parameters out of its `estimate`")
        assert open_.scores == {}
        assert (fixed.reason, fixed.parameters) == ("", ("track",))

    @pytest.mark.slow
    def test_readings_that_it_has_not(self):
        from oed.robots.models import TractorTrailer

        trailer = TractorTrailer(wheel_radius=0.05, track=0.2, hitch_offset=0.1, trailer_length=0.4)
        log = log_of(
            course(trailer, np.array(trailer.nominal), seconds=4.0),
            noise=NOISE,
            quantities=(*XYH, "trailer_angle"),
        )
        found = calibrate(
            logged_problem(model=trailer), [log], options(segment="log", models=[SLIP])
        ).comparison
        assert found.models[1].reason == "the logs hold trailer_angle, which it has not"


class TestForm:
    def test_a_robots_keys_with_a_name_beside_them(self):
        plain = {"kind": "skid_steer_slip", "wheel_radius": "5 cm", "track": 0.2, "x_icr": 0.01}
        one = Alternative.model_validate({**plain, "name": "shifted", "estimate": ["track"]})
        assert (one.label, one.parameters, one.robot.x_icr) == ("shifted", ("track",), 0.01)
        assert Alternative.model_validate(plain).label == "skid_steer_slip"

    def test_comes_back_as_it_went(self):
        given = options(models=[SLIP, Alternative(robot=WIDE, name="half", estimate=["track"])])
        plain = json.loads(given.model_dump_json(exclude_none=True))
        assert plain["models"][1]["kind"] == "skid_steer_slip"
        assert options(**plain) == given


class Swapped(DifferentialDrive):
    """The same robot, whose left wheel comes first."""

    inputs: ClassVar = DifferentialDrive.inputs[::-1]

    def effective_inputs(self, inputs, parameters):
        return inputs[[1, 0]]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["joint", "gls", "two_stage"])
def test_the_same_robot_is_equal_whatever_its_start_and_its_inputs_order(method: str):
    logs = several(3, seconds=3.0, noise=NOISE)
    same = Alternative(robot=Swapped(wheel_radius=0.055, track=0.22), name="same")
    chosen = options(segment=0.5, method=method, noise="constant", models=[same], clock_offset=False)
    found = calibrate(logged_problem(), logs, chosen).comparison
    own, other = found.models
    assert other.reason == ""
    assert other.fit.values == pytest.approx(own.fit.values, rel=1e-3, abs=1e-5)
    for measure, score in other.scores.items():
        assert score.equal
        assert score.value == pytest.approx(own.scores[measure].value, rel=1e-3, abs=0.1)
    assert set(found.favourites) == {"differential_drive", "same"}


@pytest.mark.slow
def test_a_record_holds_it():
    found = with_loose_ones()
    data = estimate_of(found).plain()["comparison"]
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    own, other, open_, _ = data["models"]
    assert (own["name"], own["own"], other["own"]) == ("differential_drive", True, False)
    assert [one["name"] for one in other["parameters"]] == [entry.name for entry in ICR.parameters]
    assert all(one["standard_error"] > 0 for one in other["parameters"])
    assert set(own["scores"]) == {"aicc", "bic", "held_out"}
    assert set(own["scores"]["bic"]) == {"value", "difference", "interval", "equal"}
    assert (open_["comparable"], open_["scores"]) == (False, {})
    assert "the logs do not identify" in open_["reason"]
    assert data["best"]["bic"] in ("differential_drive", "skid_steer_icr", "fixed")
    assert (data["inflation"] >= 1, data["agree"]) == (True, found.comparison.agree)


STUDY = PROBLEMS / "room_robot.yaml"
LOG = STUDY.parent / "logs" / "room_robot.csv"
MODELS = """calibration:
  segment: log
  noise: constant
  sensor_place: []
  clock_offset: false
  models:
    - {kind: skid_steer_slip, wheel_radius: 33 mm, track: 16 cm, track_per_yaw_rate: 5 mm*s/rad}
    - {name: half known, kind: differential_drive, wheel_radius: 33 mm, track: 16 cm, estimate: [track]}
"""


def study(models: str) -> Study:
    return parse_study(f"{STUDY.read_text(encoding='utf-8')}\n{models}", str(STUDY))


class TestStudy:
    def test_models_come_back_as_they_went(self):
        given = study(MODELS)
        assert [one.label for one in given.calibration.models] == ["skid_steer_slip", "half known"]
        again = parse_study(json.dumps(given.echo()))
        assert again.calibration == given.calibration

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            (
                "track_per_yaw_rate",
                "track_per_yawrate",
                "models.0.track_per_yawrate: unknown key; did you mean",
            ),
            ("half known", "skid_steer_slip", "two models named skid_steer_slip; give each a `name`"),
            ("kind: differential_drive", "kind: hovercraft", "models.1.kind: expected"),
            ("track: 16 cm, estimate", "track: 16 s, estimate", "models.1.track: expected a length"),
        ],
    )
    def test_mistakes_are_named(self, old: str, new: str, words: str):
        with pytest.raises(StudyError, match=re.escape(words)):
            study(MODELS.replace(old, new))

    def test_a_second_robot_of_the_studys_own_name_has_a_line(self):
        with pytest.raises(StudyError, match=r"\d+: calibration\.models\.1: a second model named diff"):
            study(MODELS.replace("name: half known, ", ""))

    @pytest.mark.slow
    def test_an_estimate_has_them_everywhere(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ):
        # Its figures are drawn elsewhere.
        monkeypatch.setattr(page, "_svg", lambda _: "<svg/>")
        record = estimate(study(MODELS), [LOG], out=tmp_path)
        assert [one.name for one in record.models] == [
            "differential_drive",
            "skid_steer_slip",
            "half known",
        ]
        assert load_estimate(tmp_path).models == record.models
        assert record.data["comparison"]["best"]["bic"] == "differential_drive"
        write_estimate(record, tmp_path)
        print_estimate(record)
        for text in ((tmp_path / "estimate.md").read_text(encoding="utf-8"), capsys.readouterr().out):
            assert "differential drive is the best by" in " ".join(text.split())


@pytest.mark.slow
def test_none_are_compared_where_none_are_named():
    found = calibrate(logged_problem(), FEW, options(segment="log", sensor_place=(), clock_offset=False))
    assert found.comparison is None
    assert estimate_of(found).plain()["comparison"] is None

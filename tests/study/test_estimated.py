"""The discrepancy of poses: noise that grows with the twist, as numbers or from an estimate's residuals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies import write_study

import oed
from oed.estimation.assessment.residual_growth import growth
from oed.foundation.errors import StudyError
from oed.records.record import load_estimate
from oed.robots.baselines import baselines
from oed.robots.sensors import AbsoluteNoise
from oed.workflow.studies import load_study, parse_study

PROBLEMS = Path(__file__).parents[2] / "problems"
NOISE = "noise: {position: 1 cm, heading: 1 deg}"
NUMBERS = (
    "discrepancy: {position_per_speed: 30 ms, heading_per_speed: 1 deg*s/m, "
    "position_per_yaw_rate: 4 mm*s/rad, heading_per_yaw_rate: 5 ms}"
)
STUDY = f"""\
format: 1
name: Discrepancy
robot: {{kind: differential_drive, wheel_radius: 4.9 cm, track: 32 cm}}
trajectory: {{duration: 6 s, samples: 60, spline: {{degree: 3, coefficients: 8}}, start: {{x: 0 m, y: 0 m}}}}
measurement: {{kind: poses, {NOISE}}}
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: 20 rad/s^2
  workspace: {{kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}}
"""


def with_discrepancy(text: str) -> str:
    return STUDY.replace(NOISE, NOISE.replace("1 deg}", f"1 deg, {text}}}"))


@pytest.mark.slow
def test_numbers_are_the_same_as_noise_that_grows_so():
    found = parse_study(with_discrepancy(NUMBERS)).problem
    grown = parse_study(STUDY.replace(NOISE, NOISE.replace("1 deg}", f"1 deg, {NUMBERS[14:-1]}}}"))).problem
    plain = parse_study(STUDY).problem
    (drive,) = baselines(plain, "circle")
    values = [oed.evaluate(one, drive.trajectory).objective for one in (found, grown, plain)]
    assert values[0] == pytest.approx(values[1], rel=1e-12)
    assert values[0] < 0.9 * values[2]


def test_it_adds_to_what_the_sensor_has_itself_and_can_be_left_out():
    noise = AbsoluteNoise(
        position=0.01,
        position_per_speed=0.03,
        discrepancy={"position_per_speed": 0.04},  # type: ignore[arg-type]
    )
    assert noise.at_least("x").per_speed == pytest.approx(0.05)
    assert noise.of_sensor.at_least("x").per_speed == 0.03
    assert noise.of_sensor.at_least("x").at_rest == 0.01


def test_growth_is_found_in_residuals():
    rng = np.random.default_rng(1)
    speeds, rates = rng.uniform(0, 0.5, 20_000), rng.uniform(-3, 3, 20_000)
    sizes = np.sqrt(0.01**2 + (0.06 * speeds) ** 2 + (0.005 * rates) ** 2)
    found = growth(sizes * rng.normal(size=20_000), speeds, rates)
    np.testing.assert_allclose(found, [0.01, 0.06, 0.005], rtol=0.05)
    flat = growth(0.01 * rng.normal(size=20_000), speeds, rates)
    assert flat[0] == pytest.approx(0.01, rel=0.02)
    # A tenth of the noise at the largest twist, at most.
    assert flat[1] * 0.5 < 0.003
    assert flat[2] * 3 < 0.003


@pytest.fixture(scope="module")
def estimated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the estimate of a log in `pilot`."""
    folder = tmp_path_factory.mktemp("estimated")
    study = load_study(PROBLEMS / "room_robot.yaml")
    oed.estimate(study, [PROBLEMS / "logs" / "room_robot.csv"], out=folder / "pilot")
    return folder


@pytest.mark.slow
def test_an_estimate_of_a_pilot_drive_gives_the_numbers(estimated: Path):
    file = estimated / "study.yaml"
    file.write_text(with_discrepancy("discrepancy: {record: pilot}"))
    found = load_study(file).problem.sensors[0].noise.discrepancy
    own = [one for one in load_estimate(estimated / "pilot").residuals if one.quantity == "heading"]
    table = np.concatenate([np.array([one.value, one.speed, one.yaw_rate]).T for one in own])
    _, per_speed, per_yaw_rate = growth(*table.T)
    assert found.heading_per_speed == per_speed
    assert found.heading_per_yaw_rate == per_yaw_rate
    # The echo stands on its own.
    echo = load_study(file).echo()["measurement"]["noise"]["discrepancy"]
    assert echo == pytest.approx(found.model_dump())


@pytest.mark.slow
def test_residuals_of_a_path_that_follows_the_readings_are_no_discrepancy(tmp_path: Path):
    text = (PROBLEMS / "room_robot.yaml").read_text() + "\ncalibration: {method: likelihood}\n"
    rows = (PROBLEMS / "logs" / "room_robot.csv").read_text().splitlines(keepends=True)
    log = write_study(tmp_path, "".join(rows[:60]), "begin.csv")
    oed.estimate(parse_study(text), [log], out=tmp_path / "pilot")
    file = tmp_path / "study.yaml"
    file.write_text(with_discrepancy("discrepancy: {record: pilot}"))
    with pytest.raises(StudyError, match=r"discrepancy.record: expected an estimate by method joint"):
        load_study(file)
    # Its drift is what designs are to have.
    file.write_text(with_drift("{record: pilot}"))
    found = load_study(file).problem.process_noise
    reported = load_estimate(tmp_path / "pilot").drift
    assert found.heading_per_radian == pytest.approx(reported.turn_by_turning)


def test_what_is_wrong_is_named_by_file_line_and_key(tmp_path: Path):
    file = tmp_path / "study.yaml"
    file.write_text(with_discrepancy("discrepancy: {record: nowhere}"))
    with pytest.raises(StudyError, match=r"study.yaml:5: measurement.noise.discrepancy.record: .*nowhere"):
        load_study(file)
    file.write_text(with_discrepancy("discrepancy: {position_per_sped: 1 ms}"))
    with pytest.raises(StudyError, match=r"study.yaml:5: measurement.noise.discrepancy.position_per_sped"):
        load_study(file)


def with_drift(text: str) -> str:
    return STUDY.replace(NOISE, f"{NOISE}, drift: {text}")


def test_a_drift_that_is_no_amount_of_anything_is_told_both_forms():
    with pytest.raises(StudyError, match=r"drift: expected usual, or .*ahead_per_metre.*, got '5 %'"):
        parse_study(with_drift("5 %"))


@pytest.mark.slow
def test_an_estimate_of_logs_gives_their_drift(estimated: Path):
    file = estimated / "study.yaml"
    file.write_text(with_drift("{record: pilot}"))
    found, reported = (
        load_study(file).problem.process_noise,
        load_estimate(estimated / "pilot").drift,
    )
    assert found.heading_per_radian == reported.turn_by_turning > 0
    assert found.ahead_per_metre == reported.ahead > 0
    echo = load_study(file).echo()["measurement"]["drift"]
    assert echo["sideways_per_metre"] == pytest.approx(reported.sideways)


@pytest.mark.slow
def test_drift_is_numbers_a_record_or_usual(tmp_path: Path):
    usual = parse_study(with_drift("usual")).problem
    plain = parse_study(STUDY).problem
    (drive,) = baselines(plain, "circle")
    assert oed.evaluate(usual, drive.trajectory).objective < oed.evaluate(plain, drive.trajectory).objective
    file = tmp_path / "study.yaml"
    for text, expected in (
        ("{record: nowhere}", "drift.record: .*nowhere"),
        (
            "{record: logs, ahead_per_metre: 5 mm}",
            "drift.ahead_per_metre: does not go with the keys beside it",
        ),
        ("{ahead_per_meter: 5 mm}", "drift.ahead_per_meter: .*ahead_per_metre"),
        ("{ahead_per_metre: 5 deg}", "drift.ahead_per_metre: .*length"),
        ("{heading_per_metre: -1 deg}", "drift.heading_per_metre"),
        ("often", "drift: .*usual"),
    ):
        file.write_text(with_drift(text))
        with pytest.raises(StudyError, match=rf"study.yaml:5: measurement.{expected}"):
            load_study(file)
    with pytest.raises(oed.ProblemError, match="here give the numbers"):
        oed.Problem(
            plain.model,
            plain.design,
            oed.Poses(noise={"position": 0.01, "heading": 0.02}, drift={"record": "nowhere"}),
            plain.limits,
            "E",
        )

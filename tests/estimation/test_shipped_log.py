"""The log that is shipped is what its simulation writes, and tells the truth it was simulated with."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from recorded import record_from
from shipped_log import BEHIND, FILE, SITS, STUDY, TRUTH, text

from oed.cli import main
from oed.records.recorded_study import recorded_study
from oed.workflow.estimate_logs import estimate
from oed.workflow.saving import save_estimate
from oed.workflow.studies import load_study


@pytest.mark.slow
def test_it_is_what_its_simulation_writes():
    # Poses differ in their last digit where a machine adds up otherwise.
    made, shipped = text().splitlines(), FILE.read_text(encoding="utf-8").splitlines()
    assert made[0] == shipped[0]
    numbers, wanted = (
        np.array([[float(cell) for cell in row.split(",")] for row in rows[1:]]) for rows in (made, shipped)
    )
    np.testing.assert_array_equal(numbers[:, :4], wanted[:, :4])
    np.testing.assert_allclose(numbers[:, 4:], wanted[:, 4:], atol=0.011)


@pytest.fixture(scope="module")
def found():
    return estimate(load_study(STUDY), [FILE])


@pytest.mark.slow
def test_it_tells_the_truth(found):
    for entry in found.parameters:
        low, high = entry.interval
        assert low < TRUTH[entry.name] < high
        assert entry.error("information") < 0.0005 * entry.value
        # Twenty seconds cannot show that this robot does not drift.
        assert found.covariance_kind == "drift"
        assert entry.standard_error < 0.0015 * entry.value


@pytest.mark.slow
def test_it_tells_where_the_target_sits_and_how_far_the_clocks_are_apart(found):
    nuisances = {entry["name"]: entry for entry in found.data["nuisances"]}
    truth = dict(zip(("sensor_x", "sensor_y", "sensor_heading"), SITS, strict=True))
    for name, value in {**truth, "clock_offset": BEHIND}.items():
        assert abs(nuisances[name]["value"] - value) < 4 * nuisances[name]["standard_error"]


@pytest.mark.slow
def test_what_was_wrapped_is_named(found):
    names = {one["name"] for one in found.data["logs"][0]["findings"]}
    assert {"counter_wrapped", "wrapped_heading", "stationary_start", "clock_offset"} <= names


@pytest.mark.slow
def test_a_study_out_of_a_record_estimates_the_same(found):
    study = load_study(STUDY)
    again = recorded_study(record_from({"study": json.loads(json.dumps(study.echo()))}))
    assert estimate(again, [FILE]).parameters == found.parameters


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
def test_an_estimate_alone_is_enough_for_the_controller_and_its_page(tmp_path, found, capsys):
    save_estimate(found, tmp_path)
    assert main(["export", str(tmp_path), "--to", "ros2_yaml"]) == 0
    controller = yaml.safe_load((tmp_path / "diff_drive_controller.yaml").read_text())
    told = controller["diff_drive_controller"]["ros__parameters"]
    radius = told["wheel_radius"] * told["left_wheel_radius_multiplier"]
    assert radius == pytest.approx(found.values["wheel_radius_left"])
    assert main(["report", str(tmp_path), "--json"]) == 0
    assert (tmp_path / "estimate.html").is_file()
    assert not (tmp_path / "report.html").exists()

"""What a record holds of a calibration."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from simulated import TRUTH, course, log_of, logged_problem, options, several

from oed.estimation import Calibration, calibrate
from oed.records.calibration_outcome import PATHS, estimate_of, mean_errors
from oed.records.record import EstimateRecord, load_estimate
from oed.workflow.saving import save_estimate

NOISE = (0.002, 0.005)


def plain(value) -> bool:
    """Whether JSON holds it."""
    return bool(json.dumps(value, allow_nan=False))


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    logs = several(3, seconds=6.0, noise=NOISE, place=(0.1, 0.0, 0.0))
    apart = [log_of(course(seed=9, seconds=6.0), noise=NOISE, place=(0.1, 0.0, 0.0), name="apart")]
    return calibrate(logged_problem(), logs, options(segment=2.0, replicates=100, block=2.0), test_logs=apart)


@pytest.fixture(scope="module")
def data(calibration: Calibration) -> dict:
    return estimate_of(calibration).plain()


class TestData:
    @pytest.mark.slow
    def test_json_holds_it(self, data: dict, tmp_path: Path):
        record = EstimateRecord.model_validate({"format": 1, **data})
        path = save_estimate(record, tmp_path / "new")
        assert path == tmp_path / "new" / "estimate.json"
        assert "NaN" not in path.read_text()
        assert "Infinity" not in path.read_text()
        assert load_estimate(path).data == json.loads(json.dumps(record.data))

    def test_parameters(self, calibration: Calibration, data: dict):
        for index, entry in enumerate(data["parameters"]):
            assert entry["name"] == calibration.parameters[index]
            assert entry["value"] == calibration.values[index]
            low, high = entry["interval"]
            assert (low + high) / 2 == pytest.approx(entry["value"])
            assert (high - low) / 2 == pytest.approx(data["half_width"] * entry["standard_error"])
            assert abs(entry["value"] - TRUTH[entry["name"]]) < high - low
            assert set(entry["standard_errors"]) == {"information", "drift", "sandwich", "bootstrap"}
        assert EstimateRecord.model_validate(data).values == dict(zip(TRUTH, calibration.values, strict=True))

    def test_drift(self, calibration: Calibration, data: dict):
        found = data["drift"]
        rates = [found[name] ** 2 for name in ("ahead", "sideways", "turn_by_path", "turn_by_turning")]
        assert rates == pytest.approx(calibration.drift.values)
        assert found["seconds"] == calibration.drift.seconds

    def test_correlation_is_the_covariances(self, data: dict):
        covariance, correlation = np.array(data["covariance"]), np.array(data["correlation"])
        sizes = np.sqrt(np.diag(covariance))
        assert correlation * np.outer(sizes, sizes) == pytest.approx(covariance)
        assert np.diag(correlation) == pytest.approx(np.ones(3))

    def test_nuisances(self, data: dict):
        names = [entry["name"] for entry in data["nuisances"]]
        assert names == ["sensor_x", "sensor_y", "sensor_heading", *["clock_offset"] * 3]
        assert data["nuisances"][0]["value"] == pytest.approx(0.1, abs=0.01)
        assert [entry["file"] for entry in data["nuisances"][3:]] == [f"drive {k}.csv" for k in range(3)]

    @pytest.mark.slow
    def test_sizes_are_bounded(self, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("oed.records.calibration_outcome.POINTS", 10)
        monkeypatch.setattr("oed.records.calibration_outcome.RESIDUALS", 50)
        logs = several(14, seconds=1.5, noise=NOISE)
        asked = options(segment="log", noise="constant", replicates=100, sensor_place=(), clock_offset=False)
        found = estimate_of(calibrate(logged_problem(), logs, asked)).plain()
        assert len(found["paths"]) == PATHS
        for path in found["paths"]:
            assert len({len(values) for values in path.values() if isinstance(values, list)}) == 1
            assert len(path["t"]) <= 10
        for about in ("x", "y", "heading"):
            kept = [len(one["value"]) for one in found["residuals"] if one["quantity"] == about]
            assert 14 < sum(kept) <= 50 + len(logs)

    def test_held_out_comes_first_among_the_paths(self, data: dict):
        assert [(path["log"], path["role"]) for path in data["paths"]][:2] == [
            ("apart", "held out"),
            ("drive 0", "left out"),
        ]

    def test_a_paths_errors_are_the_logs(self, calibration: Calibration, data: dict):
        path, one = EstimateRecord.model_validate(data).paths[0], calibration.held_out.before[0]
        turned, off = path.heading_errors[0], path.position_errors[0]
        assert np.sqrt(np.nanmean(off**2)) == pytest.approx(path.before.rmse_position, rel=0.02)
        assert np.sqrt(np.nanmean(turned**2)) == pytest.approx(one.rmse_heading, rel=0.02)
        assert path.after.rmse_heading == calibration.held_out.after[0].rmse_heading

    def test_means(self, calibration: Calibration, data: dict):
        one = calibration.cross_validation[0]
        assert mean_errors(one.after).rmse_position == one.after[0].rmse_position
        assert data["left_out"][0]["mean"]["after"]["length"] == one.after[0].length

    @pytest.mark.slow
    @pytest.mark.parametrize("quantities", [("heading",), ("x", "y")])
    def test_of_some_quantities_alone(self, quantities):
        logs = several(2, seconds=5.0, noise=NOISE, quantities=quantities)
        found = estimate_of(calibrate(logged_problem(), logs, options(segment="log"))).plain()
        assert plain(found)
        assert [entry["about"] for entry in found["noise"]] == [
            "position" if quantities == ("x", "y") else "heading"
        ]

    @pytest.mark.slow
    def test_of_a_robot_at_rest(self):
        log = log_of(course(inputs=np.zeros((50, 2)), seconds=5))
        assert plain(estimate_of(calibrate(logged_problem(), [log, log], options(segment="log"))).plain())

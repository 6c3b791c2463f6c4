"""Long logs: averaged and sampled to what a fit takes, without harm to the estimates, and never silently."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import ROBOT, TRUTH, course, log_of, logged_problem, options

from oed.estimation import calibrate
from oed.estimation.prediction.layout import stretches
from oed.estimation.preprocessing import preprocess
from oed.estimation.preprocessing.preprocess import BRIEF, PIECES, thinned, thinning_notes
from oed.estimation.setup.noise import specified_noise
from oed.logs.log import BRIDGED, Log

NOISE = (0.002, 0.005)


def fast(seconds: float = 20.0, period: float = 0.002, **keys) -> Log:
    """A log of a fast reference: inputs held for ten of its periods."""
    times = period * np.arange(round(seconds / period) + 1)
    slow = course(seconds=seconds, period=10 * period)
    inputs = np.repeat(slow.inputs, 10, axis=0)[: len(times) - 1]
    return log_of(course(times=times, inputs=inputs), noise=NOISE, **keys)


LONG = fast()


def errors_of(found) -> dict[str, float]:
    """By how many standard errors each parameter is off the truth."""
    each = zip(found.parameters, found.values, strict=True)
    return {name: (value - TRUTH[name]) / found.standard_deviations[name] for name, value in each}


class TestThinned:
    def test_short_logs_stay_as_they_are(self):
        logs = [LONG, fast(1.0)]
        assert thinned(logs) == tuple(logs)
        assert thinning_notes(logs, thinned(logs)) == []

    def test_neighbours_are_averaged(self):
        (log,) = thinned([LONG], most=2000)
        assert log.averaged == 6
        count = len(LONG.pose_times) // 6
        np.testing.assert_allclose(log.pose_times, LONG.pose_times[: 6 * count].reshape(-1, 6).mean(axis=1))
        np.testing.assert_allclose(log.poses, LONG.poses[: 6 * count].reshape(-1, 6, 3).mean(axis=1))
        np.testing.assert_array_equal(log.integrals, LONG.integrals)
        assert [one.name for one in log.findings] == ["averaged_poses"]

    def test_never_over_a_time_in_which_the_robot_moves_much(self):
        (log,) = thinned([LONG], most=50)
        assert log.averaged == round(BRIEF / 0.002)

    @pytest.mark.parametrize("gap", [None, 10.0])
    def test_never_over_a_gap(self, gap: float | None):
        times = LONG.pose_times + 3.0 * (np.arange(len(LONG.pose_times)) >= 1001)
        (log,) = thinned([replace(LONG, pose_times=times, gap=gap)], most=2000)
        assert not np.any((log.pose_times > 2.0) & (log.pose_times < 5.0))
        assert np.diff(log.pose_times).max() == pytest.approx(3.0 + 0.002 * (6 + 1001 % 6), abs=1e-9)

    def test_all_logs_alike(self):
        logs = thinned([LONG, fast(5.0, 0.01)], most=2000)
        assert [log.averaged for log in logs] == [2, 2]

    def test_the_rest_is_sampled_in_pieces_all_over_the_log(self):
        slow = fast(1500.0, 0.1)
        (log,) = thinned([slow], most=6000)
        assert log.averaged == 1
        assert len(log.pose_times) == 6000
        assert (log.pose_times[0], log.pose_times[-1]) == (slow.pose_times[0], slow.pose_times[-1])
        holes = np.diff(log.pose_times) > 0.15
        assert holes.sum() == PIECES - 1
        (note,) = thinning_notes([slow], [log])
        assert note.startswith(
            "15001 poses are more than a fit takes in reasonable time: 6000 kept in pieces"
        )

    @pytest.mark.parametrize("gap", [None, 1e6])
    def test_what_is_left_out_is_not_bridged(self, gap: float | None):
        (log,) = thinned([replace(fast(1500.0, 0.1), gap=gap)], most=14_900)
        assert len(log.breaks) == 9
        assert log.gap == gap
        # Left out are times that gaps of a tracker may well last.
        assert np.diff(log.pose_times).max() < BRIDGED
        assert len(stretches(log, 0.0)) == 10

    def test_stated_noise_is_that_of_the_means(self):
        measurement = logged_problem().measurement
        one, nine = specified_noise(measurement), specified_noise(measurement, 9)
        assert nine["position"].at_rest == pytest.approx(one["position"].at_rest / 3)


@pytest.mark.slow
def test_averages_tell_what_all_poses_tell():
    # Of independent noise: the same estimates within a share of their standard errors, which are the same.
    log = fast(2.0)
    chosen = options(
        segment="log", covariance="information", noise="constant", sensor_place=(), clock_offset=False
    )
    whole, means = (calibrate(logged_problem(), logs, chosen) for logs in ([log], thinned([log], most=200)))
    assert means.fit.layout.logs[0].averaged == 6
    sizes, own = (np.array(list(one.standard_deviations.values())) for one in (whole, means))
    np.testing.assert_allclose(own, sizes, rtol=0.1)
    assert np.abs((means.values - whole.values) / sizes).max() < 0.5
    assert max(map(abs, errors_of(means).values())) < 3


@pytest.mark.slow
def test_a_long_log_is_fitted_by_few_poses_and_says_so(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(preprocess, "LEAST", 20)
    monkeypatch.setattr(thinned, "__defaults__", (400,))
    asked = options(segment="log", noise="specified", sensor_place=(), clock_offset=False)
    found = calibrate(logged_problem(), [LONG], asked)
    assert found.fit.layout.valid.sum() == 3 * 400
    assert "averaged 10 at a time, 400 kept in pieces" in found.notes[0]
    assert {one.name for one in found.logs[0].findings} >= {"averaged_poses", "sampled_poses"}
    specified = next(one for one in found.diagnostics if one.name == "stated_noise")
    assert specified.passed
    assert max(map(abs, errors_of(found).values())) < 4
    assert found.robot == ROBOT

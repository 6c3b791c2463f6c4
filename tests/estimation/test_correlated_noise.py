"""Readings whose errors last, as those of positions by satellites: neither white noise nor drift."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy
from pulls import require_pulls
from simulated import (
    ROBOT,
    TRUTH,
    XYH,
    course,
    fit_of,
    lasting,
    log_of,
    logged_problem,
    options,
    rich_inputs,
    search_of,
    truth_of,
)
from windowed import drifting

from oed.estimation import Calibration, calibrate
from oed.estimation.assessment.dead_reckoning import held_out
from oed.estimation.assessment.likelihood import FittedReadings
from oed.estimation.methods.correlated_readings import CorrelatedReadings
from oed.estimation.methods.drift_rates import USUAL
from oed.estimation.methods.faint_drift import SIZES, OfTwoSizes
from oed.estimation.methods.gauss_markov import GaussMarkov
from oed.estimation.methods.noise_selection import Drift, ErrorModel, Lasting, Remainder, bounded_errors
from oed.foundation.errors import ProblemError
from oed.logs.log import Log
from oed.robots.sensors.logged import Noise

TRUE = truth_of(ROBOT, **TRUTH)
POSITIONS = ("x", "y")
NOISE = (0.005, 0.01)
LASTS = (0.015, 5.0)
DRIFT = (0.004, 0.004, 0.02)
GAUSS_MARKOV = GaussMarkov({"position": 0.004, "heading": 0.01}, {"position": 0.02, "heading": 0.03}, 3.0)


def test_sizes_of_noise_are_white_ones_then_the_process_and_its_time():
    np.testing.assert_array_equal(GAUSS_MARKOV.sizes, [0.004, 0.01, 0.02, 0.03, 3.0])


def satellites(seed: int, seconds: float = 40.0, quantities: tuple[str, ...] = POSITIONS) -> Log:
    drive = course(seconds=seconds, seed=seed)
    log = log_of(drive, noise=NOISE, seed=seed, name=f"d{seed}", quantities=quantities, every=4)
    return lasting(log, *LASTS, seed)


def drifted(seed: int, quantities: tuple[str, ...] = POSITIONS) -> Log:
    drive = drifting(course(seconds=60.0, seed=seed), TRUE, DRIFT, seed)
    return log_of(drive, noise=NOISE, seed=seed, name=f"d{seed}", quantities=quantities, every=4)


def estimate(logs: Sequence[Log], **keys) -> Calibration:
    own = options(sensor_place=(), clock_offset=False, replicates=100, **keys)
    return calibrate(logged_problem(), logs, own)


def positions_by_satellite(seconds: float) -> Log:
    """Positions at 1 Hz whose errors of 0.5 m last a minute, beside 0.3 m of white noise."""
    inputs = 0.3 * rich_inputs(ROBOT, np.arange(seconds) + 0.5)
    drive = course(seconds=seconds, period=1.0, inputs=inputs)
    return lasting(log_of(drive, noise=(0.3, 0.0), quantities=POSITIONS), 0.5, 60.0)


@cache
def estimated(**keys) -> Calibration:
    return estimate(TestEstimate.LOGS, **keys)


def thinly_read(logs: list[Log]) -> Remainder:
    """What a search leaves of short logs of which some readings are missing."""
    search = search_of(logs)
    valid = search.layout.valid.copy()
    valid[0, 3:9, :2] = False
    valid[:, 4::3, 2] = False
    search = replace(search, layout=replace(search.layout, valid=valid))
    fit = search.fit()
    return Remainder.of(search, fit.values, fit.starts, fit.noises)


def covariance(rest: Remainder, row: int, white: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Of the readings of a segment, by that of errors at all times (n + 1, k, n + 1, k)."""
    read = rest.valid[row].ravel()
    whole = errors.reshape(len(read), -1) + np.diag(np.tile(white[rest.group] ** 2, len(read) // 3))
    return whole[np.ix_(read, read)]


def surprise(rest: Remainder, covariances: list[np.ndarray]) -> float:
    """Twice the negative logarithm of the restricted likelihood, by dense matrices."""
    count, fixed = len(rest.rows), 1 + len(rest.known)
    columns = []
    for row, valid in enumerate(rest.valid):
        own = rest.rows[row][valid]
        starts = np.zeros((len(own), count, own.shape[1] - fixed))
        starts[:, row] = own[:, fixed:]
        columns.append(np.column_stack([own[:, :fixed], starts.reshape(len(own), -1)]))
    forms = sum(rows.T @ np.linalg.solve(one, rows) for one, rows in zip(covariances, columns, strict=True))
    forms[1:fixed, 1:fixed] += rest.known
    left = forms[0, 0] - forms[0, 1:] @ np.linalg.solve(forms[1:, 1:], forms[1:, 0])
    sizes = sum(np.linalg.slogdet(one)[1] for one in covariances)
    return float(left + sizes + np.linalg.slogdet(forms[1:, 1:])[1])


class TestNoise:
    LAYOUT = thinly_read([satellites(0, 6.0, XYH), satellites(1, 4.0, XYH)]).layout

    def test_is_whitened_as_by_a_dense_matrix(self):
        rest = thinly_read([satellites(0, 6.0, XYH), satellites(1, 4.0, XYH)])
        layout = replace(rest.layout, valid=rest.valid)
        white = np.array([0.004, 0.004, 0.01])
        values = np.random.default_rng(0).normal(size=(*rest.valid.shape, 2)) * rest.valid[..., None]
        found = GAUSS_MARKOV.whitened(layout, values / white[:, None])
        volumes = GAUSS_MARKOV.volumes(layout)
        for row, valid in enumerate(rest.valid):
            for place, size in enumerate((0.02, 0.02, 0.03)):
                times = layout.times[row][valid[:, place]]
                apart = np.abs(times[:, None] - times)
                dense = size**2 * np.exp(-apart / 3.0) + white[place] ** 2 * np.eye(len(times))
                own = np.linalg.solve(np.linalg.cholesky(dense), values[row, valid[:, place], place])
                assert found[row, valid[:, place], place] == pytest.approx(own, abs=1e-9)
                volumes[row] -= np.linalg.slogdet(dense)[1]
        assert volumes == pytest.approx(np.zeros(2), abs=1e-9)
        assert np.all(found[~rest.valid] == 0)

    def test_of_little_correlation_shows_as_many_values_as_there_are_times(self):
        brief = replace(GAUSS_MARKOV, seconds=0.1)
        assert brief.independent(self.LAYOUT) == pytest.approx(3 * (6 + 4) / 0.2 + 6)


class TestLikelihoods:
    REST = thinly_read([satellites(0, 6.0, XYH), satellites(1, 4.0, XYH)])

    def test_of_lasting_errors(self):
        rest, values = self.REST, []
        for sizes in ([0.004, 0.01, 0.02, 0.03, 3.0], [0.006, 0.02, 0.01, 0.005, 8.0]):
            each = []
            for row, times in enumerate(rest.layout.times):
                process = np.exp(-np.abs(times[:, None] - times) / sizes[-1])
                spread = np.array([sizes[2], sizes[2], sizes[3]]) ** 2
                errors = np.einsum("ij,kl,k->ikjl", process, np.eye(3), spread)
                each.append(covariance(rest, row, np.array(sizes[:2]), errors))
            values.append((Lasting(rest).surprise(np.array(sizes)), surprise(rest, each)))
        (one, dense), (other, wanted) = values
        assert one - other == pytest.approx(dense - wanted, rel=1e-5)

    def test_of_drift(self):
        rest, values = self.REST, []
        for sizes in ([0.004, 0.01, 0.01, 0.03, 0.05], [0.006, 0.02, 0.02, 0.01, 0.02]):
            each = []
            for row, path in enumerate(rest.path):
                # Errors of every step, carried to all later times.
                steps = rest.layout.steps[row]
                turned = steps * (rest.yaw_rates[row, 1:] + rest.yaw_rates[row, :-1]) / 2
                lengths = np.hypot(*np.diff(path, axis=0).T)
                errors = np.zeros((len(path), 3, len(path), 3))
                for step, (length, turn) in enumerate(zip(lengths, turned, strict=True)):
                    later = np.zeros((len(path), 3, 3))
                    later[step + 1 :] = np.eye(3)
                    rest_of_way = path[step + 1 :] - path[step + 1]
                    later[step + 1 :, 0, 2], later[step + 1 :, 1, 2] = -rest_of_way[:, 1], rest_of_way[:, 0]
                    moved = sizes[2] ** 2 * length
                    added = np.diag([moved, moved, sizes[3] ** 2 * length + sizes[4] ** 2 * turn])
                    errors += np.einsum("iab,bc,jdc->iajd", later, added, later)
                each.append(covariance(rest, row, np.array(sizes[:2]), errors))
            values.append((Drift(rest).surprise(np.array(sizes)), surprise(rest, each)))
        (one, dense), (other, wanted) = values
        assert one - other == pytest.approx(dense - wanted, rel=1e-3)

    @pytest.mark.parametrize("kind", [Lasting, Drift])
    def test_of_several_sizes_are_those_of_each(self, kind: type[ErrorModel]):
        errors = kind(self.REST)
        begin = np.concatenate([list(self.REST.white.values()), errors.begin])
        sizes = begin * np.exp(np.random.default_rng(0).normal(size=(4, len(begin))))
        each = [errors.surprise(one) for one in sizes]
        np.testing.assert_allclose(errors.surprises(sizes), each, rtol=1e-9)
        assert np.ptp(each) > 1

    @pytest.mark.slow
    def test_of_faint_drift_are_those_beside_the_likeliest_noise(self):
        # What second derivatives tell is what a search of each pair of sizes for itself finds.
        errors = OfTwoSizes(self.REST, USUAL)
        found, white = errors.of_sizes(), np.log(list(self.REST.white.values()))
        assert np.isfinite(found).sum() > 20
        for row, column in np.argwhere(np.isfinite(found))[::9]:
            drift = np.log(SIZES[[row, column]])
            best = scipy.optimize.minimize(
                lambda logs, drift=drift: errors.surprise(np.exp([*logs, *drift])),
                white,
                method="Nelder-Mead",
            )
            assert found[row, column] == pytest.approx(best.fun, abs=0.06)


class TestThinning:
    @pytest.mark.parametrize("seconds", [2.0, 15.0, np.inf])
    def test_segments_keep_both_ends_whatever_their_number_and_length(self, seconds: float):
        search = search_of([positions_by_satellite(1100.0), positions_by_satellite(604.0)], seconds=seconds)
        starts = search.first_starts(TRUE)
        noises = {"position": Noise(0.3)}
        layout, rest = search.layout, Remainder.of(search, TRUE, starts, noises)
        np.testing.assert_array_equal(rest.layout.times[:, [0, -1]], layout.times[:, [0, -1]])
        read = rest.valid.all(axis=-1)
        assert read[:, 0].all()
        most = max(8, 500 // layout.count)
        np.testing.assert_array_equal(read.sum(axis=1), np.minimum(layout.last + 1, most))
        for row, chosen in enumerate(read):
            assert np.all(np.diff(rest.layout.times[row, chosen]) > 0)
            assert rest.layout.times[row, chosen][-1] == layout.times[row, -1]


class TestSelection:
    @pytest.mark.parametrize("quantities", [POSITIONS, XYH])
    @pytest.mark.parametrize("seed", [0, pytest.param(4, marks=pytest.mark.slow)])
    def test_errors_that_last_are_not_taken_for_drift(self, seed: int, quantities: tuple[str, ...]):
        logs = [satellites(seed + number, quantities=quantities) for number in range(2)]
        short = fit_of(logs, seconds=4.0)
        found = bounded_errors(search_of(logs), short.values, short.noises)
        assert found.white["position"] == pytest.approx(NOISE[0], rel=0.15)
        assert 0.5 < found.lasting["position"] / LASTS[0] < 2
        assert 0.3 < found.seconds / LASTS[1] < 3

    @pytest.mark.slow
    @pytest.mark.parametrize("quantities", [POSITIONS, XYH])
    @pytest.mark.parametrize("seed", [0, pytest.param(4, marks=pytest.mark.slow)])
    def test_drift_is_not_taken_for_errors_that_last(self, seed: int, quantities: tuple[str, ...]):
        logs = [drifted(seed + number, quantities) for number in range(2)]
        short = fit_of(logs, seconds=4.0)
        assert bounded_errors(search_of(logs), short.values, short.noises) is None

    @pytest.mark.parametrize("seed", range(3))
    def test_white_noise_is_not_taken_for_errors_that_last(self, seed: int):
        drive = course(seconds=40.0, seed=seed)
        whole = fit_of([log_of(drive, noise=NOISE, seed=seed, quantities=POSITIONS, every=4)])
        assert bounded_errors(search_of(whole.layout.logs), whole.values, whole.noises) is None


class TestEstimate:
    LOGS = (satellites(2), satellites(3))

    @pytest.mark.slow
    def test_of_whole_logs(self):
        found = estimated()
        # By growth of the residuals alone, segments would be short.
        assert found.segmenting.seconds == np.inf
        assert not found.segmenting.drifts
        assert found.covariances[0].name == "information"
        assert any("errors of the readings last for some" in note for note in found.notes)
        off = np.abs(found.values - TRUE) / np.array([*found.standard_deviations.values()])
        assert np.all(off < found.covariances[0].half_width)
        assert all(test.passed for test in found.diagnostics if test.name == "whiteness")
        # As good on an unseen log as whole logs by hand, whose standard errors are ten times too small.
        unseen = [log_of(course(seconds=60.0, seed=99), name="unseen", quantities=POSITIONS, every=4)]
        white = fit_of(self.LOGS)
        own, by_hand = (held_out(fit, fit.values, unseen, [0.0]).after[0] for fit in (found.fit, white))
        assert own.rmse_position < 2 * by_hand.rmse_position
        assert np.all(np.diag(found.covariance) > 9 * np.diag(white.inverse))

    @pytest.mark.slow
    def test_rounds_settle_though_the_likelihood_is_flat(self):
        # From the same first guess in every round, its search ended here and there, the unknowns after it.
        found = estimate([satellites(63, 25.0, XYH), satellites(64, 25.0, XYH)])
        assert found.fit.correlated is not None
        assert found.fit.converged

    @pytest.mark.slow
    def test_with_correlated_noise_as_asked_for(self):
        found = estimated(segment="log", noise="correlated")
        assert found.fit.correlated is not None
        assert found.fit.converged
        assert found.values == pytest.approx(estimated().values, rel=1e-4)

    @pytest.mark.slow
    @pytest.mark.parametrize("seconds", [500.0, 760.0])
    def test_noise_of_many_short_segments_is_that_from_reading_to_reading(self, seconds: float):
        # What lasts a minute is the same all through a segment of two seconds.
        keys = options(segment=2.0, noise="correlated", clock_offset=False)
        noise = calibrate(logged_problem(), [positions_by_satellite(seconds)], keys).fit.correlated
        assert np.hypot(*noise.sizes[:2]) == pytest.approx(0.3, rel=0.15)

    @pytest.mark.slow
    def test_gls_of_positions_alone(self):
        found = estimated(method="gls", segment="log")
        asked = estimated(segment="log", noise="correlated")
        assert found.values == pytest.approx(asked.values, rel=1e-4)
        assert not found.fit.motions

    @pytest.mark.slow
    def test_gls_of_positions_with_noise_as_specified(self):
        found = estimated(method="gls", segment="log", noise="specified")
        specified = logged_problem().sensors[0].noise.position
        assert found.fit.correlated.white == {"position": pytest.approx(specified)}

    @pytest.mark.slow
    def test_likelihood_is_that_of_what_starts_leave(self):
        fit = CorrelatedReadings(search_of(self.LOGS)).fit()
        found = FittedReadings.of([fit]).likelihood(fit, options(noise="specified"))
        rest = Remainder.of(search_of(self.LOGS), fit.values, fit.starts, fit.noises)
        sizes = [*fit.correlated.white.values(), *fit.correlated.lasting.values(), fit.correlated.seconds]
        known = replace(rest, rows=np.delete(rest.rows, [1, 2, 3], axis=-1), known=np.zeros((0, 0)))
        constant = (fit.layout.valid.sum() - 6) * np.log(2 * np.pi)
        assert -2 * found.each.sum() == pytest.approx(Lasting(known).surprise(np.array(sizes)) + constant)
        assert found.unknowns == pytest.approx(3 + 2, abs=0.01)

    @pytest.mark.slow
    def test_other_robots_are_compared_with_the_same_noise(self):
        slip = {"kind": "skid_steer_slip", "wheel_radius": 0.05, "track": 0.2, "estimate": ["track"]}
        models = estimate(self.LOGS, models=[slip]).comparison.models
        assert all(one.fit.correlated is not None for one in models)
        assert models[0].likelihood.each.sum() > models[1].likelihood.each.sum()


@pytest.mark.parametrize(
    ("keys", "quantities", "message"),
    [
        (
            {"noise": "correlated", "loss": "huber"},
            POSITIONS,
            "calibration.loss: correlated noise takes every",
        ),
        ({"method": "gls", "loss": "huber"}, POSITIONS, "calibration.loss: correlated noise takes every"),
        ({"noise": "correlated"}, ("heading",), "the logs hold heading; use noise: estimated"),
        ({"noise": "correlated", "method": "gls"}, XYH, "gls has a noise of its own between windows"),
        ({"noise": "correlated", "method": "two_stage"}, XYH, "two_stage has a noise of its own"),
    ],
)
def test_what_correlated_noise_does_not_suit(keys: dict, quantities: tuple[str, ...], message: str):
    log = log_of(course(seconds=12.0), noise=NOISE, quantities=quantities)
    with pytest.raises(ProblemError, match=re.escape(message)):
        estimate([log], segment="log", **keys)


@pytest.mark.slow
def test_standard_errors_allow_for_the_correlation():
    errors, covariances = [], []
    for seed in range(6):
        logs = [satellites(10 * seed + number) for number in range(2)]
        found = estimate(logs, segment="log", noise="correlated")
        errors.append(found.values - TRUE)
        covariances.append(found.covariance * (found.covariances[0].half_width / 1.96) ** 2)
    require_pulls(np.array(errors), covariances)
    reach = 1.96 * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    assert np.mean(np.abs(errors) < reach) > 0.88

"""Statistical tests of a promised covariance: right ones pass, wrong ones do not."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from builders import check_all
from scipy import stats

from oed.simulation.checks import (
    Check,
    Tally,
    bias,
    coverage,
    extreme_eigenvalues,
    holm,
    likelihood_ratio,
    mean_nees,
    nees_distribution,
)

ALPHA = 0.05
SEEDS = 120
NAMES = ("bias", "covariance", "NEES", "eigenvalues", "coverage", "distribution")


def draw(seed: int, count: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Normal errors (count, size) and the covariance they were drawn from."""
    rng = np.random.default_rng([seed, size])
    root = rng.normal(size=(size, size)) + 2 * np.eye(size)
    covariance = root @ root.T * 1e-4
    return rng.standard_normal((count, size)) @ root.T * 1e-2, covariance


@cache
def right_ones() -> tuple[tuple[Check, ...], ...]:
    """The checks of a right covariance, R = 500, p = 2, for every seed."""
    return tuple(check_all(*draw(seed, 500, 2), ALPHA) for seed in range(SEEDS))


class TestRightCovariance:
    @pytest.mark.slow
    def test_names(self):
        assert tuple(check.name for check in right_ones()[0]) == NAMES

    @pytest.mark.slow
    def test_joint_rejections_are_rare_enough(self):
        rejected = sum(not all(check.passed for check in checks) for checks in right_ones())
        assert rejected / SEEDS <= ALPHA + 3 * math.sqrt(ALPHA * (1 - ALPHA) / SEEDS)

    @pytest.mark.slow
    @pytest.mark.parametrize("name", NAMES)
    def test_each_alone_rejects_rarely_enough(self, name: str):
        values = np.array(
            [check.p_value for checks in right_ones() for check in checks if check.name == name]
        )
        assert np.mean(values <= ALPHA) <= ALPHA + 3 * math.sqrt(ALPHA * (1 - ALPHA) / SEEDS)

    @pytest.mark.parametrize("name", ["bias", "covariance", "NEES", "distribution"])
    @pytest.mark.slow
    def test_exact_tests_have_uniform_p_values(self, name: str):
        values = [check.p_value for checks in right_ones() for check in checks if check.name == name]
        assert stats.kstest(values, "uniform").pvalue > 1e-3

    @pytest.mark.parametrize("name", NAMES[:5])
    @pytest.mark.slow
    def test_outside_the_expected_range_means_a_small_p_value(self, name: str):
        for checks in right_ones():
            (check,) = [one for one in checks if one.name == name]
            low, high = check.expected
            if check.p_value <= ALPHA * (1 - 1e-9):
                assert not low < check.statistic < high
            elif check.p_value > 1.2 * ALPHA:
                assert low <= check.statistic <= high

    @pytest.mark.parametrize("size", [1, 2, 4, 6])
    def test_any_number_of_parameters(self, size: int):
        checks = check_all(*draw(1, 1000, size), 0.001)
        assert all(check.passed for check in checks)


def errors(seed: int = 0, count: int = 4000, size: int = 4) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((count, size))


def tally(rows: np.ndarray) -> Tally:
    """Of errors that are promised to be independent, of variance one."""
    return Tally.of(rows, np.eye(rows.shape[1]))


class TestWrongCovariance:
    """Every test sees what it is there to see."""

    def test_bias(self):
        shift = np.array([0.1, 0, 0, 0])
        assert bias(tally(errors()), 0.01).p_value > 0.01
        assert bias(tally(errors() + shift), 0.01).p_value < 1e-4
        assert bias(tally(errors() + shift), 0.01).statistic > bias(tally(errors() + shift), 0.01).expected[1]

    def test_shape(self):
        mixed = errors()
        mixed[:, 1] = 0.2 * mixed[:, 0] + math.sqrt(0.96) * mixed[:, 1]
        assert likelihood_ratio(tally(mixed), 0.01).p_value < 1e-4
        # The size is right, so the mean squared error cannot tell.
        assert mean_nees(tally(mixed), 0.01).p_value > 0.01

    def test_size(self):
        assert mean_nees(tally(errors()), 0.01).p_value > 0.01
        for factor in (0.95, 1.05):
            assert mean_nees(tally(math.sqrt(factor) * errors()), 0.01).p_value < 0.002

    def test_one_direction(self):
        stretched = errors() * [1, 1, 1, 1.2]
        check = extreme_eigenvalues(tally(stretched), 0.01)
        assert check.p_value < 0.01
        assert check.statistic == pytest.approx(1.44, rel=0.06)
        assert not check.expected[0] < check.statistic < check.expected[1]

    def test_coverage(self):
        assert coverage(tally(errors()), 0.01).p_value > 0.01
        check = coverage(tally(math.sqrt(1.15) * errors()), 0.01)
        assert check.p_value < 1e-3
        assert check.statistic < check.expected[0] < 0.95 < check.expected[1]

    def test_heavy_tails(self):
        rng = np.random.default_rng(0)
        heavy = rng.standard_t(4, (4000, 4)) / math.sqrt(2)
        assert nees_distribution(tally(heavy), 0.01).p_value < 1e-6
        assert nees_distribution(tally(errors()), 0.01).p_value > 0.01

    @pytest.mark.parametrize("factor", [0.95, 1.05], ids=["5 % too small", "5 % too large"])
    @pytest.mark.slow
    def test_five_per_cent_are_noticed(self, factor: float):
        noticed = 0
        for seed in range(12):
            sample, covariance = draw(seed, 4000, 4)
            assert all(check.passed for check in check_all(sample, covariance, 0.001))
            noticed += not all(check.passed for check in check_all(sample, factor * covariance, 0.01))
        assert noticed >= 9


class TestFormulas:
    """Statistics of a small sample, by hand."""

    sample = np.array([[1.0, 0.0], [0.0, 2.0], [-1.0, 0.0], [0.0, -1.0]])

    def test_bias(self):
        assert bias(tally(self.sample), 0.05).statistic == pytest.approx(4 * 0.25**2)
        assert bias(tally(self.sample), 0.05).expected == (0, pytest.approx(5.9915, abs=1e-4))

    def test_likelihood_ratio(self):
        # S = diag(2/3, 19/12): u = 3 (tr S - ln det S - 2), corrected by 1 - (5 - 2/3) / 17.
        raw = 3 * (2 / 3 + 19 / 12 - math.log(2 / 3 * 19 / 12) - 2)
        corrected = raw * (1 - (5 - 2 / 3) / 17)
        check = likelihood_ratio(tally(self.sample), 0.05)
        assert check.statistic == pytest.approx(corrected)
        assert check.p_value == pytest.approx(stats.chi2.sf(corrected, 3))

    def test_mean_nees(self):
        check = mean_nees(tally(self.sample), 0.05)
        assert check.statistic == pytest.approx(7 / 8)
        assert check.expected == pytest.approx(stats.chi2.ppf([0.025, 0.975], 8) / 8)

    def test_eigenvalues(self):
        check = extreme_eigenvalues(tally(self.sample), 0.05)
        assert check.statistic == pytest.approx(19 / 12)
        reach = (math.sqrt(2) + math.sqrt(2 * math.log(40))) / math.sqrt(3)
        assert check.expected == (0.0, pytest.approx((1 + reach) ** 2))

    def test_whitening(self):
        covariance = np.array([[4.0, 0.0], [0.0, 9.0]])
        scaled = check_all(self.sample * [2, 3], covariance, 0.05)
        plain = check_all(self.sample, np.eye(2), 0.05)
        for first, second in zip(scaled, plain, strict=True):
            assert first.statistic == pytest.approx(second.statistic)

    def test_correlated_errors_are_whitened(self):
        sample, covariance = draw(3, 500, 3)
        turned = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
        first = check_all(sample, covariance, 0.05)
        second = check_all(sample @ turned.T, turned @ covariance @ turned.T, 0.05)
        for one, other in zip(first, second, strict=True):
            assert one.statistic == pytest.approx(other.statistic, rel=1e-8)


def named(p_values) -> list[Check]:
    return [Check(str(index), "", 0.0, (0, 1), value) for index, value in enumerate(p_values)]


class TestHolm:
    @pytest.mark.parametrize(
        ("p_values", "failed"),
        [
            # 0.005 <= 0.05 / 4 and 0.01 <= 0.05 / 3 fail; 0.03 > 0.05 / 2 ends it.
            ((0.01, 0.04, 0.03, 0.005), {0, 3}),
            ((0.013, 0.04, 0.03, 0.02), set()),
            ((0.0125, 0.05 / 3, 0.025, 0.05), {0, 1, 2, 3}),
            ((0.9, 0.8), set()),
            ((0.04,), {0}),
            ((0.06,), set()),
            # The smallest passes, so all do.
            ((0.02, 0.02, 0.02), set()),
            ((0.0, 1.0, 1.0), {0}),
        ],
    )
    def test_by_hand(self, p_values, failed: set[int]):
        checks = holm(named(p_values), 0.05)
        assert [check.name for check in checks] == [str(index) for index in range(len(p_values))]
        assert {index for index, check in enumerate(checks) if not check.passed} == failed

    def test_nothing_else_is_changed(self):
        before = named((0.001, 0.5))
        for old, new in zip(before, holm(before, 0.05), strict=True):
            assert (old.statistic, old.p_value, old.expected) == (new.statistic, new.p_value, new.expected)

"""Grids with times at which nothing is read, or only some quantities are."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest
import scipy
from simulated import fit_of, search_of, several
from windowed import gls, windows_of

from oed.estimation.assessment.diagnostics import correlations, diagnostics
from oed.estimation.assessment.likelihood import FittedReadings
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gls import WeightedWindows
from oed.estimation.methods.joint import JointSearch
from oed.estimation.methods.two_stage import TwoStage
from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.setup.options import CalibrationOptions
from oed.estimation.setup.unknowns import Knowledge

NONSENSE = 1e3
"""Stands where nothing is read."""
LOGS = several(2, seconds=6.0, noise=(0.004, 0.01), per_yaw_rate=(0.004, 0.02))


def finer(layout: SegmentLayout) -> SegmentLayout:
    """The same readings on a grid with a time between any two."""
    count, length, quantities = layout.readings.shape
    times = np.zeros((count, 2 * length - 1))
    times[:, ::2], times[:, 1::2] = layout.times, (layout.times[:, 1:] + layout.times[:, :-1]) / 2
    readings = np.full((*times.shape, quantities), NONSENSE)
    valid = np.zeros(readings.shape, dtype=bool)
    readings[:, ::2], valid[:, ::2] = layout.readings, layout.valid
    return replace(layout, times=times, readings=readings, valid=valid)


def on_finer(search: JointSearch) -> JointSearch:
    return replace(search, layout=finer(search.layout))


def same(one: Fit, other: Fit) -> None:
    """Whether two fits say the same of the same readings."""
    np.testing.assert_allclose(other.values, one.values, rtol=1e-9)
    np.testing.assert_allclose(other.information, one.information, rtol=1e-6, atol=1e-6 * one.total.max())
    for name in ("residuals", "white", "redundancy"):
        own, wanted = getattr(other, name)[other.layout.valid], getattr(one, name)[one.layout.valid]
        np.testing.assert_allclose(own, wanted, rtol=1e-6, atol=1e-9)


class TestTimesWithoutReadings:
    @pytest.mark.slow
    @pytest.mark.parametrize("keys", [{"grows": True}, {"loss": "huber"}])
    def test_change_no_joint_fit(self, keys: dict):
        search = search_of(LOGS, seconds=2.0, **keys)
        one, other = search.fit(), on_finer(search).fit()
        same(one, other)
        for name, noise in one.noises.items():
            assert asdict(other.noises[name]) == pytest.approx(asdict(noise), rel=1e-6)
        for places in ([0, 1], [2]):
            (values, pairs), (wanted, count) = correlations(other, places), correlations(one, places)
            assert values == pytest.approx(wanted, abs=1e-9)
            assert pairs == count
        found, wanted = (
            FittedReadings.of([fit]).likelihood(fit, CalibrationOptions()).each for fit in (other, one)
        )
        assert found == pytest.approx(wanted, rel=1e-9)
        for test, before in zip(*(diagnostics(fit, one.noises) for fit in (other, one)), strict=True):
            assert test.statistic == pytest.approx(before.statistic, rel=1e-6)

    @pytest.mark.slow
    def test_change_no_fit_of_windows(self):
        windows = windows_of(LOGS, seconds=1.0)
        other = replace(windows, layout=finer(windows.layout))
        nothing = Knowledge.nothing(windows.unknowns.size)
        same(*(TwoStage(one, nothing).fit() for one in (windows, other)))
        # Drift is added up over the steps of the grid.
        one, found = gls(LOGS, seconds=1.0), WeightedWindows(other, nothing).fit()
        assert found.values == pytest.approx(one.values, rel=1e-3)


class TestQuantitiesReadNowAndThen:
    def test_count_where_they_are(self):
        search = search_of(LOGS, specified=fit_of(LOGS).noises)
        valid = search.layout.valid.copy()
        valid[:, 1:, 2] &= np.arange(1, valid.shape[1]) % 5 == 0
        valid[:, 3::4, :2] = False
        readings = np.where(valid, search.layout.readings, NONSENSE)
        search = replace(search, layout=replace(search.layout, valid=valid, readings=readings))
        fit = search.fit()
        assert fit.redundancy.sum() == pytest.approx(valid.sum() - 3 * len(LOGS) - 3, abs=1e-6)

        def left(unknowns: np.ndarray) -> np.ndarray:
            starts = unknowns[3:].reshape(-1, 3)
            predicted = search._predicted(unknowns[:3], starts)
            position, heading = (
                fit.noises[name].deviation(fit.speeds, fit.yaw_rates) for name in ("position", "heading")
            )
            return ((readings - predicted) / np.stack([position, position, heading], axis=-1))[valid]

        begin = np.concatenate([fit.values, fit.starts.ravel()])
        found = scipy.optimize.least_squares(left, begin, x_scale="jac", xtol=1e-12, ftol=1e-14)
        errors = np.sqrt(np.diag(fit.inverse))
        assert np.all(np.abs(found.x[:3] - fit.values) < 0.01 * errors)
        wanted = np.linalg.inv(found.jac.T @ found.jac)[:3, :3]
        assert fit.inverse == pytest.approx(wanted, rel=0.01, abs=1e-3 * wanted.max())

    def test_that_are_never_read_at_first_begin_with_what_is(self):
        search = search_of(LOGS)
        valid = search.layout.valid.copy()
        valid[:, :3, 2] = False
        layout = replace(search.layout, valid=valid)
        assert layout.first_readings(2) == pytest.approx(layout.readings[:, 3, 2])
        valid = valid.copy()
        valid[0, :, 2] = False
        assert replace(layout, valid=valid).first_readings(2)[0] == 0

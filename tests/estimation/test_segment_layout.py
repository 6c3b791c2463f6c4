"""How logs are cut: nothing across a gap, nothing lost, nothing from outside of the inputs' span."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulated import ROBOT, XYH, course, log_of, search_of, several

from oed.estimation.prediction.layout import SegmentLayout, cut, stretches
from oed.logs.log import Log

DRIVE = course(seconds=12.0)
LOG = log_of(DRIVE)


def without(log: Log, first: float, last: float) -> Log:
    """The same without poses between two times."""
    kept = (log.pose_times < first) | (log.pose_times > last)
    return replace(log, pose_times=log.pose_times[kept], poses=log.poses[kept])


def parts(layout: SegmentLayout) -> list[np.ndarray]:
    """Times of each segment."""
    return [times[valid] for times, valid in zip(layout.times, layout.valid.any(axis=-1), strict=True)]


def ends(layout: SegmentLayout) -> np.ndarray:
    """When each segment begins and ends."""
    return np.array([(part[0], part[-1]) for part in parts(layout)])


class TestSegments:
    @given(seconds=st.floats(0.05, 30.0), seed=st.integers(0, 10**6), offset=st.floats(-2.0, 2.0))
    def test_share_their_edges_and_hold_all_motion(self, seconds: float, seed: int, offset: float):
        rng = np.random.default_rng(seed)
        rows = np.cumsum(rng.integers(1, 4, 40))
        log = log_of(DRIVE, rows=rows)
        layout = cut([log], seconds, [offset])
        pieces = parts(layout)
        assert all(len(piece) > 1 for piece in pieces)
        (inside,) = stretches(log, offset)
        times = log.pose_times[inside]
        assert np.array_equal(np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])]), times)
        moved = (layout.inputs(np.array([offset])) * layout.steps[..., None]).sum(axis=(0, 1))
        turned = np.diff(log.integrals_at(times[[0, -1]], offset), axis=0)[0]
        assert moved == pytest.approx(turned, abs=1e-9)

    @given(seconds=st.floats(0.05, 30.0))
    def test_are_of_nearly_equal_length(self, seconds: float):
        layout = cut([LOG], seconds, [0.0])
        lengths = layout.times[:, -1] - layout.times[:, 0]
        assert len(lengths) == min(max(1, round(12 / seconds)), 120)
        assert np.ptp(lengths) <= 0.2 + 1e-9

    def test_hold_the_readings_of_their_times(self):
        logs = several(2, noise=(0.01, 0.01))
        layout = cut(logs, 3.0, [0.0, 0.0])
        for row, own in enumerate(layout.owner):
            kept = layout.valid[row].all(axis=-1)
            places = np.searchsorted(logs[own].pose_times, layout.times[row][kept])
            assert np.array_equal(layout.readings[row][kept], logs[own].poses[places])
        beyond = ~layout.valid[:, 1:].any(axis=-1)
        assert np.all(layout.steps[beyond] == 0)
        assert np.all(layout.inputs(np.zeros(2))[beyond] == 0)

    def test_of_unequal_logs_are_padded(self):
        logs = [log_of(course(seconds=seconds, seed=3), name=str(seconds)) for seconds in (3.0, 7.0)]
        layout = cut(logs, np.inf, [0.0, 0.0])
        assert layout.valid.sum(axis=1).tolist() == [[31] * 3, [71] * 3]
        assert layout.periods == 70
        assert layout.steps[0].sum() == pytest.approx(3.0)


class TestGaps:
    def test_of_the_poses_are_not_bridged(self):
        log = without(LOG, 4.05, 6.05)
        assert ends(cut([log], np.inf, [0.0])) == pytest.approx(np.array([[0.0, 4.0], [6.1, 12.0]]))
        pieces = parts(cut([log], 2.0, [0.0]))
        assert len(pieces) == 5
        assert max(np.diff(piece).max() for piece in pieces) == pytest.approx(0.1)

    @pytest.mark.parametrize("offset", [0.0, 0.5])
    def test_of_the_inputs_are_not_bridged(self, offset: float):
        kept = (DRIVE.times < 4.05) | (DRIVE.times > 6.05)
        log = replace(LOG, input_times=LOG.input_times[kept] + offset, integrals=LOG.integrals[kept])
        assert ends(cut([log], np.inf, [offset])) == pytest.approx(np.array([[0.0, 4.0], [6.1, 12.0]]))

    def test_poses_alone_in_the_middle_of_gaps_are_left_out(self):
        log = without(without(LOG, 4.05, 5.05), 5.15, 6.05)
        assert ends(cut([log], np.inf, [0.0])) == pytest.approx(np.array([[0.0, 4.0], [6.1, 12.0]]))

    def test_uneven_times_are_no_gaps(self):
        rng = np.random.default_rng(0)
        log = log_of(DRIVE, rows=np.cumsum(np.concatenate([[0], rng.integers(1, 5, 40)])))
        assert len(stretches(log, 0.0)) == 1

    def test_slow_poses_are_no_gaps_of_fast_inputs(self):
        assert len(stretches(log_of(DRIVE, every=20), 0.0)) == 1


class TestSpans:
    @pytest.mark.parametrize(
        ("offset", "first", "last"), [(0.0, 0.0, 12.0), (2.05, 0.0, 9.9), (-3.0, 3.0, 12.0)]
    )
    def test_poses_without_wheels_are_left_out(self, offset: float, first: float, last: float):
        # The clocks agree; the offset is what they are taken to be apart.
        (piece,) = parts(cut([LOG], np.inf, [offset]))
        assert (piece[0], piece[-1]) == pytest.approx((first, last))

    def test_clocks_that_never_meet(self):
        assert stretches(LOG, 50.0) == []
        assert stretches(LOG, 12.0) == []

    def test_two_poses_are_enough(self):
        assert len(stretches(log_of(DRIVE, rows=np.array([0, 100])), 0.0)) == 1


class TestClocks:
    def test_logs_of_one_file_share_one(self):
        one, other = several(2, file="both.csv")
        third = log_of(DRIVE, name="third")
        layout = cut([one, third, other], np.inf, [0.0] * 3)
        assert layout.clocks == ("both.csv", "third.csv")
        assert layout.clock.tolist() == [0, 1, 0]

    def test_inputs_are_read_at_the_clock_of_their_log(self):
        logs = [log_of(DRIVE, offset=0.3, name="late"), log_of(DRIVE, name="same")]
        layout = cut(logs, np.inf, [0.3, 0.0])
        late, same = layout.inputs(np.array([0.3, 0.0]))
        assert late == pytest.approx(same, abs=1e-9)
        assert same == pytest.approx(DRIVE.inputs, abs=1e-9)


def test_a_search_sees_the_layouts_quantities():
    search = search_of([log_of(DRIVE)])
    assert search.layout.quantities == XYH
    assert search.unknowns.robot is ROBOT

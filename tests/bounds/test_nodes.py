"""The search for a bound ends by its nodes, never by the clock."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from builders import problem_of

from oed.bounds import bound, speed_lattice
from oed.bounds.lattice_program import LatticeProgram, SpeedLimits
from oed.bounds.speed_lattice import lattice_bound, usual_planes
from oed.kernel.problem import Problem
from oed.robots.limits import WheelAcceleration, WheelSpeed
from oed.robots.sensors import Displacements
from oed.robots.space import DesignSpace

NOTHING = np.zeros((2, 2))
HARD = SpeedLimits(12, np.array([[-3.0, 8.0], [-3.0, 8.0]]), 1.1, 0.55)
"""Limits of which some seconds do not close the gap."""


def sampled() -> Problem:
    return problem_of(
        design=DesignSpace(duration=2, samples=20),
        measurement=Displacements(segments="samples"),
        limits=(WheelSpeed(bounds=(-3, 8)), WheelAcceleration(bounds=11)),
    )


@pytest.mark.slow
def test_a_slow_machine_gives_the_same_certificate(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(speed_lattice, "WORK", 1e8)
    quick = bound(sampled())
    hours = itertools.count(0.0, 3600.0)
    monkeypatch.setattr("time.perf_counter", lambda: next(hours))
    slow = bound(sampled())
    assert not quick.complete
    assert quick.nodes > 3
    for one, other in ((slow, quick), (slow.widened, quick.widened)):
        assert (one.upper_bound, one.nodes, one.method) == (other.upper_bound, other.nodes, other.method)
    np.testing.assert_array_equal(slow.drive.coefficients, quick.drive.coefficients)


@pytest.mark.slow
def test_nodes_end_a_search_and_more_of_them_lower_the_bound():
    found = [lattice_bound(HARD, np.ones(2), NOTHING, nodes=nodes) for nodes in (1, 6, 20)]
    # A branching makes up to four at a time.
    assert [one.nodes for one in found] == [1, pytest.approx(7, abs=2), pytest.approx(21, abs=2)]
    assert not any(one.complete for one in found)
    assert found[0].upper > found[1].upper > found[2].upper > found[2].lower


def test_finer_lattices_get_fewer_planes():
    both = np.array([[-10.0, 10.0]] * 2)
    coarse, fine = (
        usual_planes(LatticeProgram(SpeedLimits(100, both, step, step / 2), np.ones(2)))
        for step in (2.0, 0.2)
    )
    assert 1 <= fine < coarse / 3


@pytest.mark.slow
def test_a_bound_of_slightly_wider_limits_by_the_same_parts():
    """Sound, hardly looser than a search of its own, also where only the narrower limits are symmetric."""
    for pair in ((-10.0, 10.0), (-3.0, 8.0)):
        own = SpeedLimits(12, np.array([pair, pair]), 2.0, 1.0)
        more = np.array([[-0.01, 0.02], [-0.01, 0.01]])
        wider = SpeedLimits(12, own.bounds + more, 2.003, 1.01)
        found = lattice_bound(own, np.ones(2), NOTHING, nodes=4)
        again = lattice_bound(wider, np.ones(2), NOTHING, nodes=4)
        value = found.bound_for(wider, np.ones(2), NOTHING)
        assert again.lower <= value <= 1.02 * again.upper
        assert value >= found.lower


@pytest.mark.slow
def test_the_certificate_states_its_nodes():
    certificate = bound(sampled(), nodes=5)
    assert 5 <= certificate.nodes <= 8
    assert not certificate.complete
    assert f"{certificate.nodes} nodes" in certificate.method


@pytest.mark.slow
def test_a_bound_has_a_multiplier_only_where_one_proves_it():
    """After branching each part of all speeds has its own."""
    root, branched = (bound(sampled(), nodes=nodes) for nodes in (1, 20))
    assert root.upper_bound > branched.upper_bound
    assert np.trace(root.multiplier) == pytest.approx(1)
    assert branched.multiplier is None

"""Knowledge from before the drive: how it may be given, and the information it amounts to."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oed.foundation.errors import PartError
from oed.kernel.measurement.prior import Prior

NAMES = ("wheel_radius", "track", "slip")
NOMINAL, UNITS = np.array([0.05, -0.2, 0.1]), ("m", "m", "")
COVARIANCE = ((4e-6, 1e-6), (1e-6, 9e-6))


def precision(prior: Prior) -> np.ndarray:
    return prior.precision(NAMES, NOMINAL, UNITS)


def issues(prior: Prior) -> dict[str, str]:
    return {".".join(map(str, issue.key)): issue.message for issue in prior.issues(NAMES, NOMINAL, UNITS)}


class TestStandardDeviations:
    @pytest.mark.parametrize(
        ("name", "given", "size"),
        [
            ("wheel_radius", "1 mm", 1e-3),
            ("wheel_radius", 0.002, 0.002),
            ("wheel_radius", "0.002", 0.002),
            ("wheel_radius", "2 %", 0.001),
            ("wheel_radius", " 2% ", 0.001),
            ("track", "1 cm", 0.01),
            ("track", "5 %", 0.01),
            ("slip", 0.02, 0.02),
            ("slip", "10 %", 0.01),
        ],
    )
    def test_with_a_unit_or_as_a_share_of_the_nominal_value(self, name: str, given, size: float):
        prior = Prior(standard_deviations={name: given})
        expected = np.diag([size**-2 if name == other else 0.0 for other in NAMES])
        assert prior.names == (name,)
        assert issues(prior) == {}
        np.testing.assert_allclose(precision(prior), expected, rtol=1e-12)

    def test_several_are_independent(self):
        prior = Prior(standard_deviations={"slip": 0.5, "wheel_radius": "1 mm"})
        np.testing.assert_allclose(precision(prior), np.diag([1e6, 0, 4]), rtol=1e-12)

    @given(order=st.permutations(range(3)))
    def test_rows_follow_the_parameters_asked_for(self, order: list[int]):
        prior = Prior(standard_deviations={"track": "1 cm", "slip": "10 %"})
        found = prior.precision([NAMES[i] for i in order], NOMINAL[order], [UNITS[i] for i in order])
        np.testing.assert_allclose(found, precision(prior)[np.ix_(order, order)], rtol=1e-12)

    @pytest.mark.parametrize(
        ("name", "given", "words"),
        [
            ("track", "1 kg", "expected a length [m], got '1 kg'"),
            ("track", "1 deg", "expected a length [m]"),
            ("track", "wide", "does not begin with a number"),
            ("track", "1 smoot", "'smoot' is not known"),
            ("track", "-1 mm", "expected a positive standard deviation, got '-1 mm'"),
            ("track", "-2 %", "expected a positive standard deviation, got '-2 %'"),
            ("track", 0, "expected a positive standard deviation, got 0"),
            ("track", -0.1, "expected a positive standard deviation, got -0.1"),
            ("track", float("nan"), "finite"),
            ("track", float("inf"), "finite"),
            ("slip", "1 mm", "expected a plain number or a percentage"),
            ("width", "1 mm", "width is not estimated here; the parameters are wheel_radius, track, slip"),
        ],
    )
    def test_wrong_ones_are_named(self, name: str, given, words: str):
        found = issues(Prior(standard_deviations={"wheel_radius": "1 mm", name: given}))
        assert list(found) == [f"prior.standard_deviations.{name}"]
        assert words in found[f"prior.standard_deviations.{name}"]

    def test_all_wrong_ones_are_listed(self):
        prior = Prior(standard_deviations={"track": "1 kg", "slip": -1, "width": 1})
        assert set(issues(prior)) == {
            f"prior.standard_deviations.{name}" for name in ("track", "slip", "width")
        }


class TestCovariance:
    def test_it_is_inverted(self):
        prior = Prior(parameters=("wheel_radius", "track"), covariance=COVARIANCE)
        found = precision(prior)
        assert prior.names == ("wheel_radius", "track")
        assert issues(prior) == {}
        np.testing.assert_allclose(found[:2, :2] @ COVARIANCE, np.eye(2), atol=1e-12)
        assert not found[2].any()
        assert not found[:, 2].any()

    def test_its_order_is_that_of_its_names(self):
        turned = tuple(row[::-1] for row in COVARIANCE[::-1])
        first = Prior(parameters=("slip", "wheel_radius"), covariance=COVARIANCE)
        second = Prior(parameters=("wheel_radius", "slip"), covariance=turned)
        np.testing.assert_allclose(precision(first), precision(second), rtol=1e-12)
        assert precision(first)[2, 2] > precision(first)[0, 0]

    def test_a_diagonal_one_is_standard_deviations(self):
        one = Prior(parameters=("track", "slip"), covariance=((1e-4, 0), (0, 0.04)))
        other = Prior(standard_deviations={"track": "1 cm", "slip": 0.2})
        np.testing.assert_allclose(precision(one), precision(other), rtol=1e-12)

    def test_a_parameter_that_is_not_estimated_is_named(self):
        found = issues(Prior(parameters=("track", "width"), covariance=COVARIANCE))
        assert list(found) == ["prior.parameters"]
        assert "width is not estimated here" in found["prior.parameters"]

    @pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
    def test_its_units_may_be_far_apart(self, scale: float):
        matrix = np.array([[1.0, 0.3], [0.3, 1.0]]) * np.outer([1.0, scale], [1.0, scale])
        prior = Prior(parameters=("track", "slip"), covariance=matrix.tolist())
        found = precision(prior)[1:, 1:] * np.outer([1.0, scale], [1.0, scale])
        np.testing.assert_allclose(found, np.linalg.inv([[1.0, 0.3], [0.3, 1.0]]), rtol=1e-9)

    @pytest.mark.parametrize(
        ("covariance", "words"),
        [
            (((1.0,),), "expected a 2 x 2 covariance for 2 parameters"),
            (((1.0, 0.0),), "expected a 2 x 2 covariance"),
            (((1.0, 0.0), (0.0,)), "expected a 2 x 2 covariance"),
            (np.eye(3).tolist(), "expected a 2 x 2 covariance"),
            (((1.0, 0.5), (0.4, 1.0)), "symmetric, positive definite"),
            (((1e-12, 5e-13), (4e-13, 1e-12)), "symmetric, positive definite"),
            (((1.0, 2.0), (2.0, 1.0)), "symmetric, positive definite"),
            (((1.0, 1.0), (1.0, 1.0)), "symmetric, positive definite"),
            (((1.0, 0.0), (0.0, 0.0)), "symmetric, positive definite"),
            (((1.0, 0.0), (0.0, -1.0)), "symmetric, positive definite"),
            (((-1.0, 0.0), (0.0, -1.0)), "symmetric, positive definite"),
            (((float("nan"), 0.0), (0.0, 1.0)), "symmetric, positive definite"),
            ((("wide", 0.0), (0.0, 1.0)), "covariance"),
        ],
    )
    def test_what_is_no_covariance_is_refused(self, covariance, words: str):
        with pytest.raises(PartError, match=words):
            Prior(parameters=("track", "slip"), covariance=covariance)


@pytest.mark.parametrize(
    "both_or_neither",
    [
        {},
        {"parameters": ("track",)},
        {"standard_deviations": {}},
        {"standard_deviations": {"track": 1}, "parameters": ("track",), "covariance": ((1.0,),)},
    ],
)
def test_there_is_one_way_to_give_it(both_or_neither):
    with pytest.raises(PartError, match="either standard_deviations, or parameters and their covariance"):
        Prior(**both_or_neither)


@pytest.mark.parametrize(
    "wrong",
    [{"covariance": ((1.0,),)}, {"deviations": {"track": 1}}, {"standard_deviations": {"track": [1]}}],
)
def test_wrong_keys_and_values_are_refused(wrong):
    with pytest.raises(PartError):
        Prior(**wrong)


def test_names_belong_to_a_covariance():
    with pytest.raises(PartError, match="parameters name the rows of a covariance"):
        Prior(standard_deviations={"track": 1}, parameters=("slip",))


def test_a_parameter_listed_twice_is_refused():
    with pytest.raises(PartError, match="twice"):
        Prior(parameters=("track", "track"), covariance=COVARIANCE)


def test_infinite_variances_are_refused():
    with pytest.raises(PartError, match="covariance"):
        Prior(parameters=("track",), covariance=((float("inf"),),))

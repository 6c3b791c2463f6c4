"""Information matrices: the three scalings, and what keeps one from being applied."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oed.foundation.errors import Issue
from oed.kernel.measurement.information import Estimation, Scaling, scaling_issues
from oed.robots.sensors import Block, regression

DESIGN = np.array([[1.0, 2.0], [0.5, -1.0], [3.0, 0.25]])


def make_block(**overrides) -> Block:
    parts = {
        "name": "position",
        "design_matrix": ca.DM(DESIGN),
        "parameters": ("c21", "c22"),
        "nominal": np.array([0.02, -0.05]),
        "units": ("m", "m"),
        "noise": 0.1,
    }
    return regression(**{**parts, **overrides})


def estimation(block: Block, scaling: Scaling) -> Estimation:
    return Estimation(block, block.parameters, block.parameters, scaling, None)


def information(block: Block, scaling: Scaling) -> np.ndarray:
    return np.array(estimation(block, scaling).matrix)


def issues_of(scaling: Scaling, *blocks: Block) -> list[Issue]:
    return list(scaling_issues([(block, block.parameters) for block in blocks], scaling))


@pytest.mark.parametrize(
    ("scaling", "scales"),
    [
        ("none", [1.0, 1.0]),
        ("relative", [0.02, 0.05]),
        ({"c21": 3.0, "c22": 0.5}, [3.0, 0.5]),
        ({"c22": 0.5, "c21": 3.0}, [3.0, 0.5]),
    ],
)
def test_scaled_information(scaling, scales):
    scaled = DESIGN * scales if scaling == "none" else DESIGN * scales / make_block().noise
    np.testing.assert_allclose(information(make_block(), scaling), scaled.T @ scaled, rtol=1e-14)
    np.testing.assert_allclose(estimation(make_block(), scaling).scales, scales, rtol=1e-15)


def test_raw_information_needs_no_noise():
    block = make_block(noise=None)
    np.testing.assert_allclose(information(block, "none"), DESIGN.T @ DESIGN, rtol=1e-15)
    assert issues_of("none", block) == []


def test_relative_scaling_gives_the_worst_relative_standard_deviation():
    block = make_block()
    covariance = block.noise**2 * np.linalg.inv(DESIGN.T @ DESIGN)
    relative = covariance / np.outer(block.nominal, block.nominal)
    smallest = np.linalg.eigvalsh(information(block, "relative"))[0]
    assert smallest**-0.5 == pytest.approx(np.sqrt(np.linalg.eigvalsh(relative)[-1]), rel=1e-12)


@given(factor=st.floats(0.01, 100))
def test_relative_information_does_not_depend_on_the_units_of_parameters(factor: float):
    # Parameters in other units: nominal values grow, columns of W shrink.
    other = make_block(design_matrix=ca.DM(DESIGN / factor), nominal=make_block().nominal * factor)
    found, expected = (information(block, "relative") for block in (other, make_block()))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@given(factor=st.floats(0.01, 100), scaling=st.sampled_from(["relative", "user"]))
def test_noise_divides_the_information(factor: float, scaling: str):
    chosen = {"c21": 1.0, "c22": 2.0} if scaling == "user" else scaling
    louder = information(make_block(noise=0.1 * factor), chosen)
    expected = information(make_block(), chosen) / factor**2
    np.testing.assert_allclose(louder, expected, rtol=1e-12)


@pytest.mark.parametrize("scaling", ["relative", {"c21": 1.0, "c22": 1.0}])
def test_missing_noise_is_an_issue(scaling):
    (issue,) = issues_of(scaling, make_block(noise=None))
    assert issue.key == ("measurement", "noise")
    assert "position noise is needed" in issue.message


def test_every_block_without_noise_is_named():
    blocks = (make_block(noise=None), make_block(name="heading", parameters=("c11", "c12"), noise=None))
    messages = [issue.message for issue in issues_of("relative", *blocks)]
    assert [message.split()[1] for message in messages] == ["position", "heading"]


def test_a_nominal_zero_has_no_relative_precision():
    (issue,) = issues_of("relative", make_block(nominal=np.array([0.0, 0.1])))
    assert issue.key == ("criterion", "scaling")
    assert issue.message.startswith("c21 is nominally 0")
    assert "scaling: {c21: ..., c22: ...}, " in issue.message
    assert issues_of({"c21": 1.0, "c22": 1.0}, make_block(nominal=np.array([0.0, 0.1]))) == []


def test_unknown_and_missing_names_are_issues():
    issues = {issue.key: issue.message for issue in issues_of({"c21": 1.0, "track": 2.0}, make_block())}
    assert issues[("criterion", "scaling")] == "the scale of c22 is missing"
    assert issues[("criterion", "scaling", "track")].endswith("the parameters are c21, c22")
    assert len(issues) == 2

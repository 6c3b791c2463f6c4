"""What a longer drive has more of."""

from __future__ import annotations

import pytest

from oed.workflow.aims import stretch


@pytest.mark.parametrize(("coefficients", "then"), [(16, 29), ("auto", "auto")])
def test_a_longer_drive_has_more_coefficients_unless_the_search_chooses_them(coefficients, then):
    drives = {"duration": 20.0, "samples": 200, "spline": {"degree": 3, "coefficients": coefficients}}
    stretch(drives, 40.0)
    assert drives == {"duration": 40.0, "samples": 400, "spline": {"degree": 3, "coefficients": then}}

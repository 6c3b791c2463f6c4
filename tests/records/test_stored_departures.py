"""How many robots leave, as a record has it and says it."""

from __future__ import annotations

from typing import Any

import pytest

from oed.records.stored.departures import StoredDepartures

RADII = [
    {
        "name": f"wheel_radius_{side}",
        "unit": "m",
        "nominal": 0.05,
        "low": 0.049,
        "high": 0.051,
        "uniform": True,
    }
    for side in ("right", "left")
]
TRACK = {"name": "track", "unit": "m", "nominal": 0.2, "low": 0.192, "high": 0.208, "uniform": True}
RANGES = "with wheel radii ±2 %, track ±4 %"


def departing(share: float = 0.003, distance: float | None = 0.04, **changes: Any) -> StoredDepartures:
    data = {
        "usual": True,
        "robust": False,
        "uncertain": [*RADII, TRACK],
        "limits": ["workspace"],
        "draws": 1000,
        "seed": 0,
        "results": [{"name": "ipopt", "share": share, "interval": [0.0, 1.0], "distance": distance}],
    }
    return StoredDepartures.model_validate({**data, **changes})


def test_robots_ranges_and_distance_are_named():
    expected = f"0.3 % of 1,000 robots {RANGES} leave the workspace, by up to 40 mm in 95 % of these cases."
    assert departing().sentence("ipopt") == expected


def test_no_robot_leaves():
    assert departing(0.0, 0.0).sentence("ipopt") == f"None of 1,000 robots {RANGES} leave the workspace."


@pytest.mark.parametrize(
    ("share", "text"), [(1.0, "All"), (0.997, "99.7 %"), (0.982, "98 %"), (0.0042, "0.42 %")]
)
def test_shares_are_plain_numbers(share: float, text: str):
    assert f"{text} of 1,000 robots" in departing(share).sentence("ipopt")


def test_quantities_of_the_same_range_are_named_together():
    sentence = departing(uncertain=[*RADII, {**TRACK, "low": 0.196, "high": 0.204}]).sentence("ipopt")
    assert "with wheel radii and track ±2 % leave" in sentence


@pytest.mark.parametrize(("share", "warns"), [(0.01, False), (0.011, True), (0.43, True)])
def test_a_warning_is_given_above_1_per_cent(share: float, warns: bool):
    found = departing(share)
    assert found.warns("ipopt") == warns
    assert found.sentence("ipopt").startswith("Warning: ") == warns


@pytest.mark.parametrize(
    ("usual", "robust", "keys"),
    [(True, False, "`uncertainty` and `robust`"), (False, False, "`robust`"), (False, True, "")],
)
def test_a_warning_names_the_keys_that_the_study_lacks(usual: bool, robust: bool, keys: str):
    sentence = departing(0.43, usual=usual, robust=robust).sentence("ipopt")
    assert (f"; add {keys} to the study, or leave" in sentence) == bool(keys)
    assert ("add" in sentence) == bool(keys)


def test_obstacles_are_hit():
    sentence = departing(limits=["workspace", "obstacles"]).sentence("ipopt")
    assert "leave the workspace or hit an obstacle" in sentence


def test_a_path_without_end_has_no_distance():
    assert departing(0.5, None).exported("ipopt")["distance"] is None
    assert "nan" not in departing(0.5, None).sentence("ipopt")


def test_a_range_of_unequal_halves_is_given_by_its_ends():
    sentence = departing(uncertain=[{**TRACK, "low": 0.15, "high": 0.3}]).sentence("ipopt")
    assert "with track 150 mm to 300 mm" in sentence


def test_nothing_is_said_of_a_drive_that_was_not_simulated():
    assert (departing().sentence("circle"), departing().exported("circle")) == ("", None)


def test_exported_data_have_the_drive_the_ranges_and_the_sentence():
    data = departing().exported("ipopt")
    assert (data["share"], data["distance"], data["draws"]) == (0.003, 0.04, 1000)
    assert [quantity["name"] for quantity in data["uncertain"]][-1] == "track"
    assert data["sentence"] == departing().sentence("ipopt")

"""What limits a drive, in words: what looser limits would gain, by how much, and where that is not known."""

from __future__ import annotations

from typing import Any

import pytest
import sample_records
import sample_rooms
from recorded import record_from
from shown_in import column, section

from oed.records.record import Record
from oed.report.sections.limits import Room
from oed.robots.limits import LIMITS

pytestmark = pytest.mark.usefixtures("blank_figures")


def with_gains(record: Record, **gains: float | None) -> Record:
    """A record whose best drive says what looser limits gain per SI unit, of other limits 0."""
    data = record.data
    for margin in data["results"][0]["margins"]:
        if margin["limit"] in LIMITS:
            margin["gain"] = gains.get(margin["limit"], 0.0)
    return record_from(data)


def said(record: Record) -> str:
    return section(record, "What limits it").paragraphs[0]


@pytest.mark.slow
def test_the_limits_that_matter_are_said_with_a_small_step_the_most_important_first():
    record = with_gains(sample_records.full(), wheel_speed=0.0468, workspace=1.54)
    assert said(record) == (
        "10 mm more room on every side would make the best drive 1.5 % better; 0.1 rad/s more wheel speed "
        "0.47 %. No other limit holds it back."
    )
    table = section(record, "What limits it").tables[0]
    assert column(table, "limit")[:3] == ["workspace", "wheel speed", "wheel acceleration"]
    assert column(table, "best drive better by")[:3] == [pytest.approx(1.54), pytest.approx(0.468), 0.0]
    # Conditions, as the duration, are no limits that a search has multipliers of.
    assert column(table, "a little looser")[3] is None


@pytest.mark.slow
def test_margins_are_in_the_unit_of_the_step():
    data = with_gains(sample_records.full(), workspace=1.54).data
    for margin in data["results"][0]["margins"]:
        if margin["limit"] == "workspace":
            margin |= {"margin": 0.0102, "active": False}
    table = section(record_from(data), "What limits it").tables[0]
    assert column(table, "a little looser")[0] == "10 mm more room on every side"
    assert column(table, "margin")[0] == "10.2 mm"


@pytest.mark.slow
def test_a_range_that_is_not_the_same_both_ways_is_wider_at_both_ends():
    """More speed alone would be half of what the gain is of."""
    data = with_gains(sample_records.full(), wheel_speed=0.0468).data
    data["study"]["limits"]["wheel_speed"] = [0.0, 10.0]
    assert said(record_from(data)).startswith("Wheel speed 0.1 rad/s wider at both ends would make")


@pytest.mark.slow
def test_limits_that_hardly_matter_are_in_the_table_only():
    record = with_gains(sample_records.full(), wheel_speed=0.002, workspace=1.54)
    assert said(record).endswith("would make the best drive 1.5 % better. Other limits matter less.")
    shown = column(section(record, "What limits it").tables[0], "best drive better by")
    assert shown[:2] == [pytest.approx(1.54), pytest.approx(0.02)]


@pytest.mark.slow
def test_a_limit_without_a_size_has_no_step():
    data = with_gains(sample_records.full(), workspace=1.54).data
    for margin in data["results"][0]["margins"]:
        margin["size"] = 0.0
    assert said(record_from(data)).startswith("What looser limits would gain is not known")


@pytest.mark.slow
def test_limits_that_do_not_matter():
    assert said(with_gains(sample_records.full(), wheel_speed=1e-9)).startswith(
        "No limit holds this drive back"
    )


@pytest.mark.slow
def test_what_is_not_known_is_said_in_one_line():
    record = sample_records.full()
    assert said(record).startswith("What looser limits would gain is not known")
    titles = [one.title for one in section(record, "What limits it").tables[0].columns]
    assert titles == ["limit", "margin", "size of the limit", "state"]


@pytest.mark.parametrize(
    ("limit", "unit", "size", "words"),
    [
        ("workspace", "m", 1.7, "10 mm more room on every side"),
        ("obstacles", "m", 0.35, "2 mm less around every obstacle"),
        ("wheel_speed", "rad/s", 9.9, "0.05 rad/s more wheel speed"),
        ("steering_angle", "rad", 0.6, "0.2 deg more steering angle"),
        ("turning_radius", "m", 0.5, "a turning radius 5 mm smaller"),
        ("path_length", "m", 250.0, "2 m more path length"),
        ("end_position", "m", 0.01, "0.1 mm more tolerance of where it ends"),
        ("of_my_own", "m/s^2", 3.0, "0.02 m/s² more of my own"),
    ],
)
def test_each_limit_says_itself_what_there_is_more_of(limit: str, unit: str, size: float, words: str):
    margin: dict[str, Any] = {"limit": limit, "margin": 0.0, "size": size, "unit": unit}
    entry = {**margin, "active": True, "kept": True, "gain": 1.0}
    data = sample_rooms.steered().data
    data["results"][0]["margins"] = [entry]
    (one,) = record_from(data).results[0].margins
    assert Room(one).loosened == words
    factor = Room(one).unit[1]
    assert Room(one).gain == pytest.approx(Room(one).step / factor)
    assert 0.4 * size <= 100 * Room(one).gain <= size * (1 + 1e-9)

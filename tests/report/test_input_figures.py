"""Figures of inputs and the table of limits, for robots with other inputs than two wheel speeds."""

from __future__ import annotations

import numpy as np
import pytest
import sample_rooms
from recorded import record_from
from sample_records import full, many
from shown_in import section

from oed.foundation.text import excess_text, quantity
from oed.records.record import Record
from oed.report.figures import chart
from oed.report.figures.draw import drawn
from oed.report.figures.spec import line_look
from oed.report.parts.inputs import groups_of, series_of


def captions(record: Record, title: str) -> dict[str, str]:
    return {picture.name: picture.caption for picture in section(record, title).figures}


def with_limit(record: Record, name: str, limit: dict[str, object] | None) -> Record:
    data = record.data
    data["study"]["limits"][name] = limit
    return record_from(data)


@pytest.mark.slow
def test_one_figure_for_each_quantity_and_rate() -> None:
    told = captions(sample_rooms.steered(), "Wheel speeds and steering angles, and their rates")
    assert list(told) == ["wheel_speeds", "wheel_accelerations", "steering_angles", "steering_rates"]
    assert told["steering_angles"].startswith("Steering angle. The lines marked are the limits")


def test_angles_are_in_degrees_and_wheels_in_radians() -> None:
    record = sample_rooms.steered()
    (wheel, _), (angle, rate) = groups_of(record, 2)
    assert (wheel.unit, angle.unit, rate.unit) == ("rad/s", "deg", "deg/s")
    assert angle.bounds(record) == pytest.approx((-35, 35))
    assert rate.bounds(record) == pytest.approx((-200, 200))
    assert wheel.bounds(record) == (-10, 10)
    largest = np.max(np.array(record.results[0].drive.coefficients)[:, 1])
    shown = series_of(record.results[0], angle).values
    assert shown.shape[1] == 1
    assert 0.9 * np.rad2deg(largest) < np.nanmax(shown) <= np.rad2deg(largest) + 1e-9


@pytest.mark.slow
def test_four_wheels_have_four_dashes() -> None:
    told = captions(sample_rooms.crab(), "Wheel speeds and accelerations")["wheel_speeds"]
    assert "front left (solid), front right (dashed), rear left (dash-dotted), rear right (dotted)" in told
    assert len({str(line_look(index)["linestyle"]) for index in range(4)}) == 4


def test_every_input_is_drawn_with_its_label() -> None:
    record = sample_rooms.crab()
    ((values, _),) = groups_of(record, 4)
    labels = [f"{name} (solid)" for name in ("front left", "front right", "rear left", "rear right")]
    figure = drawn(chart.series([series_of(record.results[0], values)], values, labels, None))
    figure.canvas.draw()
    assert len([line for line in figure.axes[0].lines if len(line.get_xdata()) > 9]) == 4
    box = figure.legends[0].get_window_extent()
    assert 0 <= box.x0 < box.x1 <= figure.bbox.x1


@pytest.mark.slow
def test_limits_of_single_inputs_are_told() -> None:
    record = sample_rooms.towing()
    ((values, rates),) = groups_of(record, 2)
    assert values.bounds(record) is None
    assert values.own_bounds(record) == {"wheel_speed_right": (-10, 10), "wheel_speed_left": (-5, 8)}
    assert rates.bounds(record) == (-40, 40)
    told = captions(record, "Wheel speeds and accelerations")["wheel_speeds"]
    assert "each has its own: right -10 to 10 rad/s, left -5 to 8 rad/s." in told


def test_single_limits_that_are_alike_are_one() -> None:
    alike = {"each": {"wheel_speed_right": [-7, 7], "wheel_speed_left": [-7, 7]}}
    record = with_limit(sample_rooms.towing(), "wheel_speed", alike)
    assert groups_of(record, 2)[0][0].bounds(record) == (-7, 7)


def test_records_that_do_not_name_their_inputs() -> None:
    data = {key: entry for key, entry in full().data.items() if key != "inputs"}
    ((values, _),) = groups_of(record_from(data), 2)
    assert values.names == ("wheel_speed_right", "wheel_speed_left")
    ((other, rates),) = groups_of(record_from(data), 3)
    assert other.names == ("input_1", "input_2", "input_3")
    assert other.bounds(record_from(data)) is None
    assert (other.limit, rates.limit) == ("input", "rate_of_input")


def test_limits_in_their_units() -> None:
    rows = {str(row[0]): row[1:4] for row in section(sample_rooms.steered(), "What limits it").tables[0].rows}
    assert str(rows["wheel acceleration"][1]).endswith(" rad/s²")
    assert str(rows["wheel jerk"][1]).endswith(" rad/s³")
    assert str(rows["lateral acceleration"][1]).endswith(" m/s²")
    assert rows["steering angle"][1] == "35 deg"
    assert rows["yaw rate"][1] == "90 deg/s"
    assert rows["turning radius"][1] == "0.4 m"
    # What is at its limit is there, not at 1e-9 of it; what a start is short of has no unit of its own.
    assert rows["start"][:2] == ("0", None)
    record = sample_rooms.steered()
    margin = next(one for one in record.results[0].margins if one.limit == "steering_angle")
    assert rows["steering angle"][0] == quantity(float(np.rad2deg(margin.margin)), "deg")


def test_many_limits_name_only_those_that_are_touched() -> None:
    record = sample_rooms.steered()
    table = section(record, "What limits it").tables[1]
    assert [column.title for column in table.columns] == [
        "drive",
        "exceeded",
        "active or met",
        "satisfied with room",
    ]
    first, fast = table.rows
    assert first[1] is None
    margin = next(one for one in record.results[1].margins if one.limit == "workspace")
    assert fast[1] == f"workspace by {excess_text(-margin.margin, 'm')}"
    for entry, row in zip(record.results, table.rows, strict=True):
        named = sum(len(str(cell).split(", ")) for cell in row[1:3] if cell)
        assert named + int(str(row[3])) == len(entry.margins)


@pytest.mark.slow
def test_few_limits_are_told_one_by_one() -> None:
    table = section(many(), "What limits it").tables[1]
    assert "wheel speed" in [column.title for column in table.columns]

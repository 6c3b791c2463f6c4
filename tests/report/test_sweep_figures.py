"""What a sweep's figures draw: which key lies along the axis, which make lines, and on what scales."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from oed.records.stored.sweep import StoredSweep, SweptKey, SweptPoint
from oed.report.figures import chart as charts
from oed.report.figures.chart import Chart
from oed.report.figures.draw import drawn
from oed.report.sweep import charted


def table(*keys: tuple[str, str, dict[str, float | None]]) -> StoredSweep:
    """A sweep over keys: name, unit, number by text (None: a word)."""
    points: list[dict[str, Any]] = [{"values": {}, "numbers": {}, "folder": "p"}]
    for name, _, values in keys:
        points = [
            {
                "values": {**point["values"], name: text},
                "numbers": {**point["numbers"], name: number},
                "folder": f"{point['folder']}_{text}",
            }
            for point in points
            for text, number in values.items()
        ]
    told = [
        {
            "key": name,
            "name": name,
            "unit": unit,
            "values": list(values),
            "numeric": None not in values.values(),
        }
        for name, unit, values in keys
    ]
    return StoredSweep.model_construct(
        keys=[SweptKey.model_construct(**one) for one in told],
        points=[SweptPoint.model_construct(**one) for one in points],
    )


SPEED = ("wheel_speed", "rad/s^2", {"20 x": 20.0, "5 x": 5.0})
STARTS = ("starts", "", {"1": 1.0, "2": 2.0, "4": 4.0})
KIND = ("criterion", "", {"E": None, "D": None, "A": None, "G": None})


class TestChart:
    def test_numbers_lie_in_order_along_the_axis(self):
        data = table(SPEED)
        chart = charted(data, "objective", {"p_20 x": 2.0, "p_5 x": 1.0})
        assert chart == Chart("wheel speed [rad/s²]", (5.0, 20.0), (("", (1.0, 2.0)),), "objective")

    def test_the_longest_numeric_key_lies_along_the_axis_and_the_others_make_lines(self):
        data = table(KIND, SPEED, STARTS)
        chart = charted(data, "objective", {point.folder: 1.0 for point in data.points})
        assert chart.places == (1.0, 2.0, 4.0)
        assert len(chart.series) == 8
        assert chart.series[0][0] == "criterion E, wheel speed 20 x"

    def test_nothing_to_draw(self):
        assert charted(table(SPEED), "objective", {}) is None
        # Words lie along no axis.
        assert charted(table(KIND), "objective", {"p_D": 1.0, "p_A": 3.0}) is None
        assert charted(table(("seed", "", {"1": 1.0})), "objective", {"p_1": 2.0}) is None


def axes_of(places: tuple[float, ...], *lines: tuple[float | None, ...]) -> Any:
    series = tuple((f"line {index}", line) for index, line in enumerate(lines))
    return drawn(charts.panels([Chart("speed [m/s]", places, series, "objective")])).axes[0]


class TestScales:
    @pytest.mark.parametrize(("places", "scale"), [((1.0, 2.0, 3.0), "linear"), ((1.0, 5.0, 40.0), "log")])
    def test_across(self, places: tuple[float, ...], scale: str):
        ax = axes_of(places, (1.0, 2.0, 3.0))
        assert ax.get_xscale() == scale
        assert [label.get_text() for label in ax.get_xticklabels()] == [f"{place:g}" for place in places]

    @pytest.mark.parametrize(
        ("values", "scale"),
        [
            ((1.0, 3.0), "linear"),
            ((1.0, 300.0), "log"),
            ((-1.0, 300.0), "linear"),
            ((None, float("inf")), "linear"),
        ],
    )
    def test_values(self, values: tuple[float | None, ...], scale: str):
        assert axes_of((1.0, 2.0), values).get_yscale() == scale

    def test_a_map_names_every_cell(self):
        lines = tuple((f"duration {row} s", (1.0 * row, None)) for row in range(1, 9))
        figure = drawn(charts.heat_map(Chart("speed [m/s]", (1.0, 2.0), lines, "objective")))
        ax = figure.axes[0]
        assert [text.get_text() for text in ax.texts] == [
            text for row in range(1, 9) for text in (f"{row}", "–")
        ]
        assert ax.get_xlabel() == "speed [m/s]"
        assert ax.get_yticklabels()[0].get_text() == "duration 1 s"


class TestNames:
    def test_several_lines_are_named_where_they_end_and_no_name_covers_another(self):
        lines = [(3.0, 1.0), (3.1, 1.02), (2.9, 1.01), (9.0, None)]
        series = tuple((f"noise {index} mm", line) for index, line in enumerate(lines))
        figure = drawn(charts.panels([Chart("speed [m/s]", (1.0, 2.0), series, "error [mm]")] * 3))
        figure.canvas.draw()
        for ax in figure.axes:
            boxes = [one.get_window_extent() for one in ax.texts]
            assert {one.get_text() for one in ax.texts} == {name for name, _ in series}
            assert not any(a.overlaps(b) for at, a in enumerate(boxes) for b in boxes[:at])
            assert all(figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1 for box in boxes)
        assert not figure.legends

    def test_one_line_needs_no_name_and_what_is_wanted_is_a_level(self):
        chart = Chart("speed [m/s]", (1.0, 2.0), (("track", (3.0, 1.0)),), "error [mm]", level=4.0)
        (ax,) = drawn(charts.panels([chart])).axes
        assert [one.get_text() for one in ax.texts] == ["wanted"]
        assert ax.get_ylim()[0] == 0 < 4.0 < ax.get_ylim()[1]

    @pytest.mark.parametrize("line", [(4.24, 2.0, 0.9), (0.9, 2.0, 4.24)])
    def test_what_is_wanted_is_written_where_no_line_is(self, line: tuple[float, ...]):
        places = (10.0, 20.0, 40.0)
        chart = Chart("time [s]", places, (("track", line),), "error [mm]", level=4.0)
        figure = drawn(charts.panels([chart] * 3))
        figure.canvas.draw()
        ax, *_ = figure.axes
        box = ax.texts[0].get_window_extent()
        along = np.linspace(10.0, 40.0, 500)
        points = ax.transData.transform(np.column_stack([along, np.interp(along, places, line)]))
        assert not any(box.contains(*point) for point in points)

    def test_panels_of_other_units_have_labels_of_their_own(self):
        made = [
            Chart("speed [m/s]", (1.0, 2.0), (("", (3.0, 1.0)),), f"error [{unit}]") for unit in ("mm", "1")
        ]
        assert [ax.get_ylabel() for ax in drawn(charts.panels(made)).axes] == ["error [mm]", "error [1]"]

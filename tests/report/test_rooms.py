"""Rooms in reports: outlines, obstacles, the robot's body, robots that drive sideways or tow a trailer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import pytest
import sample_rooms
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from recorded import record_from
from sample_records import full
from sample_rooms import ROOMS
from shown_in import section

from oed.records.record import Record
from oed.report import write_report
from oed.report.comparison import write_comparison
from oed.report.figures import draw, spec
from oed.report.figures.driven import Room, path_of, robot_width, room_of
from oed.report.figures.paths import paths, surroundings
from oed.report.page import script_data
from oed.report.parts.reading import with_drive
from oed.robots.limits import Circle as CircularRoom
from oed.robots.limits.workspace import OBSTACLES, WORKSPACES

pytestmark = pytest.mark.usefixtures("drawn_once")


@cache
def drawn(make: Callable[[], Record]) -> Figure:
    record = make()
    return draw.drawn(paths([path_of(record, one) for one in with_drive(record)], room_of(record)))


def legend(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def changed(record: Record, part: str, *without: str, **keys: object) -> Record:
    data = record.data
    data["study"][part].update(keys)
    for key in without:
        del data["study"][part][key]
    return record_from(data)


DRAWN = ("crab", "steered")
"""Rooms and limits of every kind; the paths of the other rooms are drawn for the size of their legends."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ROOMS)
def test_every_room_gets_a_whole_report(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if name not in DRAWN:
        request.getfixturevalue("blank_figures")
    write_report(ROOMS[name](), tmp_path)
    for file in (tmp_path / "figures").glob("*.svg"):
        ElementTree.parse(file)
        assert file.stat().st_size < 150_000
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "None" not in text
    assert "nan" not in text.split()


def test_every_kind_of_shape_has_an_outline() -> None:
    keys = {"x": (0, 2), "y": (1, 4)}, {"x": 0.5, "y": 2, "radius": 1}, {"points": [(0, 0), (2, 0), (1, 2)]}
    given = {"rectangle": keys[0], "circle": keys[1], "polygon": keys[2]}
    extents = {"rectangle": (0, 2, 1, 4), "circle": (-0.5, 1.5, 1, 3), "polygon": (0, 2, 0, 2)}
    for one in (*WORKSPACES, *OBSTACLES):
        kind = one.model_fields["kind"].default
        shape = one(**given[kind])
        assert shape.outline.extent == extents[kind]
        (ax,) = draw.drawn(spec.Plot([spec.Panel(surroundings(Room(shape)))])).axes
        assert ax.patches[0].get_extents().transformed(ax.transData.inverted()).extents == pytest.approx(
            np.array(extents[kind])[[0, 2, 1, 3]]
        )


@pytest.mark.slow
def test_polygon_and_obstacles_are_drawn_in_every_panel() -> None:
    record = sample_rooms.crab()
    figure = drawn(sample_rooms.crab)
    for ax in figure.axes[:2]:
        floor, *obstacles = [patch for patch in ax.patches if patch.get_facecolor()[3] > 0]
        corners = record.data["study"]["limits"]["workspace"]["points"]
        assert np.allclose(floor.get_xy()[:-1], corners)
        assert [type(one) for one in obstacles] == [Circle, Polygon]
        assert all(one.get_hatch() for one in obstacles)
        assert obstacles[0].center == (1.4, -0.5)
        assert to_hex(obstacles[0].get_facecolor()) != to_hex(floor.get_facecolor())
    assert "obstacle" in legend(figure)


@pytest.mark.slow
def test_circular_workspace_is_drawn_and_seen_whole() -> None:
    figure = drawn(sample_rooms.steered)
    (circle,) = figure.axes[0].patches
    assert (circle.center, circle.radius) == ((0.4, 0.0), 1.2)
    low, high = figure.axes[0].get_ylim()
    assert low < -1.2
    assert high > 1.2
    assert not {"obstacle", "robot's body"} & set(legend(figure))


@pytest.mark.slow
def test_body_is_drawn_at_both_ends_of_every_run() -> None:
    record = sample_rooms.crab()
    ax = drawn(sample_rooms.crab).axes[0]
    bodies = [patch for patch in ax.patches if isinstance(patch, Circle) and not patch.get_fill()]
    poses = np.array(record.results[0].drive.poses).reshape(3, 41, 3)
    ends = poses[:, [0, -1], :2].reshape(-1, 2)
    assert np.allclose([body.center for body in bodies], ends)
    assert {body.radius for body in bodies} == {0.15}
    caption = section(record, "Paths in the workspace").figures[0].caption
    assert "body of radius 0.15 m, which has to stay inside the workspace and clear of obstacles" in caption
    assert "Hatched shapes are obstacles." in caption


@pytest.mark.slow
def test_a_point_in_a_rectangle_has_none_of_that() -> None:
    caption = section(full(), "Paths in the workspace").figures[0].caption
    assert "body" not in caption
    assert "obstacle" not in caption
    assert legend(drawn(full)) == ["start", "end", "forwards", "segments meet"]


@pytest.mark.slow
def test_a_robot_that_drives_sideways_never_drives_backwards() -> None:
    record = sample_rooms.crab()
    path = path_of(record, record.results[0])
    crab = path.runs[0]
    assert path.sideways
    assert np.ptp(crab.x) < 1e-6 < np.ptp(crab.y)
    assert all((run.speed >= 0).all() for run in path.runs)
    assert {"motion", "heading"} <= set(legend(drawn(sample_rooms.crab)))
    assert "backwards" not in section(record, "Paths in the workspace").figures[0].caption


def test_sideways_motion_is_seen_of_unlisted_robots() -> None:
    record = changed(sample_rooms.omni(), "robot", kind="python", object="hover:Craft")
    assert path_of(record, record.results[0]).sideways
    assert not path_of(full(), full().results[0]).sideways
    assert not any(path_of(sample_rooms.steered(), one).sideways for one in sample_rooms.steered().results)


def test_backwards_is_told_of_robots_that_only_drive_ahead() -> None:
    record = sample_rooms.steered()
    back = path_of(record, record.results[1]).runs[1]
    assert (back.speed <= 0).all()
    assert "backwards" in legend(drawn(sample_rooms.steered))


@pytest.mark.slow
def test_the_trailers_axle_is_a_thin_line_of_its_own() -> None:
    record = sample_rooms.towing()
    trailer = path_of(record, record.results[0]).runs[0].trailer
    assert trailer is not None
    assert np.allclose(trailer[0], [-0.5, 0.0])
    poses = np.array(record.results[0].drive.poses)
    hitch = poses[:, :2] - 0.1 * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    towed = hitch - trailer
    assert np.allclose(np.hypot(*towed.T), 0.4)
    assert np.allclose(np.exp(1j * np.arctan2(*towed.T[::-1])), np.exp(1j * (poses[:, 2] + poses[:, 3])))
    figure = drawn(sample_rooms.towing)
    assert any(
        np.allclose(line.get_xydata(), trailer) for line in figure.axes[0].lines if line.get_xdata().size > 9
    )
    assert "trailer's axle" in legend(figure)
    assert figure.axes[0].get_xlim()[0] < trailer[:, 0].min()


@pytest.mark.slow
def test_legends_fit_their_figures() -> None:
    for make in ROOMS.values():
        figure = drawn(make)
        figure.canvas.draw()
        box, page = figure.legends[0].get_window_extent(), figure.bbox
        assert page.x0 <= box.x0
        assert box.x1 <= page.x1


@pytest.mark.parametrize(("count", "lines"), [(1, 3), (4, 2)])
@pytest.mark.slow
def test_titles_of_several_lines_are_whole(count: int, lines: int) -> None:
    record = sample_rooms.omni()
    title = "\n".join(f"key {number}" for number in range(lines))
    path = replace(path_of(record, with_drive(record)[0]), title=title)
    figure = draw.laid_out(draw.drawn(paths([path] * count, room_of(record))))
    figure.canvas.draw()
    for ax in figure.axes[:count]:
        box = ax.title.get_window_extent()
        assert box.y1 <= figure.bbox.y1
        above = [other.get_window_extent() for other in figure.axes[:count] if other is not ax]
        assert not any(box.overlaps(one) for one in above)


def test_player_knows_the_room_and_the_body() -> None:
    record = sample_rooms.crab()
    animation = section(record, "Summary").animation
    assert animation is not None
    assert animation.workspace == {"points": record.data["study"]["limits"]["workspace"]["points"]}
    assert animation.obstacles[0] == {"x": 1.4, "y": -0.5, "radius": 0.2}
    assert len(animation.obstacles[1]["points"]) == 5
    assert animation.body_radius == 0.15
    left, right, bottom, top = animation.view
    assert (left, bottom) < (-1, -1)
    assert right > 2
    assert top > 1.4
    assert '"obstacles":[{"x":1.4' in script_data(animation)
    assert "the circle is its body" in animation.caption


def test_player_knows_the_trailer() -> None:
    record = sample_rooms.towing()
    animation = section(record, "Summary").animation
    assert animation is not None
    assert animation.trailer == (0.1, 0.4)
    poses = np.array(record.best.drive.poses) if record.best else np.zeros((0, 4))
    played = animation.drives[0]["trailer"]
    assert np.allclose(played[:: (len(played) - 1) // (len(poses) - 1)], poses[:, 3], atol=1e-4)
    assert "trailer" not in section(full(), "Summary").animation.drives[0]


@pytest.mark.slow
def test_unknown_shapes_are_left_out() -> None:
    class Blob(CircularRoom):
        """A room of the user's own."""

        outline: ClassVar[None] = None

    record = full()
    drives = [path_of(record, one) for one in with_drive(record)]
    assert not draw.drawn(paths(drives, Room(Blob(radius=1)))).axes[0].patches
    assert draw.drawn(paths(drives, Room(CircularRoom(radius=1)))).axes[0].patches


def test_width_of_robots_with_and_without_a_track() -> None:
    assert robot_width(full()) == 0.18
    assert robot_width(sample_rooms.steered()) == pytest.approx(0.6 * 0.33)
    # Inside its circle, as the sum of half the wheelbase and half the track is wider than that.
    assert robot_width(sample_rooms.crab()) == pytest.approx(0.3 / 1.35)
    own = {"kind": "python", "object": "blimp:Blimp", "body_radius": 0.27}
    body = changed(sample_rooms.omni(), "robot", "centre_distance", **own)
    assert robot_width(body) == pytest.approx(0.4)
    thin = changed(body, "robot", "body_radius")
    assert robot_width(thin) == 0
    # Of robots of code the keys alone are known, in whatever units.
    for track, width in (("30 cm", 0.3), (0.2, 0.2), ("wide", 0), (None, 0)):
        given = changed(thin, "robot", track=track)
        assert robot_width(given) == pytest.approx(width)
    assert robot_width(changed(given, "robot", body_radius=0.27)) == pytest.approx(0.4)


@pytest.mark.slow
def test_comparison_draws_each_room(tmp_path: Path) -> None:
    write_comparison([("crab", sample_rooms.crab()), ("omni", sample_rooms.omni())], tmp_path)
    crab, omni = ((tmp_path / "figures" / f"paths_{index}.svg").read_text() for index in (1, 2))
    assert "obstacle" in crab
    assert "<pattern" in crab
    assert "obstacle" not in omni
    row = next(
        line for line in (tmp_path / "report.md").read_text().splitlines() if line.startswith("| crab | Crab")
    )
    assert " 24.0 |" in row

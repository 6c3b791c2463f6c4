"""The pictures of a film: what stands still is drawn once, what moves is drawn over it again and again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon

from oed.foundation.arrays import Array
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.figures import spec
from oed.report.figures.draw import as_drawn, drawn
from oed.report.figures.driven import Box, Room, robot_width, room_of, view_of
from oed.report.figures.paths import END, START, axes, scaled, surroundings
from oed.report.figures.spec import FAINT, FIRST, INK, SECOND, mark, stroke
from oed.report.film.cast import Cast
from oed.report.film.writing import Frame
from oed.report.parts.reading import called
from oed.robots.models import Model

DPI = 100
WIDTHS = {1: 5.6, 2: 8.0}
"""Of a film with that many columns [inch]."""
TALLEST = 1.5
"""Height of a panel, as a share of its width."""
SLIM = 0.45
"""Share of its width below which panels stand one above the other."""
SMALLEST = 7.0
"""Half the robot's width at least [px]."""
ROBOT = np.array([(1.3, 0.0), (-0.6, 1.0), (-0.2, 0.0), (-0.6, -1.0)])
"""The triangle that stands for the robot, in half its width, notched to show its heading."""
LETTERS = 12
"""Of a title on an inch."""
PAD = 0.1
"""Around and between panels [inch]."""

WAY, DONE, TRACE = stroke("#b9b9b6", 1.3, 1.8), stroke("#7a95ad", 1.5, 2), stroke(FIRST, 2.2, 2.2)
BODY: dict[str, Any] = {"fill": False, "edgecolor": INK, "linewidth": 1.0, "zorder": 8}
TOW = {**stroke("#5f5f5f", 3.0, 8.5), "solid_capstyle": "butt"}
HITCH = mark("o", 5, INK, 1.0, 8.7)
FACE: dict[str, Any] = {"facecolor": SECOND, "edgecolor": INK, "linewidth": 1.3, "zorder": 9}


@dataclass(frozen=True)
class _Scene:
    """What surrounds the drives of a film: the room, what is in sight of it, the robot and its width [m]."""

    room: Room
    view: Box
    robot: Model
    width: float


def _columns(view: Box, count: int) -> int:
    return 1 if count == 1 or min(view.size[1] / view.size[0], TALLEST) < SLIM else 2


def _still(scene: _Scene, casts: Sequence[Cast], apart: bool) -> spec.Plot:
    # What does not move; clocks stand below names where they are apart.
    x, y = axes(scene.view)
    panels = [spec.Panel([*surroundings(scene.room), *_ways(cast)], x, y, equal="box") for cast in casts]
    columns = _columns(scene.view, len(casts))
    head = 0.2 * (max(cast.title.count("\n") for cast in casts) + 1 + apart)
    each = (WIDTHS[columns] - 0.6 - 0.3 * columns) / columns
    ratio = min(scene.view.size[1] / scene.view.size[0], TALLEST)
    height = math.ceil(len(casts) / columns) * (each * ratio + head + 0.15) + 0.9
    # Even numbers of pixels, as an MP4 has them.
    width, height = (2 * round(DPI * length / 2) / DPI for length in (WIDTHS[columns], height))
    return spec.Plot(panels, columns, width, height, labels="figure")


def _ways(cast: Cast) -> list[spec.Part]:
    parts: list[spec.Part] = []
    for run in cast.runs:
        x, y = run.poses[:, :2].T
        parts.append(spec.Line(x, y, WAY))
        for look, at in ((START, slice(0, 1)), (END, slice(-1, None))):
            parts.append(spec.Line(x[at], y[at], {**scaled(look, 0.7), "zorder": 1.9}))
    return parts


class Stage:
    """The figure of a film, one panel per drive."""

    def __init__(self, record: Record, results: Sequence[Result], speed: float) -> None:
        """Draw all that stands still."""
        casts = [Cast.of(one, called(record, one)) for one in results]
        self._speed, room = speed, room_of(record)
        view = view_of(record, results)
        scene = _Scene(room, view, record.robot_study.robot, robot_width(record))
        columns = _columns(view, len(casts))
        apart = any(_clock_apart(cast, (WIDTHS[columns] - 1.0) / columns) for cast in casts)
        self._figure = drawn(_still(scene, casts, apart), dpi=DPI)
        engine = self._figure.get_layout_engine()
        assert engine is not None
        engine.set(w_pad=PAD, h_pad=PAD)
        self._canvas = FigureCanvasAgg(self._figure)
        self._panels = [
            _Panel(ax, scene, cast, apart) for ax, cast in zip(list(self._figure.axes), casts, strict=True)
        ]
        rate = "" if speed == 1 else f", {speed:g} × real time"
        self._figure.suptitle(as_drawn(f"{record.study.name}{rate}"), fontsize=11)
        engine.execute(self._figure)
        self._figure.set_layout_engine("none")
        for panel in self._panels:
            panel.set_moving()
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(self._figure.bbox)

    def frame(self, time: float) -> Frame:
        """The picture at a time of the film [s]."""
        self._canvas.restore_region(self._still)
        for panel in self._panels:
            panel.draw(*panel.cast.moment(time, self._speed))
        return np.array(np.asarray(self._canvas.buffer_rgba())[..., :3])

    def colours(self, length: float) -> Frame:
        """Pictures with all colours of a film that long [s], one above the other."""
        return np.vstack([self.frame(share * length) for share in (0.0, 0.5, 1.0)])


class _Panel:
    """What moves along a drive."""

    def __init__(self, ax: Axes, scene: _Scene, cast: Cast, apart: bool) -> None:
        self.cast, self._ax, self._scene = cast, ax, scene
        ax.tick_params(labelsize=9, color=FAINT)
        # The clock stands beside the name, or below it where there is no room.
        ax.set_title(as_drawn(cast.title) + ("\n" if apart else ""), loc="left", fontsize=10)
        self._clock = ax.set_title("", loc="right", fontsize=10)
        self._done = [ax.plot(*run.poses[:, :2].T, **DONE)[0] for run in cast.runs[:-1]]
        (self._trace,) = ax.plot([], [], **TRACE)
        self._face = ax.add_patch(Polygon(ROBOT, closed=True, **FACE))
        self._moving: list[Artist] = [self._trace, self._face, self._clock]
        self._body: Circle | None = None
        if scene.room.body_radius:
            self._body = ax.add_patch(Circle((0.0, 0.0), scene.room.body_radius, **BODY))
            self._moving.insert(1, self._body)
        self._tow: tuple[Line2D, Line2D] | None = None
        if scene.robot.towed is not None and cast.runs[0].poses.shape[1] > 3:
            self._tow = (ax.plot([], [], **TOW)[0], ax.plot([], [], **HITCH)[0])
            self._moving[1:1] = self._tow
        self._half = 0.0

    def set_moving(self) -> None:
        """Leave what moves out of what stands still; the layout is settled."""
        for artist in (*self._moving, *self._done):
            artist.set_animated(True)
        pixels = self._ax.get_window_extent().width
        self._half = max(self._scene.width / 2, SMALLEST * float(self._scene.view.size[0]) / pixels)

    def draw(self, number: int, time: float) -> None:
        """The robot in that run, from 0, so many seconds after its start."""
        run = self.cast.runs[number]
        pose = run.at(time)
        self._trace.set_data(*run.until(time).T)
        self._face.set_xy(_placed(self._half * ROBOT, pose))
        if self._body is not None:
            self._body.set_center((pose[0], pose[1]))
        if self._tow is not None:
            self._draw_tow(pose)
        self._clock.set_text(_clock(self.cast, number, time))
        for artist in (*self._done[:number], *self._moving):
            self._ax.draw_artist(artist)

    def _draw_tow(self, pose: Array) -> None:
        # From the hitch to the trailer's axle, and the axle.
        assert self._tow is not None
        bar, mark = self._tow
        hitch, axle = self._scene.robot.body(pose[None])[0]
        ahead = (hitch - axle) / math.hypot(*(hitch - axle))
        left = 0.9 * self._half * np.array([-ahead[1], ahead[0]])
        bar.set_data(*np.array([hitch, axle, axle + left, axle - left]).T)
        mark.set_data(*hitch[:, None])


def _clock(cast: Cast, number: int, time: float) -> str:
    which = f"run {number + 1} of {len(cast.runs)}, " if len(cast.runs) > 1 else ""
    return f"{which}{time:.1f} s of {cast.runs[number].duration:g} s"


def _clock_apart(cast: Cast, width: float) -> bool:
    # Whether a panel that wide [inch] has no room for both, the last line of its title and the clock.
    last = len(cast.runs) - 1
    clock = _clock(cast, last, cast.runs[last].duration)
    return len(cast.title.splitlines()[-1]) + 2 + len(clock) > LETTERS * width


def _placed(points: Array, pose: Array) -> Array:
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    placed: Array = points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
    return placed

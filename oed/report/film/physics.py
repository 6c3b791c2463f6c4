"""A film of a record's drive in simulated physics: wheels, slip and all, seen from behind the robot."""

from __future__ import annotations

import os
from ctypes.util import find_library
from pathlib import Path

from oed.foundation.errors import UserMistake
from oed.foundation.work.progress import Progress
from oed.records.record import FILE, load_record
from oed.records.recorded_study import recorded_study
from oed.report.film.animation import MadeFilm, driven_result
from oed.report.film.writing import film_rate, heard, require_format, require_speed, write_frames
from oed.robots.models.model import robot_of
from oed.simulation.physics import drive, frames, physics_robot

SIZE = (300, 400)
"""Height and width [pixels]."""
FPS = 10.0
"""Frames a second, where not said otherwise: shaded pictures take more room than drawings."""


def film_physics(
    folder: str | Path,
    file: str | Path,
    *,
    result: str | None = None,
    speed: float = 1.0,
    fps: float | None = None,
    progress: Progress | None = None,
    trust: bool = False,
) -> MadeFilm:
    """Write a film of a physics robot on a record's drive.

    Args:
        folder: of the record.
        file: ends in .gif, or in .mp4, which needs ffmpeg.
        result: the drive's name; the best one by default.
        speed: how much faster than the robot.
        fps: frames a second; 10 by default.
        progress: listener.
        trust: whether Python code that the record names may be run.

    Raises:
        RecordError: no record there, no such result, a result without a drive, a robot that is code which is
            not trusted.
        UserMistake: a robot without wheel radii and track, several runs, too many frames, the engine is
            not installed.
        Failure: nothing to draw with.
    """
    require_speed(speed)
    saved = load_record(folder)
    saved.require_robot()
    _draw_without_a_screen()
    target = Path(file)
    require_format(target, FPS if fps is None else fps)
    found = driven_result(saved, result, Path(folder) / FILE)
    assert found.drive is not None
    driven = found.drive.trajectory
    if driven.runs > 1:
        raise UserMistake(f"{found.name}: expected a drive of one run, got one of {driven.runs}")
    rate = film_rate(driven.duration / speed, target, fps, FPS)
    each = rate / speed
    study = recorded_study(saved, trust=trust)
    own = study.physics
    robot = physics_robot(robot_of(study.problem.model)) if own is None else own.robot
    motion = drive(robot, driven.inputs, driven.period, start=driven.start[:3], rate=max(50.0, each))
    pictures = frames(robot, motion, rate=each, size=SIZE)
    total = int(motion.times[-1] * each) + 1
    count = write_frames(heard(pictures, total, target, progress), target, rate)
    return MadeFilm(target, (found.name,), count, round(count / rate, 3), rate, speed)


def _draw_without_a_screen() -> None:
    # The engine chooses its graphics library once, when it is loaded, and by itself one that needs a screen.
    if not {"MUJOCO_GL", "DISPLAY"} & os.environ.keys() and find_library("EGL"):
        os.environ["MUJOCO_GL"] = "egl"

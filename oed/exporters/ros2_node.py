"""A drive as a ROS 2 node: one Python file that plays it, watches over it and records its log."""

from __future__ import annotations

import hashlib
import json
import math
import textwrap
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from oed.exporters.commands import joint_name
from oed.exporters.played import MESSAGES, PlayedRun, braking_time, message_kind, played_runs
from oed.exporters.request import Request
from oed.foundation.errors import UserMistake
from oed.foundation.extras import package_version
from oed.foundation.files import file_stem, write_text
from oed.foundation.shown import shown
from oed.foundation.text import count, quantity
from oed.logs import BagForm

LEAST_RATE = 20.0
"""Commands a second [Hz] that controllers take for a robot that is still being commanded."""
MOST_RATE = 1000.0
"""Commands a second [Hz] that a timer of Python can keep."""
DIGITS = 9
"""Significant digits of commands."""
WIDTH = 75
"""Characters of a tuple on one line."""
HASH = 12
"""Characters of a design's hash."""


def write_node(request: Request) -> Path:
    """Write the file, made executable by whoever wants to: `python3 FILE` will do.

    The commands are those of the design, each held for its time. They begin and end at rest: where the
    design does not, ramps lead there and away. A robot of code that is not trusted is played by the twists
    that its record's poses say.

    Raises:
        RecordError: no such result, or one that is no drive.
        UserMistake: a message that does not command such a robot, or a rate that no timer has.
    """
    if request.rate is not None and request.rate > MOST_RATE:
        raise UserMistake(f"rate: expected at most {MOST_RATE:g} Hz for a node, got {request.rate:g}")
    path = request.path("drive.py")
    write_text(path, _text(request, path.name))
    return path


def _text(request: Request, file: str) -> str:
    kind = message_kind(request.vehicle, request.message)
    message, runs, record = MESSAGES[kind], played_runs(request), request.record
    tables = [message.columns(request.vehicle, run.commands) for run in runs]
    names, _, speeds = tables[0]
    log = record.robot_study.log
    form = log if isinstance(log, BagForm) else BagForm()
    joints = [joint_name(entry) for entry in request.vehicle.inputs] if kind == "joint_state" else []
    return _template().render(
        title=_title(request),
        about=_about(request, runs),
        file=_plain(file),
        kind=kind,
        message=message,
        columns_count=len(names),
        study=_literal(record.provenance.study or "STUDY.yaml"),
        drive=_literal(file_stem(request.name)),
        design=_literal(design_hash(request)),
        departures=_tuple(map(_literal, _departures(request))),
        topic=_literal(message.topic),
        recorded=_tuple(map(_literal, form.topics)),
        readable=_tuple(map(_literal, form.types)),
        reads_bags=isinstance(log, BagForm),
        joints=_tuple(map(_literal, joints)) if joints else "",
        rate=_number(request.rate or max(LEAST_RATE, runs[0].commands.rate)),
        period=_number(1 / runs[0].commands.rate),
        braking=_number(braking_time(request)),
        columns=_tuple(map(_literal, names)),
        speeds=_tuple(map(str, speeds)),
        starts=_tuple(_start(run) for run in runs),
        runs=[[", ".join(map(_number, row)) for row in values[:-1]] for _, values, _ in tables],
    )


def _title(request: Request) -> str:
    what = f"the drive {request.name} of the study {request.record.study.name}"
    text = f"A ROS 2 node that plays {what}; written by oed {package_version('oed')}."
    return "\n".join(textwrap.wrap(_plain(text), WIDTH, break_long_words=False))


def design_hash(request: Request) -> str:
    """The beginning of the SHA-256 of a drive's splines: the same for the same design, whenever exported."""
    drive = request.drive.plain()
    drive.pop("poses")
    return hashlib.sha256(json.dumps(drive, sort_keys=True).encode()).hexdigest()[:HASH]


def _about(request: Request, runs: tuple[PlayedRun, ...]) -> list[str]:
    # What is driven, for who is about to drive it.
    twists = np.vstack([one.commands.twists for one in runs])
    rooms = np.array([one.room for one in runs])
    (left, bottom), (right, top) = rooms[:, :, 0].min(axis=0), rooms[:, :, 1].max(axis=0)
    speed, turning = np.hypot(*twists[:, :2].T).max(), np.abs(twists[:, 2]).max()
    robot = request.record.robot_study.robot
    lasting = ", ".join(quantity(one.duration, "s") for one in runs)
    length = quantity(sum(one.length for one in runs), "m")
    lines = [
        f"Robot:    {robot.kind}",
        f"Drive:    {count(len(runs), 'run')} of {lasting}, {length} in all",
        f"Fastest:  {quantity(speed, 'm/s')}, {quantity(math.degrees(turning), 'deg/s')}",
        f"Room:     x from {_metres(left)} to {_metres(right)}, y from {_metres(bottom)} to {_metres(top)}",
        "          of the robot's origin; its body needs room beyond",
        f"Design:   {design_hash(request)}",
    ]
    lead = max(one.lead for one in runs)
    if lead > 0:
        lines.append(f"Ramps:    {quantity(lead, 's')} from rest to the design's start, and to rest after it")
    return [_plain(line) for line in lines]


def _departures(request: Request) -> list[str]:
    # How many robots leave, in lines.
    known = request.departures
    return [] if known is None else textwrap.wrap(known["sentence"], WIDTH, break_long_words=False)


def _metres(size: float) -> str:
    return f"{size:.2f} m"


def _start(run: PlayedRun) -> str:
    x, y, heading = run.commands.poses[0, :3]
    return _tuple(map(_number, (round(x, 4), round(y, 4), round(math.degrees(heading), 2))))


def _number(value: float) -> str:
    # As Python writes a float; 0 has no sign.
    return repr(float(f"{value:.{DIGITS}g}") + 0.0)


def _tuple(entries: Iterable[str]) -> str:
    # On one line, or one entry a line.
    found = list(entries)
    line = ", ".join(found)
    if len(line) > WIDTH:
        return "".join(["(\n", *(f"    {one},\n" for one in found), ")"])
    return f"({line}{',' if len(found) == 1 else ''})"


def _literal(text: str) -> str:
    # JSON's strings are Python's, within the characters that a terminal shows.
    return json.dumps(shown(text), ensure_ascii=False)


def _plain(text: Any) -> str:
    # Names come from files: within a docstring they neither end it nor escape anything.
    return shown(str(text)).replace("\\", "/").replace('"', "'")


@cache
def _template() -> jinja2.Template:
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("oed.exporters"),
        autoescape=jinja2.select_autoescape(("html",)),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    return made.get_template("ros2_node.py.jinja")

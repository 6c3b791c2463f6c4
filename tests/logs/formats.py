"""Every format that a log may have: a short study and what it reads, unbroken, and ways to break either.

A fault of a table is named by file and line, one of a bag by its topic and the message that it is in, one of
the study by its line.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from bags import START, STORES, Message, write_bag, write_bag_1
from logged import drive
from test_bag_inputs import cars, commanded, odometry, own_messages, reference
from test_bag_logs import joints, poses
from test_bag_sensors import beacon, imu, markers

STUDY, MOST_LINES = "study.yaml:", 30
"""Where the study's own mistakes are, and how long it is at most."""
FEW = 10
"""Rows that are too few for a log."""
TABLE = drive(40)
TIMES, RIGHT, LEFT, X, Y, YAW = TABLE.T
SPAN = TIMES[20]
"""Of the bags [s]."""
NAN, INF = float("nan"), float("inf")


@dataclass
class Given:
    """A study and what it is to read, to be broken: the first of the files is the log, or the bag is."""

    study: str
    files: dict[str, Any] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    bag: str = "drive.mcap"
    harm: Callable[[Path], object] = lambda path: None
    options: dict[str, Any] = field(default_factory=dict)

    def written(self, folder: Path) -> Path:
        """The log."""
        log = folder / next(iter(self.files), self.bag)
        for name, own in self.files.items():
            if own is not None:
                text = own if isinstance(own, bytes) else "\n".join(map(",".join, own)).encode() + b"\n"
                (folder / name).write_bytes(text)
        if self.messages:
            if log.suffix == ".bag":
                write_bag_1(log, self.messages)
            else:
                written = write_bag(folder / log.stem, self.messages)
                if log.suffix:
                    storage(written).rename(log)
            self.harm(log)
        return log


def given(*parts: str, **keys: Any) -> Given:
    """By the parts of the study."""
    return Given("\n".join(("format: 1", "name: A robot", *parts)), **keys)


@dataclass(frozen=True)
class Fault:
    """A fault, the place that the message is to name, and what it is to say of it."""

    change: Callable[[Given], None]
    place: str
    words: str


# Faults of tables.


def rows(file: str, line: int, change: Callable[[list[list[str]]], Any], words: str) -> Fault:
    """A table whose rows are changed, or other ones, with a fault in a line; 0 for the file as a whole."""

    def broken(own: Given) -> None:
        changed = change(own.files[file])
        own.files[file] = changed if isinstance(changed, list) else own.files[file]

    return Fault(broken, f"{file}:{line}: " if line else f"{file}: ", words)


def cell(file: str, line: int, column: str | int, text: str, words: str) -> Fault:
    """A cell of a line (from 1), by the column's name or index."""

    def change(table: list[list[str]]) -> None:
        table[line - 1][column if isinstance(column, int) else table[0].index(column)] = text

    return rows(file, line, change, words)


def head(file: str, column: str, other: str, words: str) -> Fault:
    """A column of another name."""
    return rows(file, 1, lambda table: table[0].__setitem__(table[0].index(column), other), words)


def whole(file: str, text: bytes | None, words: str) -> Fault:
    """A file that holds something else, or is not there."""
    return Fault(lambda own: own.files.update({file: text}), f"{file}:", words)


def usual(file: str, clock: str | int, column: str | int, first: int = 2) -> list[Fault]:
    """Faults that any table may have, whose first row of numbers stands in line `first`."""
    at = first + 6
    return [
        cell(file, at, column, "lost", "expected a finite number, got 'lost'"),
        cell(file, at, column, "nan", "expected a finite number, got 'nan'"),
        cell(file, at, clock, "", "the cell is empty"),
        rows(file, at + 1, lambda table: table.insert(at, table[at - 3]), "time goes back"),
        rows(file, at, lambda table: table[at - 1].append("9"), "cells, as in the first line, got"),
        whole(file, b"# nothing\n", "the file has no rows"),
        whole(file, b"\xff\xfe\x00\x81" * 9, "not UTF-8 text"),
    ]


def later(table: list[list[str]]) -> list[list[str]]:
    """Times by a clock that began long before."""
    return [table[0], *([repr(float(row[0]) + 1e9), *row[1:]] for row in table[1:])]


# Faults of studies and bags.


def study(old: str, new: str, words: str) -> Fault:
    """Another word in the study, whose line is to be named."""

    def change(own: Given) -> None:
        assert old in own.study, old
        own.study = own.study.replace(old, new, 1)

    return Fault(change, STUDY, words)


def asked(words: str, **options: Any) -> Fault:
    """Other options than these."""
    return Fault(lambda own: own.options.update(options), "a.csv: ", words)


def value(topic: str, number: int, path: str, content: Any, words: str, key: str = "") -> Fault:
    """Something else at the path of a message (from 1); `key` where what it says is of something in it."""

    def change(own: Given) -> None:
        found = [message for one, _, message in own.messages if one == topic][number - 1]
        *outer, last = re.findall(r"\w+", path)
        for step in outer:
            found = found[int(step)] if step.isdecimal() else getattr(found, step)
        if last.isdecimal():
            found[int(last)] = content
        else:
            object.__setattr__(found, last, content)

    return Fault(change, f"drive: {topic}: message {number}: {key and f'{key}: '}", words)


def messages(change: Callable[[list[Message]], Iterable[Message]], place: str, words: str) -> Fault:
    """Other messages."""
    return Fault(lambda own: setattr(own, "messages", [*change(own.messages)]), place, words)


def without(topic: str, words: str, key: str) -> Fault:
    """No messages of a topic."""
    return messages(lambda own: (one for one in own if one[0] != topic), f"drive: {key}: ", words)


def harmed(change: Callable[[Path], object], words: str) -> Fault:
    """Another file where the bag is."""
    return Fault(lambda own: setattr(own, "harm", change), "drive: ", words)


def usual_stamps(topic: str, path: str = "header.stamp") -> list[Fault]:
    """Faults of the clock of any topic."""

    def unset(own: list[Message]) -> list[Message]:
        for one in (one for one in own if one[0] == topic):
            for part in getattr(one[2], "transforms", [one[2]]):
                part.header.stamp.sec = part.header.stamp.nanosec = 0
        return own

    return [
        value(topic, 5, f"{path}.sec", 0, "time goes back: 0.2 s after"),
        messages(unset, f"drive: {topic}: ", "are all zero; say `clock: received`"),
    ]


def storage(path: Path) -> Path:
    (found,) = path.glob("*.mcap")
    return found


# What the formats look like unbroken.

TWO = "robot: {kind: differential_drive, wheel_radius: 5 cm, track: 20 cm}"
POSES = "measurement: {kind: poses, noise: {position: 2 mm, heading: 0.3 deg}}"
WHEELS, MOCAP = "t,wheel_speed_right,wheel_speed_left", "geometry_msgs/msg/PoseStamped"
DEGREES, DAY = np.degrees(YAW), datetime(2024, 5, 31, 14, 3, 7, tzinfo=UTC)


def table(header: str, *columns: Any) -> list[list[str]]:
    """Cells of a header and columns."""
    named = [header.split(",")] if header else []
    return [*named, *([f"{one:.9g}" for one in row] for row in zip(*columns, strict=True))]


def ticks(angle: np.ndarray) -> np.ndarray:
    return np.mod(np.round(angle / (2 * np.pi) * 4096), 4096)


def turned(speed: np.ndarray) -> np.ndarray:
    return np.cumsum(speed) * 0.05


def sights(header: str, *more: str) -> list[list[str]]:
    """Two points seen every 0.2 s."""
    return [
        header.split(","),
        *([f"{t:g}", name, "2", "30", *more] for t in TIMES[::4] for name in ("7", "12")),
    ]


def of_types() -> list[list[str]]:
    odom = [["odom", *row] for row in table("", TIMES, RIGHT, LEFT)]
    return sorted(
        [*odom, *(["mocap", *row] for row in table("", TIMES, X, Y, YAW))], key=lambda row: float(row[1])
    )


def dated() -> list[list[str]]:
    own = table(f"{WHEELS},x,y,heading", *TABLE.T)
    head = ["stamp", *own[0][1:]]
    return [head, *([(DAY + timedelta(seconds=float(row[0]))).isoformat(), *row[1:]] for row in own[1:])]


def tum() -> list[list[str]]:
    rows = zip(TIMES, X, Y, np.sin(YAW / 2), np.cos(YAW / 2), strict=True)
    return [[f"{t:g} {x:.6g} {y:.6g} 0.1 0 0 {sine:.9g} {cosine:.9g}"] for t, x, y, sine, cosine in rows]


def first(own: list[Message]) -> list[Message]:
    return [one for one in own if one[1] < START + SPAN]


def joint_states(**keys: Any) -> list[Message]:
    return first(joints(TIMES, np.column_stack([turned(RIGHT), turned(LEFT)]), **keys))


def tracked(kind: str = MOCAP, topic: str = "/mocap", **keys: Any) -> list[Message]:
    return first(poses(kind, topic, table=TABLE, **keys))


MATCHES = (TIMES[:-2:2], TIMES[2::2], *([one] * 19 for one in (0.02, 0, 2, 1e-6, 1e-6, 0.01, 1e-7)))
TUPLE = '{"T": 0.8, "phi_l": 0.5, "phi_r": -0.25, "sm": [0.001, -0.0005, -0.03]}'
ROWS = {"a.csv": table(f"{WHEELS},x,y,heading", *TABLE.T)}
INPUTS = {"a.csv": table(WHEELS, TIMES, RIGHT, LEFT)}

FORMATS: dict[str, Given] = {
    "ticks": given(
        TWO,
        POSES,
        """\
log:
  time: {column: ms, unit: ms}
  inputs:
    wheel_speed_right:
      {column: right, form: ticks, ticks_per_turn: 1024, gear: 4, cumulative: true, wrap: 4096}
    wheel_speed_left: {column: left, form: angle, unit: deg, wrap: 360}""",
        files={
            "a.csv": table(
                "ms,right,left,x,y,heading",
                *(1e3 * TIMES, ticks(turned(RIGHT)), np.mod(np.degrees(turned(LEFT)), 360), X, Y, YAW),
            )
        },
    ),
    "rpm and m/s": given(
        TWO,
        POSES,
        """\
log:
  inputs:
    wheel_speed_right: {column: right_rpm, unit: rpm, held: between}
    wheel_speed_left: {column: left_mps, unit: m/s, radius: 5 cm, held: between}
  poses: {x: {column: x_mm, unit: mm}, y: {column: y_mm, unit: mm}, heading: {column: yaw, unit: deg}}""",
        files={
            "a.csv": table(
                "t,right_rpm,left_mps,x_mm,y_mm,yaw",
                *(TIMES, RIGHT * 30 / np.pi, 0.05 * LEFT, 1e3 * X, 1e3 * Y, DEGREES),
            )
        },
    ),
    "steering encoder": given(
        "robot: {kind: tricycle, wheel_radius: 30 cm, wheelbase: 1.7 m, steering_gain: 1}",
        POSES,
        """\
log:
  inputs:
    wheel_speed: {column: rim, unit: m/s, radius: 30 cm, held: between}
    steering_angle:
      {column: steering, form: ticks, ticks_per_turn: 4096, cumulative: true, wrap: 4096,
        zero: 4000, sign: -1}""",
        files={
            "a.csv": table(
                "t,rim,steering,x,y,heading", TIMES, RIGHT, np.mod(ticks(YAW / 9) + 4000, 4096), X, Y, YAW
            )
        },
    ),
    "omni, a radius of each wheel": given(
        """\
robot:
  kind: omni_three
  wheel_radius_front_left: 51 mm
  wheel_radius_rear: 51 mm
  wheel_radius_front_right: 51 mm
  centre_distance: 195 mm""",
        POSES,
        """\
log:
  time: 0
  inputs:
    wheel_speed_front_left: {column: 4, form: ticks, ticks_per_turn: 12288}
    wheel_speed_rear: {column: 5, form: ticks, ticks_per_turn: 12288}
    wheel_speed_front_right: {column: 6, form: ticks, ticks_per_turn: 12288}
  poses: {x: 1, y: 2, heading: 3}""",
        files={"a.csv": table("", TIMES, X, Y, YAW, *np.round([99 * RIGHT, 99 * LEFT, 9 * RIGHT]))},
    ),
    "mecanum, a radius of each wheel": given(
        """\
robot:
  kind: mecanum
  wheel_radius_front_left: 5 cm
  wheel_radius_front_right: 5 cm
  wheel_radius_rear_left: 5 cm
  wheel_radius_rear_right: 5 cm
  half_wheelbase_plus_half_track: 35 cm""",
        POSES,
        """\
log:
  time: stamp
  inputs:
    wheel_speed_front_left: {column: fl, unit: rpm}
    wheel_speed_front_right: {column: fr, form: angle, unit: deg, wrap: 360}
    wheel_speed_rear_left: {column: rl, form: ticks, ticks_per_turn: 2048, gear: 12}
    wheel_speed_rear_right: {column: rr, unit: m/s, sign: -1}
  poses: {file: "{stem}_mocap.csv", time: stamp, x: x, y: y, heading: {column: yaw, unit: deg}}""",
        files={
            "a.csv": table(
                "stamp,fl,fr,rl,rr",
                *(
                    TIMES,
                    9 * RIGHT,
                    np.mod(np.degrees(turned(RIGHT)), 360),
                    np.round(99 * LEFT),
                    -0.05 * LEFT,
                ),
            ),
            "a_mocap.csv": table("stamp,x,y,yaw", TIMES, X, Y, DEGREES),
        },
    ),
    "relative poses": given(
        TWO,
        """\
measurement: {kind: relative_poses, noise: {position: 1 mm, heading: 0.1 deg}}
log:
  relative_poses:
    file: "{stem}_matches.csv"
    t0: t0
    t1: t1
    x: dx
    y: dy
    heading: {column: dtheta, unit: deg}
    covariance: {xx: c_xx, yy: c_yy, hh: c_hh, xy: c_xy}""",
        files={**INPUTS, "a_matches.csv": table("t0,t1,dx,dy,dtheta,c_xx,c_yy,c_hh,c_xy", *MATCHES)},
    ),
    "tuples": given(
        TWO,
        """\
measurement: {kind: relative_poses, noise: {position: 1 mm, heading: 0.1 deg}}
log: {kind: tuples}
calibration: {clock_offset: false, loss: cauchy}""",
        files={"a.tuple": [[TUPLE] for _ in TIMES]},
    ),
    "commands of v and omega": given(
        "robot: {kind: unicycle, lag_v: 150 ms, lag_omega: 150 ms}",
        POSES,
        """\
log:
  time: time
  inputs: {v: v_cmd, omega: {column: w_cmd, unit: deg/s}}
  poses: {file: "{stem}_tracker.csv", time: {column: ms, unit: ms}, x: px, y: py, heading: yaw}""",
        files={
            "a.csv": table("time,v_cmd,w_cmd", TIMES, 0.05 * RIGHT, 9 * LEFT),
            "a_tracker.csv": table("ms,px,py,yaw", 1e3 * TIMES, X, Y, YAW),
        },
    ),
    "odometry as poses": given(
        "robot: {kind: unicycle, omega_per_v: 0}",
        POSES,
        """\
log:
  inputs: {form: poses, x: odom_x, y: odom_y, heading: {column: odom_yaw, unit: deg}}
  poses: {x: mocap_x, y: mocap_y, heading: mocap_yaw}""",
        files={
            "a.csv": table(
                "t,odom_x,odom_y,odom_yaw,mocap_x,mocap_y,mocap_yaw", TIMES, X, Y, DEGREES, X, Y, YAW
            )
        },
    ),
    "landmarks, unknown map": given(
        TWO,
        """\
measurement:
  - kind: landmarks
    landmarks: [[2 m, 2 m], [-2 m, 1 m]]
    ids: [7, 12]
    noise: {range: 3 cm, bearing: 1 deg}
    map: unknown
log:
  poses: none
  sensors:
    landmarks: {file: "{stem}_seen.csv", id: id, range: range, bearing: {column: angle, unit: deg}}""",
        files={**INPUTS, "a_seen.csv": sights("t,id,range,angle")},
    ),
    "tags": given(
        TWO,
        """\
measurement:
  - kind: tags
    tags: [[2 m, 2 m, 90 deg], [-2 m, 1 m, 0 deg]]
    ids: [7, 12]
    noise: {range: 2 cm, bearing: 1 deg, orientation: 3 deg}
log:
  poses: none
  sensors: {tags: {file: "{stem}_tags.csv", id: tag, unit: deg, range: {column: range, unit: m}}}""",
        files={**INPUTS, "a_tags.csv": sights("t,tag,range,bearing,orientation", "15")},
    ),
    "ranges": given(
        TWO,
        """\
measurement: {kind: ranges, beacons: [[3 m, 0 m], [0 m, 3 m], [-3 m, -3 m]], noise: 5 cm, bias: unknown}
log:
  poses: none
  sensors: {ranges: {columns: [range_1, range_2, range_3]}}""",
        files={"a.csv": table(f"{WHEELS},range_1,range_2,range_3", TIMES, RIGHT, LEFT, 3 - X, 3 - Y, 4 + X)},
    ),
    "gyro, bias and scale": given(
        TWO,
        """\
measurement:
  - {kind: poses, noise: {position: 2 mm, heading: 0.3 deg}}
  - {kind: yaw_rate, noise: 0.3 deg/s, bias: unknown, scale: 1 %}
log:
  sensors: {yaw_rate: {file: "{stem}_imu.csv", time: {column: us, unit: us}, column: gz, unit: deg/s}}""",
        files={**ROWS, "a_imu.csv": table("us,gz,temperature", 1e6 * TIMES, LEFT, RIGHT)},
    ),
    "GNSS, lever arm and latency": given(
        TWO,
        """\
measurement:
  kind: poses
  quantities: [x, y]
  noise: {position: 2 cm}
  latency: unknown
  lever_arm: {x: 10 cm, y: 0 cm}
log:
  poses: {file: "{stem}_rtk.csv", time: utc, x: easting, y: northing, heading: none}""",
        files={**INPUTS, "a_rtk.csv": table("utc,easting,northing", TIMES, X + 4e5, Y + 5e6)},
    ),
    "rows of types": given(
        TWO,
        POSES,
        """\
log:
  records: {column: 0, inputs: odom, poses: mocap}
  time: 1
  inputs: {wheel_speed_right: 2, wheel_speed_left: 3}
  poses: {x: 2, y: 3, heading: 4}""",
        files={"a.csv": of_types()},
    ),
    "dates": given(TWO, POSES, "log: {time: stamp}", files={"a.csv": dated()}),
    "TUM": given(TWO, POSES, 'log: {poses: {file: "{stem}.tum"}}', files={**INPUTS, "a.tum": tum()}),
    "hold-out": given(TWO, POSES, "log: {}", files=ROWS, options={"hold_out": 0.25}),
    "decimation": given(TWO, POSES, "log: {thin: 4}", files=ROWS),
    "NaN skipped": given(TWO, POSES, "log: {skip_invalid_rows: true}", files=ROWS),
    "bag: JointState, PoseStamped": given(
        TWO,
        POSES,
        """\
log:
  kind: rosbag
  joint_states: /joint_states
  inputs:
    wheel_speed_right: {joint: base_wheel_right_joint}
    wheel_speed_left: {joint: base_wheel_left_joint}
  poses: {topic: /mocap}""",
        messages=[*joint_states(), *tracked()],
        bag="drive",
    ),
    "bag: ROS 1, Twist": given(
        "robot: {kind: unicycle}",
        POSES,
        "log: {kind: rosbag, commands: /cmd_vel, poses: /mocap}",
        messages=first(
            [*commanded("Twist", types=STORES["ros1"].types), *reference(types=STORES["ros1"].types)]
        ),
        bag="drive.bag",
    ),
    "bag: TwistStamped": given(
        "robot: {kind: unicycle}",
        POSES,
        "log: {kind: rosbag, commands: /cmd_vel, poses: /mocap}",
        messages=first([*commanded(), *reference()]),
    ),
    "bag: Odometry": given(
        "robot: {kind: unicycle}",
        POSES,
        """\
log:
  kind: rosbag
  inputs: {form: poses, topic: /odom}
  poses: {topic: /mocap}""",
        messages=first([*odometry(), *reference()]),
    ),
    "bag: AckermannDriveStamped": given(
        "robot: {kind: ackermann, wheel_radius: 10 cm, wheelbase: 50 cm}",
        POSES,
        "log: {kind: rosbag, commands: /drive, poses: /mocap}",
        messages=first([*cars(), *reference()]),
    ),
    "bag: TF": given(
        TWO,
        POSES,
        "log: {kind: rosbag, poses: {topic: /tf, frame: odom, child: base_link}}",
        messages=[*joint_states(), *tracked("tf2_msgs/msg/TFMessage", "/tf")],
    ),
    "bag: PoseWithCovarianceStamped": given(
        TWO,
        POSES,
        "log: {kind: rosbag, poses: /amcl}",
        messages=[*joint_states(), *tracked("geometry_msgs/msg/PoseWithCovarianceStamped", "/amcl")],
    ),
    "bag: Imu": given(
        TWO,
        """\
measurement:
  - {kind: poses, noise: {position: 2 mm, heading: 0.3 deg}}
  - {kind: yaw_rate, noise: 0.3 deg/s, bias: unknown}
log: {kind: rosbag, sensors: {yaw_rate: {topic: /imu, field: angular_velocity.z}}}""",
        messages=[*joint_states(), *tracked(), *first(imu())],
    ),
    "bag: fields by path": given(
        TWO,
        POSES,
        """\
log:
  kind: rosbag
  inputs:
    wheel_speed_right: {topic: /wheels, field: "speeds[0]"}
    wheel_speed_left: {topic: /wheels, field: "wheels[0].velocity", unit: rpm}
  poses: {topic: /mocap, x: pose.position.x, y: pose.position.y, heading: pose.orientation}""",
        messages=[*first(own_messages()), *tracked()],
    ),
    "bag: landmarks": given(
        TWO,
        """\
measurement:
  kind: landmarks
  landmarks: [[3 m, 0 m], [0 m, 3 m]]
  ids: [4, 9]
  noise: {range: 2 cm, bearing: 1 deg}
log:
  kind: rosbag
  poses: none
  sensors:
    landmarks: {topic: /seen, each: poses, id: position.z, range: position.x, bearing: position.y}""",
        messages=[*joint_states(), *markers([(0.1 * at, [(4, 2, 0.5), (9, 1, -0.2)]) for at in range(9)])],
    ),
    "bag: ranges": given(
        TWO,
        """\
measurement: {kind: ranges, beacons: [[3 m, 0 m], [0 m, 3 m]], noise: 5 cm}
log: {kind: rosbag, poses: none, sensors: {ranges: {topics: [/uwb/1, /uwb/2], field: range}}}""",
        messages=[*joint_states(), *first(beacon("/uwb/1", 1.0, 0.0)), *first(beacon("/uwb/2", 2.0, 0.01))],
    ),
}
"""The study and the log of each, unbroken: what fails is the fault."""

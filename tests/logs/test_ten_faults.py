"""Ten faults of every format of a log: each is refused by a message that says where it is, and what to do.

The study of each format has 30 lines at most. A fault of a table is named by file and line, one of a bag by
its topic and the message that it is in, one of the study by its line. What is raised is a mistake of the
user, which the command line answers with exit code 2.
"""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from formats import (
    FEW,
    FORMATS,
    INF,
    MOST_LINES,
    NAN,
    STUDY,
    TUPLE,
    TWO,
    Fault,
    Given,
    asked,
    cell,
    harmed,
    head,
    joint_states,
    later,
    messages,
    rows,
    storage,
    study,
    usual,
    usual_stamps,
    value,
    whole,
    without,
)

from oed.foundation.errors import UserMistake
from oed.logs import read_logs
from oed.workflow.estimate_logs import estimate
from oed.workflow.studies import parse_study

FINITE, KIND = "expected a finite number, got ", "whose unit is of another kind"
MANY, KNOWN = "expected one topic to choose from", "the bag has no topic"


def stray(text: str, table: list[list[str]]) -> None:
    """A line among the others that is no row."""
    table.insert(7, [text])


def of_text(column: str, text: str, table: list[list[str]]) -> None:
    """A column without numbers."""
    for row in table[1:]:
        row[table[0].index(column)] = text


FAULTS: dict[str, list[Fault]] = {
    "ticks": [
        *usual("a.csv", "ms", "right"),
        cell("a.csv", 8, "right", "9000", "more than `wrap: 4096` allows"),
        cell("a.csv", 8, "left", "720", "more than `wrap: 360` allows"),
        head("a.csv", "right", "rechts", "the header lacks 'right'"),
        study("ticks_per_turn: 1024, ", "", "ticks_per_turn: missing"),
        study(", cumulative: true", "", "`wrap` is of a cumulative counter; add `cumulative: true`"),
        study("gear: 4", "gear: 0", "gear: expected more than 0"),
        study("unit: ms", "unit: h", "expected 's', 'ms', 'us' or 'ns', got 'h'"),
    ],
    "rpm and m/s": [
        *usual("a.csv", "t", "left_mps"),
        *(
            rows("a.csv", 8, partial(stray, text), "a.csv:8: expected 6 cells, as in the first line, got 1")
            for text in ("Segmentation fault", 6 * "\0", "0.3;1;2;3;4;5", "0.3\t1\t2\t3\t4\t5")
        ),
        cell("a.csv", 8, "right_rpm", "1,5", "expected 6 cells, as in the first line, got 7"),
        Fault(
            cell("a.csv", 8, "right_rpm", "9000", "").change,
            "a.csv: the measured poses hardly move",
            "; right_rpm reads 9000 rpm at t = 0.3 s (line 8), where at most ",
        ),
        cell("a.csv", 8, "y_mm", "1e16", "expected a number of at most 1e+12 in SI units"),
        head("a.csv", "right_rpm", "right_rad", "the header lacks 'right_rpm'"),
        study("unit: rpm", "unit: V", "whose unit is of another kind"),
        study("column: yaw, unit: deg", "column: yaw, unit: mm", "expected an angle [rad], got 'mm'"),
        study("radius: 5 cm", "radius: 0 cm", "radius: expected more than 0"),
    ],
    "steering encoder": [
        *usual("a.csv", "t", "steering"),
        cell("a.csv", 8, "steering", "9000", "`wrap: 4096`"),
        cell("a.csv", 8, "steering", "1960", "the counter jumps by about half of its range"),
        study("form: ticks", "form: angle", "ticks_per_turn: does not go with the keys beside it"),
        study("radius: 30 cm, held", "zero: 3, held", "zero: does not go with the keys beside it"),
        study("sign: -1", "sign: 2", "sign: expected 1 or -1, got 2"),
        study("steering_angle:", "steering:", "the robot has no input steering"),
    ],
    "omni, a radius of each wheel": [
        *usual("a.csv", 0, 4, first=1),
        cell("a.csv", 7, 6, "inf", f"column 6: {FINITE}'inf'"),
        study("front_right: {column: 6", "front_right: {column: 7", "there is no column 7; the last"),
        study("front_right: {column: 6", "front_right: {column: 5", "column 5 is read as"),
        study("wheel_speed_rear:", "wheel_speed_back:", "the robot has no input wheel_speed_back"),
        study("wheel_radius_rear: 51 mm", "wheel_radius_rear: 0 mm", "expected more than 0"),
        study("wheel_radius_rear: 51 mm", "wheel_radius_back: 51 mm", "wheel_radius_back: unknown key"),
    ],
    "mecanum, a radius of each wheel": [
        *usual("a.csv", "stamp", "rl"),
        *usual("a_mocap.csv", "stamp", "yaw")[::3],
        cell("a.csv", 8, "fr", "720", "more than `wrap: 360` allows"),
        whole("a_mocap.csv", b"stamp,x,y,yaw\n", "the file has no rows after its header"),
        study("wheel_radius_rear_left: 5 cm", "wheel_radius_rear_left: 5 s", f"got '5 s', {KIND}"),
        study("sign: -1", "ticks_per_turn: 3", "ticks_per_turn: does not go with the keys beside it"),
        study("_mocap", "_vicon", "no such file (named in"),
        study(
            "_mocap",
            "_mocups",
            "no such file; did you mean a_mocap.csv? (named in study.yaml:18: log.poses.file)",
        ),
    ],
    "relative poses": [
        *usual("a.csv", "t", "wheel_speed_left"),
        cell("a_matches.csv", 5, "t1", "0.1", "not before its end at 0.1 s"),
        cell("a_matches.csv", 5, "t0", "now", f"{FINITE}'now'"),
        cell("a_matches.csv", 5, "dtheta", "", "dtheta: expected a finite number, the cell is empty"),
        *(
            cell("a_matches.csv", 5, name, "", f"{name}: expected a finite number, the cell is empty")
            for name in ("dx", "c_xx", "c_yy", "c_hh", "c_xy", "t0")
        ),
        cell("a_matches.csv", 5, "dx", "1e25", "expected a number of at most"),
        cell("a_matches.csv", 5, "c_xx", "-1", "the covariance is not positive definite"),
        cell("a_matches.csv", 5, "c_xy", "1", "the covariance is not positive definite"),
        head("a_matches.csv", "dtheta", "dyaw", "the header lacks 'dtheta'"),
        whole("a_matches.csv", None, "no such file"),
        study("    t0: t0\n", "", "t0 and t1 belong together"),
        study("yy: c_yy, ", "", "yy: missing"),
        study("unit: deg", "unit: m", KIND),
    ],
    "tuples": [
        *(
            cell("a.tuple", 7, 0, TUPLE.replace(*change), words)
            for change, words in (
                (("0.8", "0"), "T: expected a duration above 0 s"),
                (("0.8", "-0.8"), "got -0.8"),
                (("phi_r", "phi"), "phi_r: is missing"),
                (("0.5", "NaN"), f"phi_l: {FINITE}nan"),
                (("0.5", '"fast"'), f"phi_l: {FINITE}'fast'"),
                ((", -0.03", ""), "sm: expected x, y and heading"),
                (("-0.03", "null"), f"sm: {FINITE}None"),
                (("}", ""), "expected a tuple as JSON"),
                ((TUPLE, "0.8 0.5 -0.25"), "expected a tuple as JSON"),
                ((TUPLE, "[0.8, 0.5, -0.25]"), "expected a tuple like"),
            )
        ),
        whole("a.tuple", b"\n", "holds no tuples"),
        whole("a.tuple", b"\xff\xfe\x00", "not UTF-8 text"),
        study(TWO, "robot: {kind: tricycle, wheel_radius: 5 cm, wheelbase: 20 cm}", "tuples are of a robot"),
    ],
    "commands of v and omega": [
        *usual("a.csv", "time", "w_cmd"),
        *usual("a_tracker.csv", "ms", "px")[::3],
        head("a.csv", "v_cmd", "speed", "the header lacks 'v_cmd'"),
        study("unit: deg/s", "unit: m/s", KIND),
        study("{v: v_cmd", "{speed: v_cmd", "the robot has no input speed; it has v, omega"),
        study("kind: unicycle, lag_v: 150 ms", "kind: unicycle, lag_v: 150 m", f"got '150 m', {KIND}"),
        rows("a_tracker.csv", 2, later, "the clocks do not overlap"),
    ],
    "odometry as poses": [
        *usual("a.csv", "t", "odom_yaw"),
        head("a.csv", "odom_y", "y", "the header lacks 'odom_y'"),
        cell("a.csv", 8, "odom_x", "1e14", "expected a number of at most"),
        study("column: odom_yaw, unit: deg", "column: odom_yaw, unit: mm", KIND),
        study("x: mocap_x, y: mocap_y", "x: odom_x, y: odom_y", "the poses are those of `poses`"),
        study("robot: {kind: unicycle, omega_per_v: 0}", TWO, "take `robot: {kind: unicycle}`"),
    ],
    "landmarks, unknown map": [
        *usual("a_seen.csv", "t", "range")[:2],
        *usual("a_seen.csv", "t", "range")[3:],
        cell("a_seen.csv", 8, "t", "", "t: expected a finite number, the cell is empty"),
        cell("a_seen.csv", 8, "id", "8", "landmarks has no id '8'; the study has 7 and 12"),
        cell("a_seen.csv", 8, "id", "", "landmarks has no id ''"),
        cell("a_seen.csv", 8, "id", "nan", "id: landmarks has no id 'nan'; the study has 7 and 12"),
        cell("a_seen.csv", 8, "id", "inf", "id: landmarks has no id 'inf'; the study has 7 and 12"),
        study(
            "ids: [7, 12]",
            "ids: [7]",
            "measurement.0.ids: expected one id for each of the 2 landmarks, got 1",
        ),
        study("ids: [7, 12]", "ids: [7, 9, 12]", "measurement.0.ids: expected one id for each of"),
        cell("a_seen.csv", 9, "id", "7", "7 is read a second time"),
        cell("a_seen.csv", 8, "range", "-2", "a distance is not below 0, got -2 m"),
        cell("a_seen.csv", 8, "angle", "500", "8.72665 rad is more than 6.28"),
        head("a_seen.csv", "angle", "bearing", "the header lacks 'angle'"),
        study("    map: unknown", "    map: guessed", "map: expected"),
        study("    landmarks: {file", "    landmark: {file", "did you mean landmarks?"),
    ],
    "tags": [
        *usual("a_tags.csv", "t", "bearing")[:2],
        cell("a_tags.csv", 8, "tag", "9", "tags has no id '9'; the study has 7 and 12"),
        study("ids: [7, 12]", "ids: [7]", "measurement.0.ids: expected one id for each of the 2 tags, got 1"),
        cell("a_tags.csv", 9, "tag", "7", "7 is read a second time"),
        cell("a_tags.csv", 8, "orientation", "400", "rad is more than 6.28"),
        cell("a_tags.csv", 8, "range", "-1", "a distance is not below 0"),
        head("a_tags.csv", "orientation", "yaw", "the header lacks 'orientation'"),
        whole("a_tags.csv", None, "no such file"),
        study("_tags", "_tsgs", "did you mean a_tags.csv? (named in study.yaml:11: log.sensors.tags.file)"),
        study("unit: m}", "unit: s}", KIND),
        study("id: tag, ", "", "expected 6 columns"),
        study("90 deg], ", "90 m], ", f"got '90 m', {KIND}"),
        study(", orientation: 3 deg", "", "the noise of orientation is needed"),
    ],
    "ranges": [
        *usual("a.csv", "t", "range_2"),
        cell("a.csv", 8, "range_3", "1e13", "ranges[3]: expected a number of at most 1e+12 in SI units"),
        cell("a.csv", 8, "range_3", "-0.5", "a distance is not below 0, got -0.5 m"),
        head("a.csv", "range_3", "range_4", "the header lacks 'range_3'"),
        study("range_1, range_2, range_3", "range_1, range_2", "expected 3 columns (ranges[1], ran"),
        study("range_3]", "range_3], unit: s", KIND),
        study("sensors: {ranges:", "sensors: {range:", "did you mean ranges?"),
    ],
    "gyro, bias and scale": [
        *usual("a_imu.csv", "us", "gz")[:2],
        *usual("a_imu.csv", "us", "gz")[3:],
        cell("a_imu.csv", 8, "us", "", "us: expected a finite number, the cell is empty"),
        rows(
            "a_imu.csv",
            8,
            lambda own: [["lost"] if line == 8 else row[:2] for line, row in enumerate(own, 1)],
            "a_imu.csv:8: expected 2 cells, as in the first line, got 1",
        ),
        cell("a_imu.csv", 8, "gz", "5730", "rad/s is more than 30; in degrees say `unit: deg/s`"),
        head("a_imu.csv", "gz", "gyro", "the header lacks 'gz'"),
        rows("a_imu.csv", 2, later, "outside of the log's, from 0 to 1.95 s"),
        study("unit: deg/s}", "unit: deg}", KIND),
        study("unit: us", "unit: min", "expected 's', 'ms', 'us' or 'ns'"),
        study("scale: 1 %", "scale: -1 %", "scale: expected 'unknown' or 'known', got '-1 %'"),
    ],
    "GNSS, lever arm and latency": [
        *usual("a_rtk.csv", "utc", "northing"),
        cell("a_rtk.csv", 8, "easting", "1e13", "expected a number of at most 1e+12 in SI units"),
        head("a_rtk.csv", "utc", "time", "the header lacks 'utc'"),
        rows("a_rtk.csv", 2, lambda own: own[:3], "has 2 row(s) of poses; at least 3 are needed"),
        study("latency: unknown", "latency: late", "latency: expected 'known' or 'unknown', got 'late'"),
        study("lever_arm: {x: 10 cm", "lever_arm: {x: 10 s", f"got '10 s', {KIND}"),
        study("quantities: [x, y]", "quantities: [x, z]", "expected 'x', 'y' or 'heading', got 'z'"),
    ],
    "rows of types": [
        cell("a.csv", 7, 2, "lost", f"{FINITE}'lost'"),
        cell("a.csv", 7, 1, "", "the cell is empty"),
        cell("a.csv", 7, 2, "inf", f"{FINITE}'inf'"),
        rows("a.csv", 7, lambda own: own[6].append("9"), "cells, as in the first line, got"),
        rows("a.csv", 7, lambda own: own[6].pop(), "the cell is empty"),
        rows("a.csv", 8, lambda own: own.insert(7, own[0]), "time goes back"),
        study("inputs: odom", "inputs: odo", "no row is of type 'odo'; the types are odom (40 rows)"),
        study("poses: mocap", "poses: 3", "no row is of type 3"),
        study("column: 0, inputs", "column: 9, inputs", "there is no column 9"),
        study("records: {column: 0", "records: {column: kind", "the file has no header"),
        study("poses: mocap", "pose: mocap", "pose: unknown key; did you mean poses?"),
        whole("a.csv", b"# nothing\n", "the file has no rows"),
    ],
    "dates": [
        rows(
            "a.csv",
            9,
            lambda own: own.insert(8, own[5]),
            "time goes back: 1717164187.2 s after 1717164187.3 s",
        ),
        *(
            cell("a.csv", 8, 0, stamp, words)
            for stamp, words in (
                ("31.05.2024 14:03", "expected a date and time as 2024-05-31 14:03:07.25"),
                ("12.5", "(ISO 8601), got '12.5'"),
                ("", "the cell is empty"),
                ("2024-05-31T25:00:00+00:00", "(ISO 8601), got '2024-05-31T25:00:00+00:00'"),
                ("2024-02-30T14:03:07+00:00", "(ISO 8601), got '2024-02-30T14:03:07+00:00'"),
                ("2024-05-31T14:03:07.3", "lacks the time zone that other rows have"),
                ("2024-05-31T14:03:07+00:00", "time goes back"),
            )
        ),
        head("a.csv", "stamp", "date", "the header lacks 'stamp'"),
        study("{time: stamp}", "{time: {column: stamp, form: date, unit: ms}}", "a date has no unit"),
        study("{time: stamp}", "{time: {column: stamp, form: day}}", "'number' or 'date', got 'day'"),
    ],
    "TUM": [
        *(
            cell("a.tum", 7, 0, line, words)
            for line, words in (
                ("0.3 0 0 0 0 0 0 2", "expected a unit quaternion in qx qy qz qw"),
                ("0.3 0 0 0 0 0 0 w", f"{FINITE}'w'"),
                ("0.3 nan 0 0 0 0 0 1", f"{FINITE}'nan'"),
                ("0.3 0 0 0 0 0 0", "the cell is empty"),
                ("0.3 0 0 0 0 0 0 1 9", "expected 8 cells, as in the first line, got 9"),
                ("0.1 0 0 0 0 0 0 1", "time goes back"),
                ("0.3 1e13 0 0 0 0 0 1", "expected a number of at most"),
                ("0.3,0,0,0,0,0,0,1", "expected 8 cells, as in the first line, got 1"),
            )
        ),
        rows(
            "a.tum",
            1,
            lambda own: [["0 1 2 3"]] * 9,
            "expected 8 columns (timestamp tx ty tz qx qy qz qw), got 4",
        ),
        whole("a.tum", None, "no such file"),
        whole("a.tum", b"# timestamp tx ty tz qx qy qz qw\n", "the file has no rows"),
        study(".tum", '.tum", keep: {good: 1}, time: "t', "a TUM file has no further columns"),
    ],
    "hold-out": [
        *usual("a.csv", "t", "x"),
        rows(
            "a.csv", 0, lambda own: own[:6], "holding out the last 25 % of 200 ms leaves 1 of 5 poses in them"
        ),
        asked("leaves 1 of 40 poses before them", hold_out=0.999),
        asked("leaves 1 of 40 poses in them", hold_out=0.001),
    ],
    "decimation": [
        *usual("a.csv", "t", "x"),
        study("thin: 4", "thin: 20", "one in 20 of 40 poses leaves 2; at least 3 are needed"),
        study("thin: 4", "thin: 0", "thin: expected at least 1"),
        study("thin: 4", "thin: 1.5", "thin: expected"),
        study("thin: 4", "thin: ten", "thin: expected"),
        study("thin: 4", "thinn: 4", "thinn: unknown key; did you mean thin?"),
    ],
    "NaN skipped": [
        *(
            rows(
                "a.csv", 2, partial(of_text, name, "lost"), f"{name}: expected finite numbers, and the column"
            )
            for name in ("x", "t", "wheel_speed_left")
        ),
        *usual("a.csv", "t", "x")[3:],
        head("a.csv", "x", "px", "the header lacks 'x'"),
        rows(
            "a.csv", 2, lambda own: [own[0], *([*r[:3], "nan", *r[4:]] for r in own[1:])], f"x: {FINITE}'nan'"
        ),
        rows(
            "a.csv",
            2,
            lambda own: [*own[:3], *([*r[:3], "nan", *r[4:]] for r in own[3:])],
            "has 2 row(s) of poses",
        ),
        cell("a.csv", 8, "x", "1e13", "expected a number of at most 1e+12"),
        study("skip_invalid_rows: true", "skip_invalid_rows: some", "skip_invalid_rows: expected"),
        study("skip_invalid_rows", "skip_invalid", "did you mean skip_invalid_rows?"),
    ],
    "bag: JointState, PoseStamped": [
        value("/joint_states", 5, "position[0]", NAN, f"{FINITE}'nan'"),
        value("/joint_states", 5, "position[1]", INF, f"{FINITE}'inf'"),
        value(
            "/joint_states",
            5,
            "name[1]",
            "base_wheel_right_joint",
            "the joint base_wheel_right_joint is named twice",
        ),
        value("/joint_states", 5, "position", np.zeros(1), "expected as many as names, 2, got 1", "position"),
        value("/joint_states", 5, "velocity", np.zeros(3), "expected as many as names, 2, got 3", "velocity"),
        value("/joint_states", 5, "position[1]", 1e9, "the counter jumps from", "base_wheel_left_joint"),
        value("/mocap", 5, "pose.position.x", NAN, f"{FINITE}'nan'"),
        value("/mocap", 5, "pose.orientation.w", 5.0, "expected a unit quaternion"),
        *usual_stamps("/joint_states"),
        *usual_stamps("/mocap"),
        study("joint_states: /joint_states", "joint_states: /joints", KNOWN),
        study("joint_states: /joint_states", "joint_states: /mocap", "/mocap is of type geom"),
        study(
            "wheel_left_joint",
            "wheel_right_joint",
            "log.inputs.wheel_speed_left: joint base_wheel_right_joint is read",
        ),
        study(
            "_right: {joint: base_wheel_right_joint}\n    wheel_speed_left: {joint: base_wheel_left_joint}",
            "_right: {joint: base_wheel_left_joint}",
            "wheel_speed_left: it is not clear which joint this is; the bag has base_wheel_right_joint, base",
        ),
        study("base_wheel_right_joint", "right", "no joint right; did you mean base_wheel_right_joint?"),
        study("topic: /mocap", "topic: /vicon", f"{KNOWN} /vicon; of type Odometry or"),
        messages(
            lambda own: [*own[:10], (*own[9][:2], own[3][2]), *own[10:]],
            "drive: /joint_states: message 11: ",
            "time goes back: 1700000000.15 s after 1700000000.45 s",
        ),
        Fault(
            value("/joint_states", 5, "header.stamp.sec", 0, "").change,
            "study.yaml: log: ",
            "times have to rise: `clock: received` takes those of the recording",
        ),
        without("/mocap", f"{KNOWN} /mocap", "poses"),
        harmed(
            lambda path: (path / "metadata.yaml").unlink(), "is no ROS bag: expected a folder with metadata"
        ),
        harmed(lambda path: storage(path).unlink(), "cannot be read as a ROS bag"),
        harmed(
            lambda path: storage(path).write_bytes(storage(path).read_bytes()[:999]),
            "cannot be read as a ROS bag",
        ),
    ],
    "bag: ROS 1, Twist": [
        value("/cmd_vel", 5, "linear.x", NAN, f"{FINITE}'nan'"),
        value("/cmd_vel", 5, "angular.z", INF, f"{FINITE}'inf'"),
        value("/mocap", 5, "pose.position.y", NAN, f"{FINITE}'nan'"),
        value("/mocap", 5, "pose.orientation.z", 9.0, "expected a unit quaternion"),
        *usual_stamps("/mocap"),
        without("/cmd_vel", f"{KNOWN} /cmd_vel", "commands"),
        without("/mocap", f"{KNOWN} /mocap", "poses"),
        harmed(lambda path: path.write_bytes(path.read_bytes()[:999]), "cannot be read as a ROS bag"),
        harmed(lambda path: path.write_bytes(b"#ROSBAG V1.2\n"), "cannot be read as a ROS bag"),
        harmed(lambda path: path.write_bytes(b""), "cannot be read as a ROS bag"),
        study("/cmd_vel", "/cmd", f"{KNOWN} /cmd; did you mean /cmd_vel?"),
        study("/cmd_vel", "/mocap", "/mocap is of type geometry_msgs/msg/PoseStamped"),
    ],
    "bag: TwistStamped": [
        value("/cmd_vel", 5, "twist.linear.x", NAN, f"{FINITE}'nan'"),
        value("/cmd_vel", 5, "twist.angular.z", -INF, f"{FINITE}'-inf'"),
        *usual_stamps("/cmd_vel"),
        without("/cmd_vel", f"{KNOWN} /cmd_vel", "commands"),
        study(
            "commands:",
            "joint_states: /joints, commands:",
            "log.joint_states: no input is a joint's; leave it out",
        ),
        study(
            "commands: /cmd_vel",
            "commands: /cmd_vel, inputs: {form: poses, topic: /odom}",
            "log.commands: no input is a command; leave it out",
        ),
        study("commands: /cmd_vel", "inputs: {v: {topic: /cmd_vel, field: v}}", "has no field v; it has"),
        study("commands: /cmd_vel", "inputs: {v: {topic: /cmd_vel, unit: rad/s}}", KIND),
        study("commands: /cmd_vel", "inputs: {v: {topic: /mocap}}", "say in which `field` it is"),
        study("commands: /cmd_vel", "inputs: {speed: {topic: /cmd_vel}}", "the robot has no input speed"),
        study("poses: /mocap", "poses: /cmd_vel", "/cmd_vel is of type geometry_msgs/msg/TwistStamped"),
        study("robot: {kind: unicycle}", TWO, "log.commands: no message has wheel_speed_right"),
    ],
    "bag: Odometry": [
        value("/odom", 5, "pose.pose.position.x", NAN, f"{FINITE}'nan'"),
        value("/odom", 5, "pose.pose.orientation.z", INF, f"{FINITE}'inf'"),
        value("/odom", 5, "pose.pose.orientation.w", 3.0, "expected a unit quaternion"),
        *usual_stamps("/odom"),
        without("/odom", f"{KNOWN} /odom", "inputs"),
        study("topic: /odom", "topic: /odometry", f"{KNOWN} /odometry; did you mean /odom?"),
        study("topic: /mocap", "topic: /odom", "/odom is the robot's own odometry"),
        study(
            "topic: /odom}",
            "topic: /odom, frame: map}",
            "of the frame map; it has odom -> base_link (named in study.yaml:7: log.inputs.frame)",
        ),
        study("topic: /odom}", "topic: /odom, child: laser}", "no poses in /odom of the child laser"),
        study("topic: /odom", "topc: /odom", "topc: unknown key; did you mean topic?"),
        study("robot: {kind: unicycle}", TWO, "take `robot: {kind: unicycle}`"),
    ],
    "bag: AckermannDriveStamped": [
        value("/drive", 5, "drive.speed", NAN, f"{FINITE}'nan'"),
        value("/drive", 5, "drive.steering_angle", INF, f"{FINITE}'inf'"),
        value("/drive", 5, "drive.steering_angle", 4.0, "the steering angle jumps by", "steering_angle"),
        *usual_stamps("/drive"),
        study("commands: /drive", "commands: /drives", f"{KNOWN} /drives; did you mean /drive?"),
        study("commands: /drive", "commands: /mocap", "/mocap is of type geometry_msgs/msg/PoseStamped"),
        study("kind: ackermann", "kind: tricycle", "no message has wheel_speed, steering_angle as commands"),
        *(
            study("commands: /drive", f"inputs: {{{name}: {{topic: /drive, {keys}}}}}", words)
            for name, keys, words in (
                (
                    "steering_angle",
                    "field: drive.steering",
                    "drive has no field steering; did you mean steering_",
                ),
                ("steering_angle", "unit: m", KIND),
                ("steering_angle", "form: speed", "its form is value, got 'speed'"),
                ("wheel_speed", "field: drive", "message 1: drive is no number: it has steering_angle"),
            )
        ),
    ],
    "bag: TF": [
        value("/tf", 5, "transforms[0].transform.translation.x", NAN, f"{FINITE}'nan'"),
        value("/tf", 5, "transforms[0].transform.translation.y", INF, f"{FINITE}'inf'"),
        value("/tf", 5, "transforms[0].transform.rotation.w", 0.0, "expected a unit quaternion"),
        *usual_stamps("/tf", "transforms[0].header.stamp"),
        without("/tf", f"{KNOWN} /tf", "poses"),
        study("topic: /tf", "topic: /tf_static", f"{KNOWN} /tf_static; did you mean /tf?"),
        study("frame: odom", "frame: map", "no poses in /tf of the frame map; it has odom -> base_link"),
        study("child: base_link", "child: base", "of the child base; did you mean base_link?"),
        study("frame: odom", "form: odom", "form: unknown key; did you mean frame?"),
        messages(
            lambda own: (*joint_states(), *own[-2:]),
            "drive: ",
            "has 2 row(s) of poses; at least 3 are needed",
        ),
    ],
    "bag: PoseWithCovarianceStamped": [
        value("/amcl", 5, "pose.pose.position.y", NAN, f"{FINITE}'nan'"),
        value("/amcl", 5, "pose.pose.position.x", -INF, f"{FINITE}'-inf'"),
        value("/amcl", 5, "pose.pose.orientation.z", 9.0, "expected a unit quaternion"),
        value("/amcl", 5, "pose.pose.position.y", 1e13, "expected a number of at most 1e+12", "y"),
        *usual_stamps("/amcl"),
        without("/amcl", f"{KNOWN} /amcl", "poses"),
        without("/joint_states", f"{MANY}; of type JointState it has none", "joint_states"),
        study("poses: /amcl", "poses: /amcl_pose", f"{KNOWN} /amcl_pose; did you mean /amcl?"),
        study("poses: /amcl", "poses: {topic: /amcl, x: pose.position.x}", "pose has no field position"),
        study("poses: /amcl", "poses: {topic: /amcl, frame: map}", "no poses in /amcl of the frame map"),
    ],
    "bag: Imu": [
        value("/imu", 5, "angular_velocity.z", NAN, f"{FINITE}'nan'"),
        value("/imu", 5, "angular_velocity.z", INF, f"{FINITE}'inf'"),
        value("/imu", 5, "angular_velocity.z", 57.0, "57 rad/s is more than 30", "yaw_rate"),
        value("/imu", 5, "header.stamp.sec", 0, "time goes back: 0.2 s after"),
        without("/imu", f"{KNOWN} /imu", "yaw_rate"),
        study("topic: /imu", "topic: /imus", f"{KNOWN} /imus; did you mean /imu?"),
        study(
            "angular_velocity.z",
            "angular_velocity",
            "drive: /imu: message 1: angular_velocity is no number: it has x, y, z (named in study.yaml",
        ),
        study("angular_velocity.z", "angular_veloctiy.z", "did you mean angular_velocity?"),
        study("angular_velocity.z", "angular_velocity..", "field: expected the path of a field, such as"),
        *usual_stamps("/imu")[1:],
        study("angular_velocity.z", "angular_velocity.z, unit: m", KIND),
        study("{yaw_rate: {topic", "{gyro: {topic", "has no gyro; it measures yaw_rate"),
        study("bias: unknown", "bias: none", "bias: expected 'unknown' or 'known', got 'none'"),
    ],
    "bag: fields by path": [
        value("/wheels", 5, "speeds[0]", NAN, f"{FINITE}'nan'"),
        value("/wheels", 5, "wheels[0].velocity", INF, f"{FINITE}'inf'"),
        value("/wheels", 5, "wheels", [], "wheels has 0 entries, from [0] on; there is no [0]"),
        value("/mocap", 5, "pose.orientation.w", 3.0, "expected a unit quaternion"),
        *usual_stamps("/wheels"),
        *(
            study('"speeds[0]"', path, f"{place}: {words}")
            for path, place, words in (
                ('"speeds[2]"', "/wheels: message 1", "speeds has 2 entries, from [0] on; there is no [2]"),
                ('"speed[0]"', "/wheels: message 1", "the message has no field speed; did you mean speeds?"),
                ("speeds", "/wheels: message 1", "speeds is no number: it has 2 entries"),
                ("state", "/wheels: message 1", "state is no number, but str"),
                ("speeds.0", "field", "expected the path of a field, such as wheel.left.velocity"),
            )
        ),
        study("unit: rpm", "unit: V", "whose unit is of another kind"),
        study(
            '"wheels[0].velocity"',
            '"speeds[0]"',
            "field speeds[0] of /wheels is read as inputs.wheel_speed_right already; name another",
        ),
        study(
            "y: pose.position.y", "y: pose.position.x", "field pose.position.x of /mocap is read as poses.x"
        ),
        study("pose.orientation", "pose.position", "pose.position is no number: it has x, y, z"),
        study("{topic: /wheels, field", "{field", "is one of which topic's messages? give `topic`, too"),
    ],
    "bag: landmarks": [
        value("/seen", 5, "poses[0].position.x", -1.0, "a distance is not below 0", "landmarks.range[4]"),
        value(
            "/seen",
            5,
            "poses[0].position.y",
            50.0,
            "6.28; in degrees say `unit: deg` of bearing",
            "landmarks.bearing[4]",
        ),
        value("/seen", 5, "poses[0].position.z", 5.0, "landmarks has no id '5'; the study has 4 and 9", "id"),
        value("/seen", 5, "poses[0].position.z", 9.0, "9 is read a second time", "id"),
        value("/seen", 5, "header.stamp.sec", 0, "time goes back: 0.4 s after"),
        without("/seen", f"{KNOWN} /seen", "landmarks"),
        study("topic: /seen", "topic: /tags", f"{KNOWN} /tags"),
        study("topic: /seen, ", "", "the topic of landmarks is needed; the bag has /joint_states, /seen"),
        *(
            study(
                old,
                new,
                f"drive: /seen: message 1: {words} (named in study.yaml:13: log.sensors.landmarks.{key})",
            )
            for old, new, words, key in (
                (
                    "each: poses",
                    "each: pose",
                    "the message has no field pose; did you mean poses? it has header, poses",
                    "each",
                ),
                ("each: poses", "each: header", "header is no list: it has stamp, frame_id", "each"),
                ("each: poses", "each: header.frame_id", "header.frame_id is no list, but str", "each"),
                (
                    "id: position.z",
                    "id: number",
                    "the message has no field number; it has position, orientation",
                    "id",
                ),
                ("id: position.z", "id: position", "position is no id: it has x, y, z", "id"),
                ("range: position.x", "range: position", "position is no number: it has x, y, z", "range"),
                (
                    "bearing: position.y",
                    "bearing: x.y",
                    "the message has no field x; it has position, orientation",
                    "bearing",
                ),
            )
        ),
        study("id: position.z", "id: position..z", "id: expected the path of a field, such as"),
        study("bearing: position.y", "bearing: {field: position.y, unit: m}", KIND),
        value("/seen", 5, "poses[0].position.x", NAN, f"{FINITE}'nan'"),
        value("/seen", 5, "poses[0].position.x", INF, f"{FINITE}'inf'"),
        value(
            "/seen", 5, "poses[0].position.z", NAN, "landmarks has no id 'nan'; the study has 4 and 9", "id"
        ),
        value(
            "/seen",
            5,
            "poses[0].position.x",
            1e13,
            "expected a number of at most 1e+12",
            "landmarks.range[4]",
        ),
        *usual_stamps("/seen")[1:],
        study("landmarks: {topic", "landmark: {topic", "did you mean landmarks?"),
    ],
    "bag: ranges": [
        value("/uwb/2", 5, "range", NAN, f"{FINITE}'nan'"),
        value("/uwb/1", 5, "range", INF, f"{FINITE}'inf'"),
        value("/uwb/2", 5, "range", -1.0, "a distance is not below 0, got -1 m", "ranges[2]"),
        without("/uwb/2", f"{KNOWN} /uwb/2", "ranges"),
        study("topics: [/uwb/1, /uwb/2]", "topics: [/uwb/1]", "expected 2 fields of one topic, or as"),
        study("/uwb/2", "/uwb/3", f"{KNOWN} /uwb/3; did you mean /uwb/2?"),
        study(
            "/uwb/2",
            "/joint_states",
            "drive: /joint_states: message 1: the message has no field range; it has",
        ),
        study(
            "field: range",
            "field: distance",
            "drive: /uwb/2: message 1: the message has no field distance; it",
        ),
        study(
            "field: range", "field: header", "/uwb/1: message 1: header is no number: it has stamp, frame_id"
        ),
        study("/uwb/2", "/uwb/1", "ranges.topics: /uwb/1 is listed twice"),
        value("/uwb/2", 5, "range", 1e13, "expected a number of at most 1e+12", "ranges[2]"),
        value("/uwb/2", 5, "header.stamp.sec", 0, "time goes back: 0.21"),
        *usual_stamps("/uwb/1"),
        study("field: range", "field: range, unit: s", KIND),
        study("{ranges: {topics", "{ranges_2: {topics", "the study's measurement has no ranges_2"),
    ],
}


study_of = cache(partial(parse_study, source="study.yaml"))


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The log of a format, written once."""
    return cache(lambda name: FORMATS[name].written(tmp_path_factory.mktemp("unbroken")))


@pytest.mark.parametrize("name", FORMATS)
def test_it_is_read_by_a_short_study(name: str, unbroken: Callable[[str], Path]):
    own = study_of(FORMATS[name].study)
    assert len(own.text.splitlines()) <= MOST_LINES
    (log,) = read_logs([unbroken(name)], own.log, own.problem.model, own.problem.measurement)
    assert len(log.input_times) > FEW
    assert len({(fault.place, fault.words) for fault in FAULTS[name]}) >= 10


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_faults_are_named(name: str, unbroken: Callable[[str], Path], tmp_path: Path):
    found = {}
    for number, fault in enumerate(FAULTS[name], start=1):
        # What stands in the study leaves the log as it is.
        of_study = fault.place == STUDY
        broken = copy.copy(FORMATS[name]) if of_study else copy.deepcopy(FORMATS[name])
        fault.change(broken)
        folder = tmp_path / str(number)
        folder.mkdir()
        log = unbroken(name) if of_study else broken.written(folder)
        said = said_of(broken, log)
        # A bag is named as it is: a folder, or a file with its ending.
        wanted = [re.sub(r"^drive: ", f"{log.name}: ", one) for one in (fault.place, fault.words)]
        if not any(all(one in line for one in wanted) for line in said):
            found[number] = (wanted, said)
    assert found == {}


def said_of(broken: Given, log: Path) -> list[str]:
    """What an estimate says of its mistakes, without the folder that the log is in."""
    try:
        estimate(study_of(broken.study), log, **broken.options)
    except UserMistake as mistake:
        return str(mistake).replace(f"{log.parent}{os.sep}", "").splitlines()
    return []


@pytest.mark.parametrize(
    ("name", "broken", "hint"),
    [
        ("hold-out", cell("a.csv", 8, "x", "nan", ""), "skip_invalid_rows"),
        ("hold-out", rows("a.csv", 9, lambda own: own.insert(8, own[5]), ""), "with `runs`"),
        ("NaN skipped", rows("a.csv", 2, partial(of_text, "x", "nan"), ""), ""),
        ("NaN skipped", cell("a.csv", 8, "x", "1e13", ""), ""),
    ],
)
def test_a_hint_names_what_the_study_has_not(name: str, broken: Fault, hint: str, tmp_path: Path):
    own = copy.deepcopy(FORMATS[name])
    broken.change(own)
    with pytest.raises(UserMistake) as caught:
        estimate(study_of(own.study), own.written(tmp_path))
    said = [line for line in str(caught.value).splitlines() if line.startswith("study.yaml: log: ")]
    assert len(said) == bool(hint)
    assert hint in "".join(said)

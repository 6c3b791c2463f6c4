"""Twins of public sets of robots' logs: files laid out as theirs are, with their faults, of known truth.

The layouts are those of their descriptions: the tuples of [Censi et al., Simultaneous calibration of odometry
and sensor parameters for mobile robots, 2013], the lines `time: ticks: model_pose: tracker_pose:` of a
car-sized tricycle (an exercise of probabilistic robotics, Rome), the tables of optiodom
(github.com/sousarbarb/optiodom), bags of JointState and PoseStamped.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from bags import START, STORES, header, pose, write_bag_1
from scan_matching import MOUNTED, TRUTH, matched
from twin_drives import STEP, Twin, driven, tracked, waves, write_csv


@dataclass(frozen=True)
class PublicSet:
    """A set of logs.

    Attributes:
        name: of its study, without suffix.
        truth: parameters, SI.
        logs: writes them into a folder.
        findings: names of what is to be found in any of the logs.
        place: of the sensor, where it is checked [m, rad].
    """

    name: str
    truth: dict[str, float]
    logs: Callable[[Path], Sequence[Path]]
    findings: tuple[str, ...] = ()
    place: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.name


def two_wheels(truth: dict[str, float], speeds: np.ndarray) -> np.ndarray:
    """Twists (n, 3) of speeds right and left (n, 2)."""
    right, left = speeds[:, 0] * truth["wheel_radius_right"], speeds[:, 1] * truth["wheel_radius_left"]
    return np.column_stack([(right + left) / 2, 0 * right, (right - left) / truth["track"]])


def steered(truth: dict[str, float], rows: np.ndarray) -> np.ndarray:
    """Twists (n, 3) of a driven and steered wheel's speed and angle (n, 2)."""
    angle = truth.get("steering_gain", 1.0) * rows[:, 1] + truth["steering_offset"]
    rim = truth["wheel_radius"] * rows[:, 0]
    return np.column_stack([rim * np.cos(angle), 0 * rim, rim * np.sin(angle) / truth["wheelbase"]])


def rolling(places: np.ndarray, radii: np.ndarray) -> tuple[Callable, Callable]:
    """Wheel speeds of twists, and twists of wheel speeds, of wheels with rollers.

    Args:
        places: (wheels, 3), how far each rolls per forward, lateral and turning speed.
        radii: (wheels,).
    """

    def speeds(twists: np.ndarray) -> np.ndarray:
        return twists @ places.T / radii

    def twists(rows: np.ndarray) -> np.ndarray:
        # The wheels agree: any of them that has no say would roll by as much.
        return np.linalg.lstsq(places, radii[:, None] * rows.T, rcond=None)[0].T

    return speeds, twists


def bumps(times: np.ndarray, seed: int, *sizes: tuple[float, float]) -> np.ndarray:
    """Smooth inputs (n, len(sizes)) of these sizes and means."""
    return np.column_stack([waves(times, 31 * seed + at, *size) for at, size in enumerate(sizes)])


JACKAL = {"wheel_radius_right": 0.0974, "wheel_radius_left": 0.0969, "track": 0.563}
LOST = (4.0, 8.5)
"""When a tracker loses the robot for two thirds of a second, and repeats its last pose [s]."""


def jackal(folder: Path, seed: int, seconds: float = 10.0) -> Path:
    """ROS 1: joints at 50 Hz; mocap at 170 Hz, an eighth of it missing in bursts, or the last pose again."""
    rng, types = np.random.default_rng(seed), STORES["ros1"].types
    twin = driven(lambda t: bumps(t, seed, (2.5, 2.5), (2.5, 2.5)), lambda u: two_wheels(JACKAL, u), seconds)
    joint, mocap = types["sensor_msgs/msg/JointState"], types["geometry_msgs/msg/PoseStamped"]
    names = [f"{place}_{side}_wheel" for side in ("left", "right") for place in ("front", "rear")]
    messages = []
    for row in twin.rows(50):
        (right, left), (fast, slow), time = twin.turned[row], twin.inputs[row], START + twin.times[row]
        angles, speeds = np.repeat([left, right], 2), np.repeat([slow, fast], 2)
        head = header(time, types=types)
        state = joint(header=head, name=names, position=angles, velocity=speeds, effort=np.zeros(4))
        messages.append(("/joint_states", time + 0.001, state))
    seen = np.arange(0.1, seconds, 1 / 170)
    missing = np.convolve(rng.random(len(seen)) < 0.02, np.ones(7))[: len(seen)] > 0
    rows, last = np.round(seen / STEP).astype(int), None
    exact = Twin(
        seen,
        twin.inputs[rows],
        twin.turned[rows],
        np.column_stack([np.interp(seen, twin.times, column) for column in twin.poses.T]),
    )
    readings = tracked(exact, np.arange(len(seen)), seed, (0.001, np.radians(0.1)), (0.03, -0.02, 0.05))
    for time, own, gone in zip(seen, readings, missing, strict=True):
        if gone:
            continue
        lost = any(start < time < start + 0.65 for start in LOST)
        last = last if lost and last is not None else own
        head = header(START + time - 0.04, "world", types)
        message = mocap(header=head, pose=pose(last, types))
        messages.append(("/vrpn_client_node/jackal/pose", START + time, message))
    return write_bag_1(folder / f"jackal_{seed}.bag", sorted(messages, key=lambda one: one[1]))


def khepera(folder: Path, seed: int) -> Path:
    """A tuple in each line, of steady speeds; a twentieth of the matches went wrong."""
    drive = matched(seed, bad=0.05, seconds=80, held=40)
    lengths = np.diff(drive.spans)[:, 0]
    places = np.round(drive.spans / 0.1).astype(int)
    speeds = (drive.turned[places[:, 1]] - drive.turned[places[:, 0]]) / lengths[:, None]
    lines = [
        json.dumps({"T": length, "phi_l": left, "phi_r": right, "sm": motion})
        for length, (right, left), motion in zip(
            lengths.tolist(), speeds.tolist(), drive.motions.tolist(), strict=True
        )
    ]
    file = folder / f"khepera_{seed}.tuple"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


CAR = {"wheel_radius": 0.0845, "wheelbase": 1.343, "steering_offset": -0.051, "steering_gain": 0.552}
CAR_SENSOR = (1.55, 0.02, 0.01)
CAR_HEAD = """\
#kinematic_model: traction_drive_wheel aka front-tractor tricycle
#parameters: [ Ksteer Ktraction axis_length steer_offset ]
#parameter_values: 0.1 0.0106141 1.4 0
#joints_max_enc: [ steering traction_wheel ]
#joints_max_enc_values: 8192 5000
#laser wrt base_link
#\ttranslation:\t[1.5, 0, 0],
#\trotation:\t [0, 0, 0, 1]
"""


def car(folder: Path, seed: int, seconds: float = 20.0) -> Path:
    """Counters of 32 and 13 bits, times since 1970, odometry that nobody asks for, the sensor's pose."""
    twin = driven(
        lambda t: bumps(t, seed, (2.5, 5.0), (0.6, 0.0)), lambda u: steered(CAR, u), seconds, (0, 0, 0)
    )
    rows = twin.rows(20)
    traction = np.mod(np.round(twin.turned[rows, 0] / (2 * np.pi) * 5000 * 20) + 2**32 - 90_000, 2**32)
    steering = np.mod(np.round(twin.inputs[rows, 1] / (2 * np.pi) * 8192), 8192)
    poses = tracked(twin, rows, seed, (0.005, np.radians(0.2)), CAR_SENSOR)
    lines = [
        f"time: {1668091584.821040869 + time:.9f} ticks: {turn:.0f} {run:.0f} "
        f"model_pose: {own[0]:.6g} {own[1]:.6g} {own[2]:.6g} "
        f"tracker_pose: {seen[0]:.6g} {seen[1]:.6g} {seen[2]:.6g}"
        for time, turn, run, own, seen in zip(
            twin.times[rows], steering, traction, twin.poses[rows], poses, strict=True
        )
    ]
    file = folder / f"car_{seed}.txt"
    file.write_text(CAR_HEAD + "\n".join(lines) + "\n", encoding="utf-8")
    return file


MECANUM = {"wheel_radius": 0.0492, "half_wheelbase_plus_half_track": 0.421}


def mecanum(folder: Path, seed: int, seconds: float = 9.0) -> Path:
    """Four wheels in rpm, one row twice; mocap in a file of its own with NaN where it lost the robot."""
    arm = MECANUM["half_wheelbase_plus_half_track"]
    places = np.array([[1, -1, -arm], [1, 1, arm], [1, 1, -arm], [1, -1, arm]])
    speeds, twists = rolling(places, np.full(4, MECANUM["wheel_radius"]))
    twin = driven(lambda t: speeds(bumps(t, seed, (0.2,), (0.2,), (0.5,))), twists, seconds)
    rows, seen = twin.rows(50), twin.rows(100, 0.2)
    rows = np.sort(np.append(rows, rows[400]))
    stamps = np.round(1e3 * (START + twin.times))
    names = ("fl_rpm", "fr_rpm", "rl_rpm", "rr_rpm")
    rpm = np.round(twin.inputs[rows] * 30 / np.pi, 2)
    wheels = dict(zip(names, rpm.T, strict=True))
    file = write_table(folder / f"mecanum_{seed}.csv", {"stamp": stamps[rows], **wheels})
    poses = tracked(twin, seen, seed, (0.001, np.radians(0.1))) * [1000, 1000, 180 / np.pi]
    poses[300:360] = np.nan
    table = dict(zip(("x_mm", "y_mm", "yaw_deg"), poses.T, strict=True))
    write_table(folder / f"{file.stem}_mocap.csv", {"stamp": stamps[seen] - 50, **table})
    return file


def write_table(file: Path, columns: dict[str, np.ndarray]) -> Path:
    """A CSV whose stamps are whole milliseconds since 1970."""
    lines = [",".join(columns)]
    for stamp, *cells in zip(*columns.values(), strict=True):
        lines.append(",".join([f"{stamp:.0f}", *(f"{cell:.6g}" for cell in cells)]))
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def optiodom(
    folder: Path,
    stem: str,
    twin: Twin,
    seed: int,
    inputs: Callable[[np.ndarray], np.ndarray],
    late: float = 0.0,
) -> Path:
    """No header: time, x, y, heading, ticks of each row; encoders `late` [s], as in some of its runs."""
    rows = twin.rows(20)
    poses = tracked(twin, rows, seed, (0.001, np.radians(0.2)))
    behind = np.maximum(rows - round(late / STEP), 0)
    table = np.column_stack([twin.times[rows], poses, inputs(behind)])
    file = folder / f"{stem}_run-0{seed + 1}.csv"
    np.savetxt(file, table, delimiter=",", fmt="%.10g")
    return file


def counts(turned: np.ndarray, ticks: float) -> np.ndarray:
    """Ticks since the row before."""
    return np.diff(np.round(turned / (2 * np.pi) * ticks), axis=0, prepend=0.0)


DIFF = {"wheel_radius_right": 0.0418, "wheel_radius_left": 0.0419, "track": 0.2017}
TRICYC = {"wheel_radius": 0.0310, "wheelbase": 0.1525, "steering_offset": -0.020}
OMNI3 = {
    "wheel_radius_front_left": 0.0507,
    "wheel_radius_rear": 0.0503,
    "wheel_radius_front_right": 0.0512,
    "centre_distance": 0.1985,
}


def optiodom_diff(folder: Path, seed: int) -> Path:
    twin = driven(lambda t: bumps(t, seed, (1.8, 1.0), (1.8, 1.0)), lambda u: two_wheels(DIFF, u), 10)
    late = 0.34 if seed == 1 else 0.0
    return optiodom(folder, "diff", twin, seed, lambda rows: counts(twin.turned[rows], 2796.8), late)


def optiodom_tricyc(folder: Path, seed: int) -> Path:
    twin = driven(lambda t: bumps(t, seed, (1.5, 2.5), (0.5, 0.1)), lambda u: steered(TRICYC, u), 10)

    def logged(rows: np.ndarray) -> np.ndarray:
        return np.column_stack([counts(twin.turned[rows, :1], 1600), twin.inputs[rows, 1]])

    return optiodom(folder, "tricyc", twin, seed, logged)


def optiodom_omni3(folder: Path, seed: int) -> Path:
    angles = np.radians([60, 180, -60])
    places = np.column_stack([-np.sin(angles), np.cos(angles), np.full(3, OMNI3["centre_distance"])])
    speeds, twists = rolling(places, np.array(list(OMNI3.values())[:3]))
    twin = driven(lambda t: speeds(bumps(t, seed, (0.15,), (0.15,), (0.5,))), twists, 10)
    return optiodom(folder, "omni3", twin, seed, lambda rows: counts(twin.turned[rows], 12288))


COMMANDED = {"gain_v": 0.957, "gain_omega": 0.884, "lag_v": 0.163, "lag_omega": 0.221}


def commanded(folder: Path, seed: int, seconds: float = 9.0) -> Path:
    """Commands at 20 Hz; a tracker at 50 Hz in milliseconds, on a clock 0.12 s behind."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-1, 1, (2, round(seconds) + 2)) * [[0.4], [1.2]]

    def inputs(times: np.ndarray) -> np.ndarray:
        # Commands of a new size every second, sent anew at 20 Hz.
        sent = np.floor(times * 20 + 1e-9) / 20
        return steps[:, np.floor(sent + 1e-9).astype(int)].T

    def twists(rows: np.ndarray) -> np.ndarray:
        asked = rows * [COMMANDED["gain_v"], COMMANDED["gain_omega"]]
        left = np.exp(-STEP / np.array([COMMANDED["lag_v"], COMMANDED["lag_omega"]]))
        rates = np.zeros((len(rows) + 1, 2))
        for at, row in enumerate(asked):
            rates[at + 1] = row + (rates[at] - row) * left
        return np.insert((rates[1:] + rates[:-1]) / 2, 1, 0.0, axis=1)

    twin = driven(inputs, twists, seconds)
    rows, seen = twin.rows(20), twin.rows(50, 0.3)
    poses = tracked(twin, seen, seed, (0.002, np.radians(0.3))) * [1, 1, 180 / np.pi]
    table = dict(zip(("px", "py", "yaw"), poses.T, strict=True))
    times = 1e3 * (twin.times[seen] - 0.12)
    write_csv(folder / f"commanded_{seed}_tracker.csv", {"frame_ms": times, **table})
    sent = {"v_cmd": twin.inputs[rows, 0], "w_cmd": np.degrees(twin.inputs[rows, 1])}
    return write_csv(folder / f"commanded_{seed}.csv", {"time": twin.times[rows], **sent})


HUSKY = {"wheel_radius_right": 0.1642, "wheel_radius_left": 0.1631, "track": 1.114}
ANTENNA = {"sensor_x": 0.31, "sensor_y": -0.08}


def husky(folder: Path, seed: int, seconds: float = 40.0) -> Path:
    """Dates; rims' speeds by the nominal radius; RTK at 5 Hz, whose errors last for some ten seconds."""
    twin = driven(lambda t: bumps(t, seed, (2.5, 2.5), (2.5, 2.5)), lambda u: two_wheels(HUSKY, u), seconds)
    rows, seen = twin.rows(10), twin.rows(5, 0.4)
    places = tracked(twin, seen, seed, (0.003, 0.0), (*ANTENNA.values(), 0.0))[:, :2]
    rng, kept = np.random.default_rng([seed, 5]), np.exp(-0.2 / 10)
    errors = 0.015 * rng.normal(size=(len(seen), 2))
    for at in range(1, len(seen)):
        errors[at] = kept * errors[at - 1] + np.sqrt(1 - kept**2) * errors[at]
    speeds = 0.165 * twin.inputs[rows]
    write_dated(folder / f"husky_{seed}_rtk.csv", "utc,easting,northing", twin.times[seen], places + errors)
    return write_dated(folder / f"husky_{seed}.csv", "stamp,right_mps,left_mps", twin.times[rows], speeds)


BEACONS = np.array([[6.0, 0.0], [-4.0, 5.0], [-4.0, -5.0], [5.0, 7.0]])


def uwb(folder: Path, seed: int, seconds: float = 14.0) -> Path:
    """Distances to beacons in turn, a tenth not heard, 12 cm too long; a gyroscope beside the wheels."""
    twin = driven(lambda t: bumps(t, seed, (2.5, 2.5), (2.5, 2.5)), lambda u: two_wheels(HUSKY, u), seconds)
    rows, seen, rng = twin.rows(20), twin.rows(16, 0.4), np.random.default_rng([seed, 6])
    places, which = tracked(twin, seen, seed, (0.0, 0.0))[:, :2], np.arange(len(seen)) % len(BEACONS)
    ranges = np.linalg.norm(places - BEACONS[which], axis=1) + 0.12 + 0.08 * rng.normal(size=len(seen))
    turned = np.degrees(two_wheels(HUSKY, twin.inputs[rows])[:, 2])
    heard = rng.uniform(size=len(seen)) > 0.1
    columns = {"t": twin.times[seen], "beacon": which + 1, "range": ranges}
    write_csv(folder / f"uwb_{seed}_ranges.csv", {name: one[heard] for name, one in columns.items()})
    right, left = (0.165 * twin.inputs[rows]).T
    gyro = turned + 0.8 + 0.4 * rng.normal(size=len(rows))
    table = {"t": twin.times[rows], "right_mps": right, "left_mps": left, "gyro_z": gyro}
    write_csv(folder / f"uwb_{seed}.csv", table)
    return folder / f"uwb_{seed}.csv"


def write_dated(file: Path, head: str, times: np.ndarray, cells: np.ndarray) -> Path:
    """A CSV whose first column has dates, as in ISO 8601."""
    start = datetime(2023, 5, 31, 14, 3, 7, tzinfo=UTC)
    rows = (
        ",".join([(start + timedelta(seconds=float(time))).isoformat(), *(f"{cell:.4f}" for cell in own)])
        for time, own in zip(times, cells, strict=True)
    )
    file.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return file


def each(write: Callable[[Path, int], Path], count: int) -> Callable[[Path], list[Path]]:
    """Of several seeds."""
    return lambda folder: [write(folder, seed) for seed in range(count)]


PLACE = ("sensor_x", "sensor_y", "sensor_heading")
MATCHED, CAR_PLACE = (dict(zip(PLACE, place, strict=True)) for place in (MOUNTED, CAR_SENSOR))
SETS = (
    PublicSet("jackal", JACKAL, each(jackal, 1), ("tracker_lost", "gap")),
    PublicSet("khepera", TRUTH, each(khepera, 2), ("stray_motions",), MATCHED),
    PublicSet("tricycle", CAR, each(car, 1), ("counter_wrapped",), CAR_PLACE),
    PublicSet("mecanum", MECANUM, each(mecanum, 1), ("duplicate_rows", "skipped_poses", "gap")),
    PublicSet("optiodom_diff", DIFF, each(optiodom_diff, 2), ("clock_offset",)),
    PublicSet("optiodom_tricyc", TRICYC, each(optiodom_tricyc, 1)),
    PublicSet("optiodom_omni3", OMNI3, each(optiodom_omni3, 1)),
    PublicSet("commanded", COMMANDED, each(commanded, 1), ("clock_offset",)),
    PublicSet("husky", HUSKY, each(husky, 1), place=ANTENNA),
    PublicSet("uwb", HUSKY, each(uwb, 1)),
)

"""A drive for a real robot, in the forms that robots take. A new form is an entry in `EXPORTERS`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from oed.exporters.diff_drive import diff_drive_parameters as diff_drive_parameters
from oed.exporters.diff_drive import write_parameters
from oed.exporters.played import MESSAGES as MESSAGES
from oed.exporters.request import Request, require_rate
from oed.exporters.ros2_node import write_node
from oed.exporters.rosbag2 import STORAGES as STORAGES
from oed.exporters.rosbag2 import bag_library, write_bag
from oed.exporters.tables import write_csv, write_json
from oed.foundation.arguments import typed
from oed.foundation.errors import RecordError, UserMistake
from oed.foundation.work.folders import in_order
from oed.records.record import ESTIMATE_FILE as ESTIMATE
from oed.records.record import FILE as RECORD
from oed.records.record import Record, load_estimate, load_record, require_no_results
from oed.records.stored.door import read_echo

EXPORTERS: dict[str, Callable[[Request], Path]] = {
    "csv": write_csv,
    "json": write_json,
    "rosbag2": write_bag,
    "ros2_node": write_node,
    "ros2_yaml": write_parameters,
}
"""The formats: each writes what is asked for and returns the file or folder."""
LIBRARIES: dict[str, Callable[[], object]] = {"rosbag2": bag_library}
"""By format, what raises a `UserMistake` where the extra that it needs is not installed."""


@typed
def export(
    record_folder: str | Path,
    to: str,
    *,
    result: str | None = None,
    rate: float | None = None,
    out: str | Path | None = None,
    storage: str = "sqlite3",
    message: str | None = None,
    force: bool = False,
    trust: bool = False,
) -> Path:
    """Write a result's drive, or the robot's parameters, for use outside of the package.

    At a rate other than the design's own the commands are resampled so that every wheel turns by the same
    angles; the poses are those that the commands written lead to. The last command of every run stops the
    robot.

    Args:
        record_folder: folder of a saved record; for `ros2_yaml` an estimate will do.
        to: one of `EXPORTERS`: `csv` and `json` (commands, twists and poses), `rosbag2` (a ROS 2 bag),
            `ros2_node` (a Python file that plays the drive and records its log),
            `ros2_yaml` (parameters of ros2_control's diff_drive_controller: of the robot, not of a drive;
            with estimated values where `estimate.json` lies in the folder).
        result: name of the result; the record's best by default.
        rate: of the commands [Hz]; the design's own by default, one command per period.
        out: file (of a bag, folder) to write; by default in the record's folder, named after result and
            format: `<result>_commands.csv`, `<result>_commands.json`, `<result>_bag`, `<result>_drive.py`,
            and `diff_drive_controller.yaml`.
        storage: of a bag, one of `STORAGES`.
        message: by which a node commands the robot, one of `MESSAGES`; by default what suits it: a twist,
            or for a robot that is steered a speed and an angle.
        force: replace a bag that exists; files are replaced in any case.
        trust: whether Python code that the record names may be run; only `ros2_yaml` needs it.

    Returns:
        What was written.

    Raises:
        RecordError: no record there, no such result, a result without a drive, an estimate that cannot be
            read, code that is needed and not trusted.
        UserMistake: an unknown format, storage or message, a rate that is not above 0, a bag that exists, a
            robot that the format or the message has no room for, a record of another system, a place that
            cannot be written to, or that holds results.
    """
    if to not in EXPORTERS:
        raise UserMistake(f"expected a format of {', '.join(EXPORTERS)}; got {to!r}")
    require_rate(rate)
    if out is not None:
        require_no_results(out)
    place = in_order(record_folder)
    record = _record_in(place, to)
    record.require_robot()
    request = Request(
        folder=place if place.is_dir() else place.parent,
        record=record,
        result=result,
        rate=rate,
        out=None if out is None else Path(out),
        storage=storage,
        message=message,
        force=force,
        trust=trust,
    )
    return EXPORTERS[to](request)


def _record_in(place: Path, to: str) -> Record:
    # The robot's parameters need no design: an estimate knows its study as well.
    if to == "ros2_yaml" and not (place / RECORD).is_file() and (place / ESTIMATE).is_file():
        found = load_estimate(place)
        if found.study is None:
            raise RecordError.about(found.file, "missing", "study")
        known = {"version": found.oed_version, "echo": found.study, "certificate": None, "validation": None}
        record = Record.of(found, **known, parameters=[], nuisances=[], results=[]).at(place / ESTIMATE)
        return record.of_study(read_echo(found.study, place / ESTIMATE, designs=False))
    return load_record(place)

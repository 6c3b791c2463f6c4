"""Design, drive, estimate, and again, until parameters are as precise as wanted: `oed loop`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from oed.exporters import EXPORTERS, LIBRARIES
from oed.foundation.arguments import typed
from oed.foundation.errors import RecordError, UserMistake
from oed.foundation.extras import package_version
from oed.foundation.presenting import Brief
from oed.foundation.work.folders import INSIDE, require_usable
from oed.foundation.work.locks import held
from oed.foundation.work.progress import announce
from oed.optimize import Progress, Silent, Workers
from oed.records.record import LOOP_FILE, EstimateRecord, load_estimate, load_loop
from oed.records.stored.door import FORMAT
from oed.records.stored.loop import SeenLog, StoredLoop
from oed.study.study import Study
from oed.workflow.aims import aims_of
from oed.workflow.arrivals import LogFolder
from oed.workflow.next_drive import LEAST_GAIN, require_own_parameters
from oed.workflow.rounds import Command, Rounds, command_line

MOST_DRIVES = 10
"""After which a loop ends that has not reached what is wanted."""
POLL, SETTLE = 1.0, 10.0
"""Time [s] between looks for logs, and for which one has to stay as it is to be complete."""
READING = ("log", "calibration", "name")
"""Keys of a study that may change within a loop: how logs are read, not what is designed."""
HASH = 16
"""Characters of a study's hash."""


@dataclass(frozen=True, repr=False)
class Loop(Brief):
    """How a loop stands.

    Attributes:
        found: its rounds, as loop.json has them.
        estimate: from all logs so far; None before the first.
        folder: where all is saved.
        interrupted: whether it was cut short; the same call goes on.
    """

    found: StoredLoop
    estimate: EstimateRecord | None
    folder: Path
    interrupted: bool = False

    @property
    def reached(self) -> bool:
        """Whether every parameter is as precise as wanted."""
        return self.found.reached

    @property
    def data(self) -> dict[str, Any]:
        """What loop.json holds."""
        return {**self.found.plain(), "interrupted": self.interrupted}


@typed
def loop(
    study: Study,
    logs: str | Path,
    out: str | Path,
    *,
    targets: Mapping[str, str] | None = None,
    to: str = "csv",
    command: str | Command | None = None,
    least_gain: float = LEAST_GAIN,
    duration: float | None = None,
    most: int = MOST_DRIVES,
    pattern: str | None = None,
    poll: float = POLL,
    settle: float = SETTLE,
    seed: int | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
    tell: Callable[[str], object] | None = None,
    written: Callable[[Path], object] | None = None,
) -> Loop:
    """Design a drive, wait for its log, estimate from all logs so far, and design the next one.

    It ends when every parameter is as precise as wanted, or when another drive would gain too little. What
    `out` has of the same loop is kept: the same call goes on where one was cut short. Logs from before the
    loop are left alone; those that cannot be read are announced, and others waited for.

    Args:
        study: of the first drive, a pilot for instance; and how logs are read.
        logs: folder that they come into.
        out: folder for loop.json, the rounds' designs (`round1`, ...) and the estimate.
        targets: standard errors wanted, by parameter, with a unit ("0.2 mm") or relative ("0.1 %").
        to: format of the drive for the robot, one of `oed.export`.
        command: what drives, and leaves the log: called with the file of the drive and the folder of logs; or
            a command line, in which {drive}, {logs} and {round} stand for these and the round's number. By
            default somebody drives, and is told what.
        least_gain: share of the worst standard error that another drive has to take away.
        duration: of each run of the drives after the first [s].
        most: how many drives at most.
        pattern: of the logs' names, as a shell has it ("*.csv").
        poll: time between looks for logs [s].
        settle: for which a log has to stay as it is to be complete [s].
        seed: of every random draw, instead of the study's.
        workers: processes, or a cluster; does not change the result.
        progress: informed how far the work is.
        tell: called with each line of what to drive, and of what is known; `progress` hears them by default.
        written: called with each folder that has new results.

    Raises:
        UserMistake: no such folder or format, an extra that is not installed, targets for what is not
            estimated, `out` of another study's loop, or of one that is at work.
        Failure: the command failed, or left no log.
    """
    _require(study, targets or {}, to, least_gain, most, poll, settle)
    place, folder = Path(out), LogFolder(Path(logs), study.log, pattern)
    if not folder.folder.is_dir():
        raise UserMistake(f"{folder.folder}: no such folder; logs are to come into it")
    require_usable(place)
    drives = command_line(command) if isinstance(command, str) else command
    asked = _asked(targets or {}, least_gain, duration, most)
    listener = progress or Silent()
    said = tell or partial(announce, listener)
    search = {"seed": seed, "workers": workers, "progress": listener}
    with held(place / f"{INSIDE}-loop", place, wait=False):
        rounds = Rounds(
            study=study,
            place=place,
            folder=folder,
            found=_begun(study, place, folder, asked, said),
            to=to,
            command=drives,
            search=search,
            next={"targets": targets, "least_gain": least_gain, "duration": duration, **search},
            most=most,
            waiting=(poll, settle),
            tell=said,
            written=written,
        )
        interrupted = False
        try:
            while not rounds.found.finished:
                rounds.go_on()
        except KeyboardInterrupt:
            interrupted = True
    return Loop(rounds.found, _estimate(place), place, interrupted)


def _estimate(place: Path) -> EstimateRecord | None:
    with suppress(RecordError):
        return load_estimate(place)
    return None


def _require(
    study: Study,
    targets: Mapping[str, str],
    to: str,
    least_gain: float,
    most: int,
    poll: float,
    settle: float,
) -> None:
    # What would fail after the first drive is better known before.
    drives = [name for name in EXPORTERS if name != "ros2_yaml"]
    if to not in drives:
        why = "; ros2_yaml is no drive" if to == "ros2_yaml" else ""
        raise UserMistake(f"expected a format of {', '.join(drives)}; got {to!r}{why}")
    if to in LIBRARIES:
        LIBRARIES[to]()
    study.log.require_installed()
    if not 0 <= least_gain < 1:
        raise UserMistake(f"least gain: expected a share from 0 to 1, got {least_gain:g}")
    if not (poll > 0 and settle >= 0):
        raise UserMistake(f"poll and settle: expected times above 0 s, got {poll:g} and {settle:g}")
    if most < 1:
        raise UserMistake(f"most drives: expected 1 or more, got {most}")
    aims_of(study, targets, "--target")
    require_own_parameters(study)


def _asked(
    targets: Mapping[str, str], least_gain: float, duration: float | None, most: int
) -> dict[str, str]:
    # What may change from call to call, and is to be decided anew then.
    wanted = {f"target {name}": size for name, size in targets.items()}
    kept = {"least gain": f"{least_gain:g}", "most drives": str(most)}
    return {**wanted, **kept, **({} if duration is None else {"duration": f"{duration:g} s"})}


def _begun(
    study: Study, place: Path, folder: LogFolder, asked: dict[str, str], tell: Callable[[str], object]
) -> StoredLoop:
    digest = _digest(study)
    if not (place / LOOP_FILE).is_file():
        there = folder.found().items()
        seen = [SeenLog(name=name, size=size, changed=when) for name, (size, when) in there]
        return StoredLoop(
            format=FORMAT,
            oed_version=package_version("oed"),
            name=study.name,
            study=digest,
            asked=asked,
            rounds=[],
            seen=seen,
            reached=False,
            finished=False,
            reason="",
        )
    found = load_loop(place)
    if found.study != digest:
        raise UserMistake(
            f"{place / LOOP_FILE}: this loop was begun with another study ({found.name}), or this one has "
            "changed in more than how logs are read; name another folder"
        )
    rounds = [
        one.model_copy(update={"logs": [name for name in one.logs if folder.path(name).exists()]})
        for one in found.rounds
    ]
    lost = [name for name in found.logs if not folder.path(name).exists()]
    for name in lost:
        tell(f"{folder.path(name)} is there no more: its drive does not count")
    if found.asked != asked or lost:
        # The last decision is made anew, by what is asked for now and of the logs there are.
        rounds = rounds[:-1] if len(rounds) > 1 and not rounds[-1].logs and not lost else rounds
        return found.model_copy(
            update={"asked": asked, "rounds": rounds, "finished": False, "reached": False}
        )
    return found


def _digest(study: Study) -> str:
    kept = {name: value for name, value in study.echo().items() if name not in READING}
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()[:HASH]

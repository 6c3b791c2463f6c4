"""The rounds of a loop: a design, its logs, and what they say; each step is in loop.json when it is done."""

from __future__ import annotations

import itertools
import json
import shlex
import subprocess
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from math import degrees
from pathlib import Path
from typing import Any

from oed.exporters import export
from oed.foundation.errors import Failure, LogError, OedError, RecordError, UserMistake
from oed.foundation.files import inside, write_text
from oed.foundation.text import count, error_text, listing, own_unit, quantity, to_error, words
from oed.kernel.dynamics.trajectory import Trajectory
from oed.logs import BagForm, read_logs
from oed.records.record import LOOP_FILE, load_record
from oed.records.stored.loop import KnownParameter, LoopRound, SeenLog, StoredLoop, round_folder
from oed.study.study import Study
from oed.workflow.arrivals import LogFolder, Sign, twin_of
from oed.workflow.next_drive import NextDrive, next_drive
from oed.workflow.runner import run
from oed.workflow.saving import save_estimate

ENOUGH = 0.9
"""Share of a drive's time that its logs have to cover: of several runs all are waited for."""
TRIES = 3
"""Times that a command may leave logs that cannot be read, or are too short."""
NO_DRIVE = "no feasible drive was found; the record says which limit is in the way"

Command = Callable[[Path, Path], object]
"""Drives the file of a drive, and leaves its log in a folder."""


def command_line(text: str) -> Command:
    """A command of a command line, {drive} and {logs} in it the file of the drive and the folder of logs.

    Raises:
        UserMistake: quotes that do not close, or nothing at all.
    """
    try:
        parts = shlex.split(text)
    except ValueError as error:
        raise UserMistake(f"command: {error}, got {text!r}") from None
    if not parts:
        raise UserMistake("command: expected a program and its arguments, got nothing")

    def drive(file: Path, logs: Path) -> None:
        whole = [one.replace("{drive}", str(file)).replace("{logs}", str(logs)) for one in parts]
        try:
            # What it prints is no result of this program's.
            code = subprocess.run(whole, stdout=2, check=False).returncode  # noqa: S603 - the user's own
        except OSError as error:
            raise UserMistake(f"command: {whole[0]}: {error.strerror}") from None
        if code:
            raise Failure(f"the command ended with exit code {code}: {shlex.join(whole)}")

    return drive


@dataclass
class Rounds:
    """A loop under way.

    Attributes:
        study: of the first drive.
        place: folder of the loop.
        folder: that logs come into.
        found: what is done.
        to: format of drives for the robot.
        command: that drives; None for somebody who is told.
        search: options of `run`.
        next: options of `next_drive`.
        most: drives.
        waiting: time between looks, and for which logs have to stay as they are [s].
        tell: called with each line for who drives.
        written: called with each folder that has new results; None for nobody.
        seconds: of each log that has been read [s].
        refused: how often no estimate could be made.
    """

    study: Study
    place: Path
    folder: LogFolder
    found: StoredLoop
    to: str
    command: Command | None
    search: dict[str, Any]
    next: dict[str, Any]
    most: int
    waiting: tuple[float, float]
    tell: Callable[[str], object]
    written: Callable[[Path], object] | None
    seconds: dict[str, float] = field(default_factory=dict)
    refused: int = 0

    def go_on(self) -> None:
        """One round: the design, unless it is there, its logs, and what to do next.

        Raises:
            KeyboardInterrupt: cut short; what is done by then is saved.
            Failure: no feasible first drive, a command that fails.
        """
        if not self.found.rounds:
            self._design()
        self._drive()
        self._decide()

    def _design(self) -> None:
        # The first one; the others are designed with what is known.
        at = inside(self.place, round_folder(1))
        record = run(self.study, at, **self.search)
        if record.interrupted:
            raise KeyboardInterrupt
        self._written(at)
        if record.best is None:
            raise Failure(f"{at}: {NO_DRIVE}")
        self._save(rounds=[LoopRound(folder=at.name, logs=[], known=[])])

    def _drive(self) -> None:
        # Until the last design has its logs.
        number, current = len(self.found.rounds), self.found.rounds[-1]
        at = inside(self.place, current.folder)
        drive = _designed(at)
        wanted = ENOUGH * drive.duration
        self._measure(current.logs)
        if current.logs and self._covered() >= wanted:
            return
        file = export(at, self.to, force=True)
        self._say([f"Drive {number}: {file}"])
        if self.command is None:
            self._say(_what_to_do(file, self.to, drive, self.folder))
        listener = self.search["progress"]
        listener.begin(f"log of drive {number}", 1)
        known = self._known()
        for tries in itertools.count(1):
            new = self._new(file, known)
            known |= new
            self._take(new)
            if self._covered() >= wanted:
                break
            if self.command is not None and tries == TRIES:
                raise Failure(f"{TRIES} times the command has left no log of a whole drive")
            if self.found.rounds[-1].logs:
                text = f"{self._covered():.3g} s of {drive.duration:.3g} s are there"
                self._say([f"{text}: waiting for the rest of the drive, or for another one"])
        listener.advance()

    def _known(self) -> dict[str, Sign]:
        there = self.folder.found()
        seen = {one.name: (one.size, one.changed) for one in self.found.seen}
        return seen | {name: there[name] for name in self.found.logs if name in there}

    def _new(self, file: Path, known: dict[str, Sign]) -> dict[str, Sign]:
        if self.command is None:
            return self.folder.complete(known, *self.waiting)
        self.command(file, self.folder.folder)
        new = self.folder.new(known)
        if not new:
            raise Failure(f"the command has left no new log in {self.folder.folder}")
        return new

    def _take(self, new: dict[str, Sign]) -> None:
        # What can be read is a log of this round; else another is waited for.
        taken, refused = list[str](), list[SeenLog]()
        for name, (size, changed) in new.items():
            if name in self.found.logs:
                text = "is the log of an earlier drive, and has changed: give every log a name of its own"
                self._say([f"{self.folder.path(name)}: {text}"])
                continue
            try:
                self._require_new(name, taken)
                self._measure([name])
                taken.append(name)
            except LogError as error:
                refused.append(SeenLog(name=name, size=size, changed=changed))
                self._say([*map(str, error.issues), f"{name} is not used: waiting for another log"])
        rounds, current = self.found.rounds[:-1], self.found.rounds[-1]
        current = current.model_copy(update={"logs": [*current.logs, *taken]})
        kept = [one for one in self.found.seen if one.name not in new]
        self._save(rounds=[*rounds, current], seen=[*kept, *refused])

    def _require_new(self, name: str, taken: Sequence[str]) -> None:
        # Under another name a log says nothing new.
        others = [self.folder.path(one) for one in (*self.found.logs, *taken)]
        log = self.folder.path(name)
        twin = twin_of(log, others, self.study.log)
        if twin is not None:
            raise LogError.about(str(log), f"is the same as {twin.name} to the byte; a log counts once")

    def _refuse(self, error: LogError) -> None:
        # Logs that can be read, and yet say nothing that an estimate can be made of.
        wrong = {issue.file for issue in error.issues}
        refused = [one for one in self.found.rounds[-1].logs if str(self.folder.path(one)) in wrong]
        if not refused:
            raise error
        self.refused += 1
        if self.command is not None and self.refused == TRIES:
            raise error
        current, there = self.found.rounds[-1], self.folder.found()
        names = listing(refused)
        self._say([*map(str, error.issues), f"no estimate can be made with {names}: drive again"])
        signs = ((one, *there[one]) for one in refused if one in there)
        seen = [SeenLog(name=name, size=size, changed=changed) for name, size, changed in signs]
        again = current.model_copy(update={"logs": [one for one in current.logs if one not in refused]})
        self._save(rounds=[*self.found.rounds[:-1], again], seen=[*self.found.seen, *seen])

    def _measure(self, names: Iterable[str]) -> None:
        for name in names:
            if name not in self.seconds:
                problem = self.study.problem
                logs = read_logs([self.folder.path(name)], self.study.log, problem.model, problem.measurement)
                self.seconds[name] = sum(one.duration for one in logs)

    def _covered(self) -> float:
        return sum(self.seconds[name] for name in self.found.rounds[-1].logs)

    def _decide(self) -> None:
        # Estimate from all logs; then it is enough, or there is a next drive.
        number = len(self.found.rounds)
        at = inside(self.place, round_folder(number + 1))
        logs = [self.folder.path(name) for name in self.found.logs]
        try:
            found = next_drive(self.study, logs, out=at, **self.next)
        except LogError as error:
            self._refuse(error)
            return
        if found.record is not None and found.record.interrupted:
            raise KeyboardInterrupt
        save_estimate(found.estimate, self.place)
        known = [KnownParameter.of(one) for one in found.precision]
        self._say(_standing(number, known))
        self._ended(found, known, at)
        self._written(at)
        self._written(self.place)

    def _ended(self, found: NextDrive, known: list[KnownParameter], at: Path) -> None:
        number, reason, finished = len(self.found.rounds), found.reason, found.stop
        if found.record is not None and found.record.best is None:
            reason, finished = NO_DRIVE, True
        elif not finished and number >= self.most:
            reason, finished = f"as many drives as are allowed ({number}): stop", True
        last = self.found.rounds[-1].model_copy(update={"known": known, "reason": reason})
        rounds = [*self.found.rounds[:-1], last]
        if not finished:
            rounds.append(LoopRound(folder=at.name, logs=[], known=[]))
        self._save(rounds=rounds, reached=found.record is None, finished=finished, reason=reason)

    def _save(self, **changes: Any) -> None:
        self.found = self.found.model_copy(update=changes)
        text = json.dumps(self.found.plain(), indent=1, allow_nan=False) + "\n"
        write_text(self.place / LOOP_FILE, text)

    def _say(self, lines: Sequence[str]) -> None:
        for line in lines:
            self.tell(line)

    def _written(self, folder: Path) -> None:
        if self.written is None:
            return
        try:
            self.written(folder)
        except (OedError, OSError) as error:
            # What can be made later ends no loop.
            command = shlex.join(["oed", "report", str(folder)])
            self._say([f"{error}; `{command}` makes the page"])


def _designed(at: Path) -> Trajectory:
    # The drive that a round's record names as its best.
    best = load_record(at).best
    if best is None or best.drive is None:
        raise RecordError.about(at, NO_DRIVE)
    return best.drive.trajectory


def _what_to_do(file: Path, to: str, drive: Trajectory, logs: LogFolder) -> list[str]:
    # For who drives: what, from where, and where the log goes.
    lines = []
    if to == "ros2_node":
        lines.append(f"  python3 {shlex.join([str(file), '--out', str(logs.folder)])}")
        if not isinstance(logs.form, BagForm):
            lines.append("  its bags are no logs of this study: the key `log: {kind: rosbag}` reads them")
    else:
        lasting = quantity(drive.duration / drive.runs, "s")
        lines.append(f"  {count(drive.runs, 'run')} of {lasting}, from")
        for x, y, heading in drive.starts[:, :3].tolist():
            lines.append(f"    x {x:.4g} m, y {y:.4g} m, heading {degrees(heading):.4g} deg")
    lines.append(f"  its log into {logs.folder}; Ctrl-C ends, and the same command goes on")
    return lines


def _standing(number: int, known: Sequence[KnownParameter]) -> list[str]:
    lines = [f"After {count(number, 'drive')}:"]
    for one in known:
        unit, factor = own_unit(one.unit)
        value = f"{to_error(one.value, one.now, factor)} {unit}".strip()
        error, wanted = (f"{error_text(size, factor)} {unit}".strip() for size in (one.now, one.wanted))
        aim = "" if one.wanted is None else f", wanted {wanted}"
        lines.append(f"  {words(one.name)} {value}, standard error {error}{aim}")
    return lines

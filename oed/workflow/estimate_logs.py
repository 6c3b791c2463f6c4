"""`oed estimate`: a study and logs of its robot in, an estimate with everything that speaks for it out."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from oed.estimation import calibrate
from oed.foundation.arguments import typed
from oed.foundation.errors import FileIssue, LogError, ProblemError, UserMistake
from oed.foundation.extras import package_version
from oed.foundation.shown import shown
from oed.foundation.text import listing
from oed.foundation.work.folders import require_usable
from oed.logs import Log, LogForm, NotInLog, last_held_out, read_logs
from oed.optimize import Progress, Silent
from oed.records.calibration_outcome import estimate_of
from oed.records.outcomes import provenance
from oed.records.record import EstimateRecord
from oed.study.study import Study
from oed.workflow.arrivals import fingerprint_of, twin_of
from oed.workflow.saving import save_estimate

NO_NUMBER = r"expected a finite number, got '[-+]?(nan|inf)"
SKIPPING = "`skip_invalid_rows: true` leaves out what of a row is no finite number, and counts it"
NOT_RISING = r"time (goes back|stands still)"
"""What is said of a log that keys of the study may mend."""


class _Stages:
    """Stages of the work, each reported as begun when the one before is done."""

    def __init__(self, listener: Progress) -> None:
        self._listener, self._begun = listener, False

    def __call__(self, stage: str) -> None:
        self.done()
        self._listener.begin(stage, 1)
        self._begun = True

    def done(self) -> None:
        if self._begun:
            self._listener.advance()


@typed
def estimate(
    study: Study,
    logs: Sequence[str | Path] | str | Path,
    *,
    apart: Sequence[str | Path] = (),
    hold_out: float = 0.0,
    out: str | Path | None = None,
    seed: int | None = None,
    progress: Progress | None = None,
) -> EstimateRecord:
    """Estimate the parameters of a study's robot from logs of its drives.

    Args:
        study: names the robot, what to estimate, and how logs are read (keys `log`, `calibration`).
        logs: files to estimate from, or one of them.
        apart: files that only dead reckoning is tried on.
        hold_out: share of each log's duration, at its end, that only dead reckoning is tried on, too.
        out: folder for estimate.json; nothing is written without it.
        seed: of the bootstrap, instead of the study's.
        progress: informed how far the work is.

    Raises:
        LogError: logs that cannot be read, do not fit the robot, are given twice, or made the study's prior.
        StudyError: options that do not suit the robot or the logs, models that cannot be compared.
        UserMistake: a share to hold out that is none.
        WrongKind: no study.
    """
    if isinstance(logs, str | Path):
        logs = [logs]
    if out is not None:
        require_usable(out)
    if not 0 <= hold_out < 1:
        raise UserMistake(f"hold_out: expected a share of each log, at least 0 and below 1, got {hold_out:g}")
    _require_different([*logs, *apart], study.log)
    _require_new(logs, study)
    chosen = study.seed if seed is None else seed
    stage = _Stages(progress or Silent())
    stage("reading logs")
    kept, other = _read(study, logs), _read(study, apart) if apart else []
    if hold_out:
        kept, held = last_held_out(kept, hold_out)
        other += held
    try:
        found = calibrate(
            study.problem, kept, study.calibration, test_logs=other, seed=chosen, announce=stage
        )
    except ProblemError as error:
        raise study.error(error.issues) from None
    stage.done()
    record = estimate_of(
        found,
        oed_version=package_version("oed"),
        study=study.echo(),
        study_text=study.text,
        provenance=provenance(study.source),
        seed=chosen,
        method=study.calibration.method,
    )
    if out is not None:
        save_estimate(record, out)
    return record


def _require_different(files: Sequence[str | Path], form: LogForm) -> None:
    # Twice the same log would count as twice the evidence, whatever it is called.
    known, issues = dict[Path, str](), []
    for file in files:
        try:
            path = Path(os.path.realpath(file))
            path.exists()
        except (OSError, ValueError) as error:
            # A name that no file can have.
            issues.append(
                FileIssue(str(file), 0, 0, "", f"cannot be read: {getattr(error, 'strerror', error)}")
            )
            continue
        if path in known:
            issues.append(FileIssue(str(file), 0, 0, "", "given twice; a log counts once"))
        elif (twin := twin_of(path, known, form)) is not None:
            text = f"is the same as {known[twin]} to the byte; a log counts once"
            issues.append(FileIssue(str(file), 0, 0, "", text))
        known[path] = str(file)
    if issues:
        raise LogError(issues)


def _require_new(files: Sequence[str | Path], study: Study) -> None:
    # What a prior was estimated from is in it already; priors of earlier versions do not say from what.
    prior = study.problem.prior
    if prior is None or not prior.logs:
        return
    issues = []
    for file in files:
        # What cannot be read is refused where it is read.
        with suppress(OSError, ValueError):
            name = prior.logs.get(fingerprint_of(Path(file), study.log))
            if name is not None:
                text = f"is {shown(name)} to the byte, which made the study's prior; a log counts once"
                issues.append(FileIssue(str(file), 0, 0, "", text))
    if issues:
        raise LogError(issues)


def _read(study: Study, files: Sequence[str | Path]) -> list[Log]:
    try:
        return read_logs(files, study.log, study.problem.model, study.problem.measurement)
    except LogError as error:
        hint = _hint("\n".join(one.message for one in error.issues), study.log)
        if hint:
            raise LogError([*error.issues, FileIssue(study.source, 0, 0, "log", hint)]) from None
        # What is wrong with the log itself, the key would not mend.
        named = [one for one in error.issues if isinstance(one, NotInLog) and one.named]
        if study.of_robot.log is not None or not named:
            raise LogError([_with_place(one, study) for one in error.issues]) from None
        # The cause, and what follows from it in a line each.
        hint = "the study has no key `log`, which says what stands in which column of a log"
        raise LogError([FileIssue(study.source, 0, 0, "log", hint), *_gathered(error.issues)]) from None


def _hint(said: str, form: LogForm) -> str:
    # Which key may mend what is said of a log; "" where none does, or the study has it already.
    if re.search(NO_NUMBER, said, re.IGNORECASE) and not form.skip_invalid_rows:
        return SKIPPING
    return form.clock_hint if re.search(NOT_RISING, said) else ""


def _gathered(issues: Sequence[FileIssue]) -> Iterator[FileIssue]:
    # Of one file one issue of all columns that it lacks.
    lacking: dict[tuple[str, int], list[NotInLog]] = {}
    for one in issues:
        if isinstance(one, NotInLog) and one.named:
            lacking.setdefault((one.file, one.line), []).append(one)
        else:
            yield one
    for (file, line), some in lacking.items():
        if len(some) == 1:
            yield some[0]
            continue
        names = listing([one.key for one in some])
        yield FileIssue(file, line, 0, "", f"nothing says where {names} are{_there(some)}")


def _there(some: Sequence[NotInLog]) -> str:
    # What the file has, which every one of its issues says in the end.
    ends = {one.message.rpartition("; ")[2].rpartition("? ")[2] for one in some}
    return f"; {ends.pop()}" if len(ends) == 1 else ""


def _with_place(issue: FileIssue, study: Study) -> FileIssue:
    # What the log has not, and where the study names it, or would.
    if not isinstance(issue, NotInLog) or not issue.named:
        return issue
    found, line, _ = study.origin.place(issue.named)
    file = f"{study.source}:{line}" if line else study.source
    # The last part is that of a short form written out.
    given = len(found) >= len(issue.named) - 1
    key = ".".join(map(str, found if given else issue.named))
    text = f"{issue.message} ({'named' if given else 'name it'} in {file}: {key})"
    return replace(issue, message=text)

"""The next drive: what is known so far becomes prior and nominal values, and the study is designed anew."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from oed.foundation.arguments import typed
from oed.foundation.component import OneOf
from oed.foundation.equality import ByValue
from oed.foundation.errors import RecordError, UserMistake
from oed.foundation.presenting import Brief
from oed.logs import CsvForm
from oed.optimize import Progress, Workers
from oed.records.record import ESTIMATE, FILE, EstimateRecord, Record, estimate_files, pages
from oed.records.recorded_study import TRUST, recorded_study
from oed.robots.models import MODELS
from oed.robots.models.model import robot_of
from oed.study.study import Study, read_study
from oed.study.yaml_source import plain_source
from oed.uncertainty.uncertainty import Uncertainty
from oed.workflow.aims import aims_of, stretch
from oed.workflow.arrivals import fingerprint_of
from oed.workflow.estimate_logs import estimate
from oed.workflow.next_precision import predicted
from oed.workflow.runner import run
from oed.workflow.saving import RunFolder, outdated, run_folder

LEAST_GAIN = 0.05
"""Share of the standard error that another drive has to take away to be worth driving."""
STUDY, SUMMARY = "next.yaml", "next.json"


@dataclass(frozen=True)
class Precision:
    """What is known of a parameter; SI, None where there is no such number.

    Attributes:
        name, unit, value: of its estimate.
        now: its standard error.
        size: what relative errors of it refer to.
        wanted: the standard error to be reached.
        next: the one predicted after the next drive.
    """

    name: str
    unit: str | None
    value: float | None
    now: float | None
    size: float | None
    wanted: float | None
    next: float | None

    def relative(self, error: float | None) -> float:
        """An error in units of what is wanted, else of the parameter's size."""
        return float(error or 0.0) / float(self.wanted or self.size or 1.0)


@dataclass(frozen=True, repr=False, eq=False)
class NextDrive(ByValue, Brief):
    """What to do after the drives so far.

    Attributes:
        estimate: from the logs.
        study: the study of the next drive, None where none is needed.
        record: of its design.
        precision: of each parameter.
        gain: share by which the worst standard error falls, in units of what is wanted or of the value.
        stop: whether to stop driving.
        reason: why, or why not.
        basis: what the standard errors after the next drive rest on, in words; "" where there are none.
        folder: where it is saved, None where it is not.
    """

    estimate: EstimateRecord
    study: Study | None
    record: Record | None
    precision: tuple[Precision, ...]
    gain: float | None
    stop: bool
    reason: str
    basis: str = ""
    folder: Path | None = None

    @property
    def data(self) -> dict[str, Any]:
        """Plain data."""
        best = None if self.record is None or self.record.best is None else self.record.best.name
        return {
            "stop": self.stop,
            "reason": self.reason,
            "basis": self.basis,
            "gain": self.gain,
            "precision": [asdict(one) for one in self.precision],
            "design": best,
        }


@typed
def next_drive(
    saved: Record | Study,
    logs: Sequence[str | Path],
    *,
    targets: Mapping[str, str] | None = None,
    least_gain: float = LEAST_GAIN,
    duration: float | None = None,
    out: str | Path | None = None,
    seed: int | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
    trust: bool = False,
) -> NextDrive:
    """Estimate from logs; then design the drive that adds most information, or say that it is enough.

    Args:
        saved: record of the design that was driven, or its study. Where that has a prior, it counts: logs
            that made it are refused.
        logs: of all drives since.
        targets: standard errors wanted, by parameter, with a unit ("0.2 mm") or relative ("0.1 %").
        least_gain: share of the worst standard error that another drive has to take away.
        duration: of each run of the next drive [s]; that of the last one if None. The sample period and the
            splines' knots per second stay the same.
        out: folder for the next study, its record and designs, and the estimate; nothing is written without.
        seed: of every random draw, instead of the study's.
        workers: processes, or a cluster; does not change the result.
        progress: informed how far the work is.
        trust: whether Python code that the record names may be run, and other files that it names be read.

    Raises:
        RecordError: the robot is code that is not trusted, or the study has files read from elsewhere.
        UserMistake: targets for what is not estimated, or a study whose parameters are not the robot's.
        StudyError: a duration that no drive of the study can have.
        LogError: logs that cannot be read, do not fit the robot, or made the study's prior.
        NotSaved: `out` could not be written to in the end; the error has what was found.
    """
    study = saved if isinstance(saved, Study) else recorded_study(saved, trust=trust)
    if isinstance(saved, Record) and not trust:
        _refuse_outside(saved, logs)
    require_own_parameters(study)
    with run_folder(out) as folder:
        aims = aims_of(study, targets or {}, "--target")
        found = estimate(study, logs, seed=seed, progress=progress)
        wanted = {name: aim.size(found.values[name]) for name, aim in aims.items()}
        enough = bool(wanted) and all(found.errors[name] <= size for name, size in wanted.items())
        # Before anything is written: no such drive may be possible.
        following = None if enough else _following(study, found, duration, logs)
        folder.keep(lambda: estimate_files(found))
        if following is None:
            precision = _precision(found, wanted, {})
            reason = "every parameter is as precise as wanted: no further drive is needed"
            return _saved(NextDrive(found, None, None, precision, None, True, reason), folder)
        record = run(following, folder.draft, seed=seed, workers=workers, progress=progress)
        return _saved(_decided(found, following, record, wanted, least_gain), folder)


def _refuse_outside(record: Record, logs: Iterable[str | Path]) -> None:
    # A record from a file must not have anything read from elsewhere than beside the logs.
    form = record.robot_study.log
    if record.file is None or not isinstance(form, CsvForm):
        return
    for log in map(Path, logs):
        for key, found in form.beside(log).items():
            if not found.resolve().is_relative_to(log.parent.resolve()):
                text = f"leads to {found}, out of the folder of the log; {TRUST}"
                raise RecordError.about(record.file, text, f"study.log.{key}")


def _decided(
    found: EstimateRecord, study: Study, record: Record, wanted: Mapping[str, float], least_gain: float
) -> NextDrive:
    after = predicted(record, found, study)
    precision = _precision(found, wanted, after.errors)
    if record.interrupted or not after.errors:
        missing = "no feasible drive was found; the record says which limit is in the way"
        reason = "the search was interrupted; run it again" if record.interrupted else missing
        return NextDrive(found, study, record, precision, None, False, reason)
    # Of all of them where nothing is wanted.
    aimed = [one for one in precision if one.wanted is not None] or precision
    now, then = max(one.relative(one.now) for one in aimed), max(one.relative(one.next) for one in aimed)
    gain = 1 - then / now
    stop = gain < least_gain
    reason = f"another drive takes {100 * gain:.1f} % off the worst standard error"
    reason += f", less than {100 * least_gain:.1f} %: stop" if stop else ": drive it"
    return NextDrive(found, study, record, precision, float(gain), bool(stop), reason, basis=after.basis)


def require_own_parameters(study: Study) -> None:
    """Refuse a study whose parameters are not the robot's, so that no nominal values can stand for them.

    Raises:
        UserMistake: it estimates others.
    """
    known = {parameter.name for parameter in study.problem.model.parameters}
    strangers = [
        name for one in study.problem.any_estimations for name in one.parameters if name not in known
    ]
    if strangers:
        text = (
            f"the study estimates {', '.join(strangers)}, and no nominal values can stand for those: measure "
            "poses and estimate the robot's own parameters"
        )
        raise UserMistake(text)


def _following(
    study: Study, found: EstimateRecord, duration: float | None, logs: Sequence[str | Path]
) -> Study:
    # The same study of the robot as it is known now; simulations are for its own report.
    data, values = study.echo(), found.values
    robot = robot_of(study.problem.model).with_values(values)
    data["robot"] = OneOf(MODELS).as_data(robot)
    before = {} if study.problem.prior is None else study.problem.prior.logs
    known = before | {fingerprint_of(Path(log), study.log): str(log) for log in logs}
    data["prior"] = {"parameters": list(values), "covariance": found.covariance, "logs": known}
    data["name"] = f"{study.name}: next drive"
    _narrow(data, study, values)
    if duration is not None:
        stretch(data["trajectory"], duration)
    data.pop("validation", None)
    data.pop("physics", None)
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
    return read_study(plain_source(STUDY, text, data))


def _narrow(data: dict[str, Any], study: Study, values: Mapping[str, float]) -> None:
    # What the logs made known is uncertain no longer as the study said, but as the prior now says.
    said = study.problem.uncertainty
    data.pop("uncertainty", None)
    left = said.without(values, study.problem.model) if isinstance(said, Uncertainty) else None
    if left is not None:
        data["uncertainty"] = left.model_dump(mode="json")
    if data.get("robust"):
        data["robust"].pop("kept", None)
        # The corners of wide ranges are for drives before anything is known.
        data["robust"]["kind"] = "chance" if data["robust"]["kind"] == "scenarios" else data["robust"]["kind"]


def _precision(
    found: EstimateRecord, wanted: Mapping[str, float], after: Mapping[str, float]
) -> tuple[Precision, ...]:
    return tuple(
        Precision(
            name=one.name,
            unit=one.unit,
            value=one.value,
            now=one.standard_error,
            size=one.size,
            wanted=wanted.get(one.name),
            next=after.get(one.name),
        )
        for one in found.parameters
    )


def _saved(found: NextDrive, folder: RunFolder) -> NextDrive:
    if folder.draft is None:
        return found
    files = {
        **estimate_files(found.estimate),
        SUMMARY: json.dumps(found.data, indent=1, allow_nan=False) + "\n",
    }
    if found.study is not None:
        files[STUDY] = found.study.text
    # A design from before must not pass for the next drive.
    target = folder.draft.target
    drop = {STUDY, FILE} | outdated(target, found.record) | pages(target, ESTIMATE)
    interrupted = found.record is not None and found.record.interrupted
    return replace(found, folder=folder.put(files, found, drop, interrupted=interrupted))

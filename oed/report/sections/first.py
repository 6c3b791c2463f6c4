"""The first screen: the drive, to be played, beside what it gives; how to drive it and what is assumed."""

from __future__ import annotations

import shlex
from dataclasses import replace

import numpy as np

from oed.records.path_file import drive_csv
from oed.records.record import Record
from oed.report.parts.inputs import inputs_of
from oed.report.parts.judging import judged, meaning
from oed.report.parts.prose import Prose
from oed.report.parts.reading import (
    STATES,
    capital,
    duration_text,
    measured_as,
    nuisance_text,
    prior_text,
    readings_text,
    regression_of,
)
from oed.report.parts.section import Download, Section
from oed.report.sections.drives import best_path, player
from oed.report.sections.summary import summary

SAY = Prose("first")


def first(record: Record) -> Section:
    """The summary, with the drive to be played beside it, what to do next, and what all this assumes."""
    made = replace(summary(record), folds=(Section(SAY("assumed_title"), tuple(_assumed(record))),))
    animation = player(record) if record.best is not None else None
    if animation is None:
        return made
    said = [one.removeprefix(f"{record.study.name}: ") for one in made.paragraphs]
    still = best_path(record)
    return replace(
        made,
        paragraphs=(capital(said[0]), *said[1:]),
        figures=() if still is None else (still,),
        animation=animation,
        downloads=_downloads(record),
        commands=_commands(record),
        first=True,
    )


def _commands(record: Record) -> tuple[tuple[str, str], ...]:
    # What to do with a design: in the folder of its page, and then with its study.
    if record.best is None:
        return ()
    study = record.provenance.study if record.provenance is not None else ""
    estimating = f"oed estimate {shlex.quote(study or 'STUDY.yaml')} LOG.csv"
    exporting = (f"oed export . --to {kind}" for kind in ("ros2_node", "rosbag2", "json"))
    found = tuple(zip(SAY.paragraphs("commands"), (*exporting, estimating), strict=True))
    # No node plays what is driven by a force.
    return found[record.pushed :]


def _downloads(record: Record) -> tuple[Download, ...]:
    best = record.best
    if best is None or best.drive is None:
        return ()
    drive = best.drive
    inputs = [one.name for one in inputs_of(record, len(drive.coefficients[0]))]
    states = [one.name for one in record.states] or list(STATES)
    text = drive_csv(drive.trajectory, np.array(drive.poses), inputs, states)
    return (Download(SAY("csv"), "drive.csv", text),)


def _assumed(record: Record) -> list[str]:
    names = [one.name for one in judged(record)]
    how = readings_text(record) if regression_of(record) is None else ""
    yours = SAY("question", record.robot_study.robot.kind, duration_text(record), names, measured_as(record))
    criterion = SAY("criterion", meaning(record))
    bound = SAY("bound", record.certificate) if record.certificate is not None else ""
    said = (yours, how, nuisance_text(record), prior_text(record), criterion, bound)
    return [one for one in said if one]

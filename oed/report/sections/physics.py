"""Drives of a simulated robot with slip: which drive and model predict best, and how surely."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from oed.foundation.text import count, fixed, listing, quantity, significant, words
from oed.records.record import Record
from oed.report.parts.section import Picture, Section
from oed.report.parts.tables import Cell, Column, Table

Entry = Mapping[str, Any]

MILLIMETRES = 1e3
BEST = " ← best"
DRIVES = {
    "straight": "straight there",
    "circle": "one circle to the left",
    "square": "a square to the left and one to the right, spinning at the corners, at the limits of speed",
    "slow square": "the square to the left alone, over the whole duration at half the speed",
    "straight and spin": "there, a full turn on the spot, back, and the turn undone",
    "random": "splines drawn at random, of another draw than any held-out drive",
}
"""Everyday path -> what it is."""


def physics(record: Record) -> Section | None:
    """Held-out errors of every drive and model, scatter of the estimates and true paths."""
    data = record.data.get("physics")
    if not data:
        return None
    floors = [floor for floor in data["floors"] if floor["errors"]]
    return Section(
        "Drives of a simulated robot with slip",
        paragraphs=(_intro(record, data), _drives(data)),
        notices=tuple(_notices(data, floors)),
        figures=_figures(data, floors) if floors else (),
        tables=(
            *(_error_table(data, floor) for floor in floors),
            *([_scatter_table(data, floors)] if floors else ()),
        ),
    )


def _intro(record: Record, data: Entry) -> str:
    frictions = listing([f"{friction:g}" for friction in data["frictions"]])
    variation = data["variation"]
    drawn = f"friction {variation['friction']:.0%} and every wheel's grip {variation['grip']:.0%}"
    methods = listing(list(dict.fromkeys(words(fit["method"]) for fit in data["fits"])))
    duration = quantity(record.data["study"]["trajectory"]["duration"], "s")
    return (
        f"A robot ({words(data['robot']['kind'])}) with masses, motors and friction, that obeys none of the "
        f"models exactly, was simulated on floors of friction {frictions}; {data['repeats']} robots were "
        f"drawn for each ({drawn}, standard deviations). Each drove {duration} along every path, read with "
        f"the study's noise; from each drive alone every model was calibrated ({methods}), and predicted "
        f"{data['held_out']} random drives by dead reckoning: from their true start, with the encoders' "
        "readings alone. An error is the distance between where the robot truly is at the end and where "
        "dead reckoning has it: the median over held-out drives, and then over robots. Intervals hold 95 % "
        "of bootstrap resamples of the robots."
    )


def _drives(data: Entry) -> str:
    told = [
        f"{entry['name']}: {DRIVES[entry['name']]}"
        for entry in data["planned"]
        if entry["model"] is None and entry["name"] in DRIVES
    ]
    everyday = f" Everyday paths are as large as the limits allow. {'; '.join(told)}." if told else ""
    designed = listing(
        [f"{entry['model']} by {entry['criterion']}" for entry in data["planned"] if entry["model"]]
    )
    return f"Every model has an optimal drive of its own, designed at nominal values: {designed}.{everyday}"


def _notices(data: Entry, floors: Sequence[Entry]) -> Iterator[str]:
    if data["interrupted"]:
        done = listing([f"{floor['done']} at friction {floor['friction']:g}" for floor in data["floors"]])
        kept = "these are those done by then" if floors else "that is too few to say anything"
        asked = count(data["repeats"], "robot")
        yield f"The trial was interrupted; of {asked} each, {done} had driven: {kept}."
    left_out = [entry["name"] for entry in data["planned"] if not entry["feasible"]]
    if left_out:
        yield f"Left out, for they break the limits or were not found: {listing(left_out)}."
    refused = sum(entry["refused"] for floor in floors for entry in floor["errors"])
    if refused:
        yield f"{count(refused, 'calibration')} of a drive were refused; they count as infinitely wrong."


def _error_table(data: Entry, floor: Entry) -> Table:
    fits = [fit["name"] for fit in data["fits"]]
    table = {(entry["drive"], entry["fit"]): entry for entry in floor["errors"]}
    best = min(table, key=lambda key: _size(table[key]))
    drives = list(dict.fromkeys(drive for drive, _ in table))
    rows = [
        (drive, *(_error_text(table[drive, fit], best == (drive, fit)) for fit in fits)) for drive in drives
    ]
    columns = (Column("calibrated from"), *(Column(fit, "mm") for fit in fits))
    caption = (
        f"Held-out error at friction {floor['friction']:g}, with its interval over {floor['done']} robots"
    )
    return Table(columns, tuple(rows), caption)


def _size(entry: Entry) -> float:
    return float("inf") if entry["value"] is None else float(entry["value"])


def _error_text(entry: Entry, best: bool) -> str:
    if entry["value"] is None:
        return "refused"
    value, low, high = (_millimetres(entry[key]) for key in ("value", "low", "high"))
    return f"{value} ({low} to {high}){BEST if best else ''}"


def _millimetres(value: float | None) -> str:
    return "∞" if value is None else significant(3)(MILLIMETRES * value)


def _scatter_table(data: Entry, floors: Sequence[Entry]) -> Table:
    own = data["models"][0]
    names = [entry["name"] for entry in own["parameters"]]
    promised = {entry["name"]: entry["promised"] or {} for entry in data["planned"]}
    rows = [
        (f"{floor['friction']:g}", entry["drive"], *_scatter_cells(entry, own, promised[entry["drive"]]))
        for floor in floors
        for entry in floor["scatter"]
        if entry["fit"] == own["name"]
    ]
    columns = (
        Column("friction"),
        Column("calibrated from"),
        *(Column(words(name), "%", fixed(3)) for name in names),
        Column("all", "%", fixed(3)),
        Column("interval", "%"),
        Column("promised by noise alone", "%", fixed(3)),
    )
    caption = (
        f"Scatter of the estimates of {own['name']} over robots, relative to nominal values, and the root "
        "mean square over the parameters; beside it what the readings' noise alone would make of it"
    )
    return Table(columns, tuple(rows), caption)


def _scatter_cells(entry: Entry, own: Entry, promised: Mapping[str, float | None]) -> tuple[Cell, ...]:
    sizes = [(promised.get(one["name"]), one["scale"]) for one in own["parameters"]]
    shares = [100 * size / scale for size, scale in sizes if size is not None]
    noise = float(np.sqrt(np.mean(np.square(shares)))) if len(shares) == len(sizes) else None
    total = entry["total"]
    return (
        *(100 * value for value in entry["relative"]),
        None if total["value"] is None else 100 * total["value"],
        f"{100 * (total['low'] or 0):.3f} to {100 * (total['high'] or 0):.3f}",
        noise,
    )


def _figures(data: Entry, floors: Sequence[Entry]) -> tuple[Picture, ...]:
    return (
        Picture(
            "held_out_errors",
            "Held-out errors by the drive calibrated from and the model",
            "Held-out error by the drive that a model was calibrated from, median over robots with its "
            "interval; what is far off stands at the right edge.",
            partial(_draw_errors, data, floors),
        ),
        Picture(
            "true_paths",
            "Where the simulated robot went on every drive, and where it was to go",
            "Every drive as planned and as the first robot of each floor truly drove it: slip makes it turn "
            "less or more than the nominal track says.",
            partial(_draw_paths, data, floors),
        ),
    )


def _draw_errors(data: Entry, floors: Sequence[Entry]) -> Any:
    from oed.report.figures import trial_panels

    return trial_panels.errors([_drawn_floor(data, floor) for floor in floors])


def _drawn_floor(data: Entry, floor: Entry) -> Any:
    from oed.report.figures.trial_panels import Floor

    fits = tuple(fit["name"] for fit in data["fits"])
    table = {(entry["drive"], entry["fit"]): entry for entry in floor["errors"]}
    drives = tuple(dict.fromkeys(drive for drive, _ in table))
    keys = ("value", "low", "high")
    errors = [[[table[drive, fit][key] for key in keys] for fit in fits] for drive in drives]
    sizes = MILLIMETRES * np.array(errors, dtype=float)
    return Floor(f"friction {floor['friction']:g}", drives, fits, sizes)


def _draw_paths(data: Entry, floors: Sequence[Entry]) -> Any:
    from oed.report.figures import trial_panels

    planned = {entry["name"]: np.array(entry["path"]) for entry in data["planned"] if entry["path"]}
    drives = [
        trial_panels.Went(
            name,
            planned[name],
            tuple(
                (f"driven, friction {floor['friction']:g}", np.array(floor["paths"][name]))
                for floor in floors
            ),
        )
        for name in floors[0]["paths"]
    ]
    return trial_panels.went(drives)

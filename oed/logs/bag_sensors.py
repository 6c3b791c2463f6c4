"""What sensors beside the poses read, in a ROS bag: any numbers of its messages, by their paths."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic import model_validator

from oed.foundation.errors import Flaw
from oed.foundation.text import count, did_you_mean, listing
from oed.kernel.measurement.sensor import Sensor
from oed.logs.bag import Bag
from oed.logs.bag import Clock as Stamps
from oed.logs.input_forms import unit_factor, unit_reason
from oed.logs.points import ROWS, gathered, quantities_of, units_of
from oed.logs.sensors import AS_LIST, Sensed, SensorSource, checked
from oed.logs.series import Series, together

USUAL = {
    "yaw_rate": ("sensor_msgs/msg/Imu", "angular_velocity.z"),
    "ranges": ("sensor_msgs/msg/Range", "range"),
}
"""Types of messages that sensors usually send, and where in them their reading is."""
STEP = re.compile(r"[^.\[\]]+")


Listed = Annotated[tuple[str, ...], AS_LIST]


class SensorTopic(SensorSource):
    """Where in a bag a sensor's readings are. Paths are like `angular_velocity.z` or `data[2]`.

    Attributes:
        topic, topics: of the messages; several where each entry of a reading has its own. By default the only
            one of a type that the sensor usually sends (Imu, Range).
        field, fields: paths of the entries of a reading, in their order; one for all of several topics.
        each: path of a list in a message, each of whose items is of one beacon, landmark or tag.
        id: path, within the item or message, of which it is.
        range, bearing, orientation: paths beside that; of their own names by default.
    """

    topics: Listed = ()
    fields: Listed = ()
    each: str | None = None
    id: str | None = None
    range: str | None = None
    bearing: str | None = None
    orientation: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _one(cls, value: Any) -> Any:
        found = {"topic": "topics", "field": "fields"}
        return (
            {found.get(key, key): one for key, one in value.items()} if isinstance(value, Mapping) else value
        )

    def flaws(self, name: str, sensor: Sensor) -> list[Flaw]:
        """Numbers of topics, of fields and units that do not fit the sensor."""
        key, flaws, wanted = ("log", "sensors", name), [], len(sensor.entries)
        fields, topics = len(self._fields(sensor)), len(self.topics)
        one_topic, several = topics < 2 and fields == wanted, topics == wanted and fields in (1, wanted)
        if self.id is None and not (one_topic or several):
            got = f"{count(topics, 'topic')} and {count(fields, 'field')}"
            text = f"expected {count(wanted, 'field')} of one topic, or as many topics; got {got}"
            flaws.append(Flaw((*key, "fields"), text))
        units = dict.fromkeys(units_of(sensor, self.id is not None))
        reasons = (unit_reason(self.unit, unit) for unit in units)
        return [*flaws, *(Flaw((*key, "unit"), reason) for reason in reasons if reason)]

    def read(self, name: str, sensor: Sensor, bag: Bag, stamps: Stamps, *, skip: bool) -> Sensed:
        """All that the sensor read.

        Raises:
            LogError: topics and fields that are not there, numbers that are none, ids nobody knows.
        """
        topics = self.topics or (_only(bag, name, sensor),)
        if self.id is not None:
            series = self._of_points(bag, topics[0], name, sensor, stamps)
        else:
            fields = self._fields(sensor)
            # One topic has all entries, or each of several has one of them, in a field of its own or alike.
            alike = fields * len(topics) if len(fields) == 1 else fields
            own = [[one] for one in alike] if len(topics) > 1 else [fields]
            series = _side_by_side(
                together(
                    partial(_series, bag, topic, one, name, stamps, skip=skip)
                    for topic, one in zip(topics, own, strict=True)
                )
            )
        factors = [unit_factor(self.unit, unit) for unit in sensor.units]
        series = series.with_values(series.values * factors)
        return checked(Sensed(name, series, self.clock_of(sensor)), sensor)

    def _fields(self, sensor: Sensor) -> tuple[str, ...]:
        usual = USUAL.get(str(sensor.kind))
        return self.fields or ((usual[1],) if usual else ())

    def _of_points(self, bag: Bag, topic: str, name: str, sensor: Sensor, stamps: Stamps) -> Series:
        quantities = quantities_of(sensor)
        paths = [getattr(self, one) or one for one in ROWS if one in quantities]
        ids, rows, lines, times = list[str](), list[list[float]](), list[int](), list[float]()
        for number, time, message in _messages(bag, topic, name, stamps):
            for item in _at(bag, name, message, self.each) if self.each else [message]:
                ids.append(str(_at(bag, name, item, self.id or "")))
                rows.append([_number(bag, name, item, path) for path in paths])
                lines.append(number)
                times.append(time)
        values = np.array(rows, dtype=float).reshape(len(rows), len(paths))
        places = np.array(lines, dtype=np.intp)
        series = Series(bag.file, topic, np.array(times), values, places, counted="message")
        return gathered(series, ids, None, name, sensor)[0]


def usual_type(name: str) -> tuple[str, ...]:
    """The type of message that a sensor of that name usually sends; () where none is usual."""
    kind, _, number = name.rpartition("_")
    usual = USUAL.get(kind if number.isdigit() else name)
    return () if usual is None else usual[:1]


def _only(bag: Bag, name: str, sensor: Sensor) -> str:
    usual = USUAL.get(str(sensor.kind))
    if usual is None:
        text = f"the topic of {name} is needed; the bag has {', '.join(sorted(bag.types))}"
        raise bag.flaw(name, text, "sensors", name, "topic")
    return bag.topic(None, (usual[0],), name)


def _messages(bag: Bag, topic: str, name: str, stamps: Stamps) -> Iterator[tuple[int, float, Any]]:
    if topic not in bag.types:
        hint = did_you_mean(topic, bag.types) or ";"
        text = f"the bag has no topic {topic}{hint} it has {', '.join(sorted(bag.types))}"
        raise bag.flaw(name, text, "sensors", name, "topic")
    try:
        yield from bag.messages(topic, stamps)
    except AttributeError:
        raise bag.flaw(name, f"the messages of {topic} have no stamps; say `clock: received`") from None


def _series(bag: Bag, topic: str, fields: Sequence[str], name: str, stamps: Stamps, *, skip: bool) -> Series:
    found = [
        (time, [_number(bag, name, message, path) for path in fields], number)
        for number, time, message in _messages(bag, topic, name, stamps)
    ]
    values = np.array([row for _, row, _ in found], dtype=float).reshape(len(found), len(fields))
    lines = np.array([number for *_, number in found], dtype=np.intp)
    times = np.array([time for time, *_ in found], dtype=float)
    series = Series(bag.file, topic, times, values, lines, counted="message")
    return series.finite(skip).without_repeats()


def _side_by_side(parts: Sequence[Series]) -> Series:
    # Topics with times of their own, each a column or more.
    if len(parts) == 1:
        return parts[0]
    times = np.unique(np.concatenate([one.times for one in parts]))
    columns, lines = list[np.typing.NDArray[np.float64]](), np.zeros(len(times), dtype=np.intp)
    for one in parts:
        own = np.full((len(times), one.values.shape[1]), np.nan)
        rows = np.searchsorted(times, one.times)
        own[rows], lines[rows] = one.values, one.lines
        columns.append(own)
    first = parts[0]
    return Series(first.file, first.clock, times, np.hstack(columns), lines, counted=first.counted)


def _at(bag: Bag, name: str, message: Any, path: str) -> Any:
    found = message
    for step in STEP.findall(path):
        try:
            found = found[int(step)] if step.isdecimal() else getattr(found, step)
        except (AttributeError, IndexError, TypeError):
            known = (
                [one for one in vars(found) if not one.startswith("_")] if hasattr(found, "__dict__") else []
            )
            there = f"; it has {listing(known)}" if known else ""
            text = f"there is no {step} of {path} in the messages{there}"
            raise bag.flaw(name, text, "sensors", name, "field") from None
    return found


def _number(bag: Bag, name: str, message: Any, path: str) -> float:
    found = _at(bag, name, message, path)
    try:
        return float(found)
    except (TypeError, ValueError):
        text = f"{path} is no number but {type(found).__name__}"
        raise bag.flaw(name, text, "sensors", name, "field") from None

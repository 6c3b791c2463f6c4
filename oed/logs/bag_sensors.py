"""What sensors beside the poses read, in a ROS bag: any numbers of its messages, by their paths."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic import model_validator

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue
from oed.foundation.text import count
from oed.kernel.measurement.sensor import Sensor
from oed.logs.bag import Bag, series_of
from oed.logs.bag import Clock as Stamps
from oed.logs.bag_fields import (
    AnyNumberField,
    FieldPath,
    NumberField,
    id_in,
    items_in,
    number_in,
    read_fields,
    refused,
)
from oed.logs.points import ROWS, gathered, quantities_of, units_of
from oed.logs.sensors import AS_LIST, Sensed, SensorSource, checked
from oed.logs.series import Series, together

USUAL = {
    "yaw_rate": ("sensor_msgs/msg/Imu", "angular_velocity.z"),
    "ranges": ("sensor_msgs/msg/Range", "range"),
}
"""Types of messages that sensors usually send, and where in them their reading is."""


class SensorTopic(SensorSource):
    """Where in a bag a sensor's readings are. Paths are like `angular_velocity.z` or `data[2]`.

    Attributes:
        topic, topics: of the messages; several where each entry of a reading has its own. By default the only
            one of a type that the sensor usually sends (Imu, Range).
        field, fields: paths of the entries of a reading, in their order; one for all of several topics.
        each: path of a list in a message, each of whose items is of one beacon, landmark or tag.
        id: path, within the item or message, of which it is.
        range, bearing, orientation: paths beside that; of their own names by default. These and the fields
            may have units of their own: `bearing: {field: yaw, unit: deg}`.
    """

    topics: Annotated[tuple[str, ...], AS_LIST] = ()
    fields: Annotated[tuple[AnyNumberField, ...], AS_LIST] = ()
    each: FieldPath | None = None
    id: FieldPath | None = None
    range: AnyNumberField | None = None
    bearing: AnyNumberField | None = None
    orientation: AnyNumberField | None = None

    @model_validator(mode="before")
    @classmethod
    def _one(cls, value: Any) -> Any:
        found = {"topic": "topics", "field": "fields"}
        return (
            {found.get(key, key): one for key, one in value.items()} if isinstance(value, Mapping) else value
        )

    def issues(self, name: str, sensor: Sensor) -> list[Issue]:
        """Numbers of topics, of fields and units that do not fit the sensor."""
        key, issues, wanted = ("log", "sensors", name), [], len(sensor.entries)
        fields, topics = len(self._fields(sensor)), len(self.topics)
        one_topic, several = topics < 2 and fields == wanted, topics == wanted and fields in (1, wanted)
        if self.id is None and not (one_topic or several):
            got = f"{count(topics, 'topic')} and {count(fields, 'field')}"
            text = f"expected {count(wanted, 'field')} of one topic, or as many topics; got {got}"
            issues.append(Issue((*key, "fields"), text))
        twice = [topic for topic, times in Counter(self.topics).items() if times > 1 and fields == 1]
        issues += [Issue((*key, "topics"), f"{topic} is listed twice; name another") for topic in twice]
        return [*issues, *self.unit_issues(name, self._places(sensor), units_of(sensor, self.id is not None))]

    def read(self, name: str, sensor: Sensor, bag: Bag, stamps: Stamps, *, skip: bool) -> Sensed:
        """All that the sensor read.

        Raises:
            LogError: topics and fields that are not there, numbers that are none, ids nobody knows.
        """
        topics = self.topics or (_only(bag, name, sensor),)
        for topic in topics:
            bag.any_topic(topic, name, "sensors", name, "topic")

        def own(index: int) -> Series:
            # Each of several topics has one of the entries, and is looked at for itself.
            of_topic = slice(index, index + 1) if len(topics) > 1 else slice(None)
            read = self._of_points if self.id is not None else partial(self._of_entries, own=of_topic)
            series = read(bag, topics[index], name, sensor, stamps, skip=skip)
            return checked(Sensed(name, series, self.clock_of(sensor)), sensor).series

        parts = together(partial(own, index) for index in range(len(topics)))
        return Sensed(name, _merged(parts), self.clock_of(sensor))

    def _fields(self, sensor: Sensor) -> tuple[NumberField, ...]:
        usual = USUAL.get(str(sensor.kind))
        return self.fields or ((NumberField(field=usual[1]),) if usual else ())

    def _places(self, sensor: Sensor) -> tuple[NumberField, ...]:
        # Of every entry of a reading; or of the quantities of one point.
        if self.id is None:
            fields = self._fields(sensor)
            return fields * len(sensor.entries) if len(fields) == 1 else fields
        return tuple(getattr(self, one) or NumberField(field=one) for one in _quantities(sensor))

    def _of_entries(
        self, bag: Bag, topic: str, name: str, sensor: Sensor, stamps: Stamps, *, own: slice, skip: bool
    ) -> Series:
        # Of a reading those entries that are its own, the others not-a-number.
        places = self._places(sensor)
        paths = [one.field for one in places[own]]
        series = read_fields(bag, topic, paths, stamps, "sensors", name, "field").finite(skip)
        values = np.full((len(series), len(places)), np.nan)
        values[:, own] = series.values
        return series.with_values(values * self.factors(places, sensor.units)).without_repeats()

    def _of_points(
        self, bag: Bag, topic: str, name: str, sensor: Sensor, stamps: Stamps, *, skip: bool
    ) -> Series:
        keys, places = _quantities(sensor), self._places(sensor)
        ids, rows = list[str](), list[list[float]]()
        for number, time, message in bag.messages(topic, stamps):
            at = partial(refused, bag, topic, number, "sensors", name)
            with at("each"):
                items = [message] if self.each is None else items_in(message, self.each)
            for item in items:
                with at("id"):
                    ids.append(id_in(item, self.id or ""))
                rows.append([time])
                for key, one in zip(keys, places, strict=True):
                    with at(key):
                        rows[-1].append(number_in(item, one.field))
                rows[-1].append(number)
        if not rows:
            raise bag.issue(topic, f"there is no reading of {name} in its messages", "sensors", name, "topic")
        series = series_of(bag, topic, rows)
        known = np.flatnonzero(np.isfinite(series.values).all(axis=1)).tolist()
        series = series.finite(skip)
        series = series.with_values(series.values * self.factors(places, units_of(sensor, True)))
        return gathered(series, [ids[row] for row in known], None, name, sensor)[0]


def _quantities(sensor: Sensor) -> list[str]:
    return [one for one in ROWS if one in quantities_of(sensor)]


def usual_type(name: str) -> tuple[str, ...]:
    """The type of message that a sensor of that name usually sends; () where none is usual."""
    kind, _, number = name.rpartition("_")
    usual = USUAL.get(kind if number.isdigit() else name)
    return () if usual is None else usual[:1]


def _only(bag: Bag, name: str, sensor: Sensor) -> str:
    usual = USUAL.get(str(sensor.kind))
    if usual is None:
        text = f"the topic of {name} is needed; the bag has {', '.join(sorted(bag.types))}"
        raise bag.issue(name, text, "sensors", name, "topic")
    return bag.topic(None, (usual[0],), name)


def _merged(parts: Sequence[Series]) -> Series:
    # Topics with times of their own, each with other entries of a reading.
    if len(parts) == 1:
        return parts[0]
    times: Array = np.unique(np.concatenate([one.times for one in parts]))
    values = np.full((len(times), parts[0].values.shape[1]), np.nan)
    lines = np.zeros(len(times), dtype=np.intp)
    for one in parts:
        rows = np.searchsorted(times, one.times)
        values[rows] = np.where(np.isnan(one.values), values[rows], one.values)
        lines[rows] = one.lines
    return replace(parts[0], times=times, values=values, lines=lines)

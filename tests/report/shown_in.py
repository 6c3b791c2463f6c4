"""What a report shows: a section by its title, a column of a table by its heading."""

from __future__ import annotations

from oed.records.record import Record
from oed.report.page import sections_of
from oed.report.parts.section import Section, Table


def section(record: Record, title: str) -> Section:
    return next(part for part in sections_of(record) if part.title == title)


def column(table: Table, title: str) -> list[object]:
    index = [entry.title for entry in table.columns].index(title)
    return [row[index] for row in table.rows]


def text_of(part: Section) -> str:
    return " ".join(part.paragraphs)

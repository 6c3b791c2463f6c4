"""What made the record, and the study as it was written."""

from __future__ import annotations

from oed.records.record import Record
from oed.report.parts.section import Section
from oed.report.parts.tables import Column, Table


def provenance(record: Record) -> Section:
    """Versions, seed and time, and the study's own text."""
    data = record.data
    origin = data["provenance"]
    rows = [
        ("oed", data["oed_version"]),
        *origin["packages"].items(),
        ("Python", origin["python"]),
        ("platform", origin["platform"]),
        ("seed", str(data["seed"])),
        ("finished", origin["finished"]),
    ]
    text = "What computed this record, and the study that it is the outcome of."
    table = Table((Column("what"), Column("value")), tuple(rows))
    return Section("Provenance", paragraphs=(text,), tables=(table,), code=data["study_text"])

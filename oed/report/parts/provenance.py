"""What computed a record or an estimate, and the study that it is the outcome of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oed.foundation.text import words
from oed.records.record import Record
from oed.records.stored.estimate import EstimateRecord
from oed.report.parts.prose import Prose
from oed.report.parts.section import Column, Section, Table

SAY = Prose("provenance")


def provenance(record: Record) -> Section:
    """Versions, seed and time, and the study's own text."""
    made = record.provenance
    return _section(SAY("record"), record.version, made, {"seed": record.seed}, record.study_text)


def estimate_provenance(record: EstimateRecord) -> Section:
    """Versions, seed, method and time, and the study's own text, or else all that it was read as."""
    text, method = record.study_text, words(record.method) if record.method else None
    asked = {"seed": record.seed, "method": method}
    said, code = SAY("estimate", not text), text or _as_yaml(record.study)
    return _section(said, record.oed_version, record.provenance, asked, code)


def _section(said: str, version: str | None, made: Any, asked: Mapping[str, Any], code: str) -> Section:
    rows: dict[str, Any] = {
        "oed": version,
        **(made.packages if made else {}),
        "Python": made and made.python,
        "platform": made and made.platform,
        **asked,
        "finished": made and made.finished,
    }
    cells = tuple((name, str(value)) for name, value in rows.items() if value is not None)
    table = Table((Column("what"), Column("value")), cells)
    return Section("Provenance", paragraphs=(said,), tables=(table,), code=code)


def _as_yaml(study: Any) -> str:
    import yaml

    text = yaml.safe_dump(study or {}, sort_keys=False, allow_unicode=True, default_flow_style=None, width=96)
    return str(text)

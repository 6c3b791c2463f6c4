"""What made the estimate, and the study."""

from __future__ import annotations

from typing import Any

from oed.foundation.text import words
from oed.records.stored.estimate import EstimateRecord
from oed.report.parts.prose import Prose
from oed.report.parts.section import Column, Section, Table

SAY = Prose("estimate/provenance")


def provenance(record: EstimateRecord) -> Section:
    """Version, seed and method, and the study's own text, or else all that it was read as."""
    made, text = record.provenance, record.study_text
    rows: dict[str, Any] = {
        "oed": record.oed_version,
        **(made.packages if made else {}),
        "Python": made and made.python,
        "platform": made and made.platform,
        "seed": record.seed,
        "method": words(record.method) if record.method else None,
        "finished": made and made.finished,
    }
    cells = tuple((name, str(value)) for name, value in rows.items() if value is not None)
    table = Table((Column("what"), Column("value")), cells)
    said = SAY("origin", not text)
    return Section("Provenance", paragraphs=(said,), tables=(table,), code=text or _as_yaml(record.study))


def _as_yaml(study: Any) -> str:
    import yaml

    text = yaml.safe_dump(study or {}, sort_keys=False, allow_unicode=True, default_flow_style=None, width=96)
    return str(text)

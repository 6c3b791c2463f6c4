"""What made the estimate, and the study."""

from __future__ import annotations

import json
from typing import Any

from oed.foundation.text import words
from oed.report.estimate.reading import Data, study_of
from oed.report.parts.section import Section
from oed.report.parts.tables import Column, Table


def provenance(data: Data) -> Section:
    """Version, seed and method, and the study's own text, or else all that it was read as."""
    origin = data.get("provenance") or {}
    rows = {
        "oed": data.get("oed_version"),
        **origin.get("packages", {}),
        "Python": origin.get("python"),
        "platform": origin.get("platform"),
        "seed": data.get("seed"),
        "method": words(str(data["method"])) if data.get("method") else None,
        "finished": origin.get("finished"),
    }
    told = tuple((name, str(value)) for name, value in rows.items() if value is not None)
    text = "What computed this estimate, and the study that it was made for"
    given = data.get("study_text")
    text += "." if given else ", as it was read, in SI units."
    table = Table((Column("what"), Column("value")), told)
    return Section("Provenance", paragraphs=(text,), tables=(table,), code=given or _laid_out(study_of(data)))


def _laid_out(study: Any) -> str:
    import yaml

    plain = json.loads(json.dumps(study))
    return str(yaml.safe_dump(plain, sort_keys=False, allow_unicode=True, default_flow_style=None, width=96))

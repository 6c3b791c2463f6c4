"""The page of a trial that an earlier version saved, with its verdicts about goals of the project's own."""

from __future__ import annotations

from places import REPORTS
from recorded import record_from

from oed.records.record import load_record
from oed.report.sections.physics import physics


def test_the_page_judges_nothing_by_goals_that_the_user_never_set():
    data = load_record(REPORTS / "physics_skid_steer").data
    for floor in data["physics"]["floors"]:
        floor["goals"] = [{"kind": "error", "ratio": 0.6, "most": 0.5, "met": False, "sure": True}]
    record = record_from(data)
    assert record.data["physics"]["floors"][0]["goals"], "saved with verdicts"
    section = physics(record)
    assert section is not None
    assert len(section.paragraphs) == 2
    assert [table.caption[:8] for table in section.tables] == ["Held-out", "Held-out", "Scatter "]
    text = "\n".join([*section.paragraphs, *section.notices, *(table.caption for table in section.tables)])
    assert not {"aim", "aims", "goal", "goals", "reached", "at most"} & set(text.replace(",", " ").split())

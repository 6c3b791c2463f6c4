"""The page of a trial that an earlier version saved, with its verdicts about goals of the project's own."""

from __future__ import annotations

from typing import Any

from places import REPORTS
from recorded import record_from

from oed.records.record import load_record
from oed.report.answer import answer_of
from oed.report.sections.physics import physics


def older() -> dict[str, Any]:
    """As saved before it was said what a model has at best."""
    data = load_record(REPORTS / "physics_skid_steer").data
    for floor in data["physics"]["floors"]:
        floor["attainable"] = []
        for one in floor["errors"]:
            one.update(excess=None, excess_each=None)
    return data


def test_the_page_judges_nothing_by_goals_that_the_user_never_set():
    data = older()
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


def test_the_answer_says_what_slip_leaves_and_what_the_drive_adds():
    data = older()
    floor = data["physics"]["floors"][0]
    own = data["physics"]["models"][0]["name"]
    before = answer_of(record_from(data))
    assert before is not None
    # Records of earlier versions do not know.
    assert not any("simulated physics" in one for one in before.sentences)
    floor["attainable"] = [{"fit": own, "value": 0.0151, "low": 0.01, "high": 0.02, "each": []}]
    sizes = {"optimal for differential drive": 0.00123, "circle": 0.03, "random": 0.0021}
    for one in floor["errors"]:
        if one["fit"] == own and one["drive"] in sizes:
            one["excess"] = {"value": sizes[one["drive"]], "low": 0.0, "high": 0.1}
    after = answer_of(record_from(data))
    assert after is not None
    (said,) = [one for one in after.sentences if "simulated physics" in one]
    assert "(friction 0.5)" in said
    assert "at best 15 mm off" in said
    assert "from this drive, 1.2 mm more, from the best baseline (random) 2.1 mm more." in said

"""The report's certificate: the bound, its gap, what it rests on, and what splines cost."""

from __future__ import annotations

from typing import Any

from recorded import record_from

from oed.report.sections.searches import certificate

OTHER = {"upper_bound": 93.3, "method": "another way", "assumptions": ["the room is left out"]}
FOUND: dict[str, Any] = {
    "upper_bound": 86.7018,
    "gap": 2.1e-5,
    "method": "a way",
    "assumptions": ["one thing", "another"],
    "multiplier": [[0.5, 0.0], [0.0, 0.5]],
    "loose": False,
    "complete": True,
    "best": 86.7,
    "drive": "lattice",
    "spline_objective": 83.3,
    "caps": [{"upper_bound": 86.7018, "method": "a way", "assumptions": []}, OTHER],
    "wall_seconds": 1.0,
}


def section_of(**changes: Any) -> Any:
    return certificate(record_from({"results": [], "certificate": {**FOUND, **changes}}))


def test_without_a_certificate_there_is_no_section():
    assert certificate(record_from({"results": [], "certificate": None})) is None
    assert certificate(record_from({"results": []})) is None


def test_bound_gap_and_assumptions_are_said():
    text = " ".join(section_of().paragraphs)
    for words in ("86.7018", "a way", "one thing; another", "within 0.0021 %", "3.9 % less", "Z of"):
        assert words in text
    assert section_of().notices == ()


def test_a_loose_bound_says_so():
    (notice,) = section_of(loose=True).notices
    assert "loose" in notice


def test_a_search_that_was_ended_is_said():
    assert any("time limit" in text for text in section_of(complete=False).paragraphs)
    assert not any("time limit" in text for text in section_of().paragraphs)


def test_all_bounds_are_listed():
    (table,) = section_of().tables
    assert [row[1] for row in table.rows] == ["a way", "another way"]
    assert section_of(caps=FOUND["caps"][:1]).tables == ()


def test_a_certificate_with_the_agreed_keys_alone_is_enough():
    plain = {key: FOUND[key] for key in ("upper_bound", "gap", "method", "assumptions")}
    section = certificate(record_from({"results": [], "certificate": plain}))
    assert section is not None
    assert "86.7018" in section.paragraphs[1]
    assert section.brief == (1, 0)
    assert certificate(record_from({"results": [], "certificate": {**plain, "gap": None}})) is not None


def test_percent():
    assert "within 0.001 %" in " ".join(section_of(gap=1e-9).paragraphs)
    assert "within 21 %" in " ".join(section_of(gap=0.21).paragraphs)

"""YAML that remembers its places."""

from __future__ import annotations

from pathlib import Path

import pytest

from oed.errors import StudyError
from oed.yaml_source import parse_yaml, read_yaml

TEXT = """\
# a remark
first: 1

second:
  inner: {deep: 2, other: 3}
  list:
    - a
    - {key: b}
    - [c, d]
"""


@pytest.mark.parametrize(
    ("path", "place"),
    [
        ((), ((), 2, 1)),
        (("first",), (("first",), 2, 1)),
        (("second",), (("second",), 4, 1)),
        (("second", "inner"), (("second", "inner"), 5, 3)),
        (("second", "inner", "deep"), (("second", "inner", "deep"), 5, 11)),
        (("second", "inner", "other"), (("second", "inner", "other"), 5, 20)),
        (("second", "list", 0), (("second", "list", 0), 7, 7)),
        (("second", "list", 1, "key"), (("second", "list", 1, "key"), 8, 8)),
        (("second", "list", 2, 1), (("second", "list", 2, 1), 9, 11)),
    ],
    ids=str,
)
def test_places_of_keys(path, place):
    assert parse_yaml(TEXT, "file").place(path) == place


@pytest.mark.parametrize(
    ("path", "found", "line"),
    [
        (("second", "label of a union", "inner"), ("second", "inner"), 5),
        (("second", "missing"), ("second",), 4),
        (("second", "list", 7), ("second", "list"), 6),
        (("first", "deeper"), ("first",), 2),
        (("nowhere",), (), 2),
    ],
    ids=str,
)
def test_what_is_not_in_the_file_is_passed_over(path, found, line: int):
    assert parse_yaml(TEXT, "file").place(path)[:2] == (found, line)


def test_flaws_name_file_line_and_key():
    source = parse_yaml(TEXT, "some.yaml")
    assert str(source.flaw(("second", "list", 1, "key"), "is wrong")) == (
        "some.yaml:8: second.list.1.key: is wrong"
    )
    assert str(source.flaw(("second",), "missing", missing="third")) == "some.yaml:4: second.third: missing"
    assert str(source.flaw((), "is wrong")) == "some.yaml:2: is wrong"


def test_plain_data_and_text_are_kept():
    source = parse_yaml(TEXT, "file")
    assert source.data == {
        "first": 1,
        "second": {"inner": {"deep": 2, "other": 3}, "list": ["a", {"key": "b"}, ["c", "d"]]},
    }
    assert (source.file, source.text) == ("file", TEXT)


def test_an_empty_text_has_a_place():
    source = parse_yaml("", "file")
    assert source.data is None
    assert source.place(("key",)) == ((), 1, 1)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("a: 1\n\tb: 2\n", 2, "not valid YAML"),
        ("a: [1, 2\nb: 3\n", 2, "not valid YAML"),
        ("a: 1\n b: 2\n", 2, "not valid YAML"),
        ("a: 1\n---\na: 2\n", 2, "not valid YAML"),
        ("a: !!python/object:os.system {}\n", 1, "not valid YAML"),
        ("a: *nobody\n", 1, "not valid YAML"),
        ("a: 1\nb: 2\na: 3\n", 3, "given twice (first in line 1)"),
    ],
)
def test_mistakes_are_named_by_line(text: str, line: int, message: str):
    with pytest.raises(StudyError) as caught:
        parse_yaml(text, "some.yaml")
    (flaw,) = caught.value.flaws
    assert (flaw.file, flaw.line) == ("some.yaml", line)
    assert message in flaw.message


def test_every_repeated_key_is_named():
    text = "a: 1\na: 2\nlist:\n- {b: 1, b: 2}\n- c:\n    d: 1\n    d: 2\n    d: 3\n"
    with pytest.raises(StudyError) as caught:
        parse_yaml(text, "file")
    assert [(flaw.line, flaw.key) for flaw in caught.value.flaws] == [
        (2, "a"),
        (4, "list.0.b"),
        (7, "list.1.c.d"),
        (8, "list.1.c.d"),
    ]


def test_control_characters_are_not_yaml():
    with pytest.raises(StudyError, match="not valid YAML"):
        parse_yaml("a: \x00\n", "file")


class TestFiles:
    def test_a_file(self, tmp_path: Path):
        file = tmp_path / "some.yaml"
        file.write_text(TEXT, encoding="utf-8")
        assert read_yaml(file).data == parse_yaml(TEXT, "").data
        assert read_yaml(file).file == str(file)

    @pytest.mark.parametrize("name", ["nowhere.yaml", "nowhere/at/all.yaml"])
    def test_no_file(self, tmp_path: Path, name: str):
        with pytest.raises(StudyError, match="no such file"):
            read_yaml(tmp_path / name)

    def test_a_folder(self, tmp_path: Path):
        with pytest.raises(StudyError, match="expected a file, got a folder"):
            read_yaml(tmp_path)

    def test_no_text(self, tmp_path: Path):
        file = tmp_path / "some.yaml"
        file.write_bytes(b"name: \xff\xfe")
        with pytest.raises(StudyError, match="cannot be read"):
            read_yaml(file)

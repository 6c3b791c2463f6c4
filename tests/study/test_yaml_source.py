"""YAML that remembers its places."""

from __future__ import annotations

import os
import random
from itertools import pairwise
from pathlib import Path

import pytest

from oed.foundation.errors import FileIssue, StudyError
from oed.study.yaml_source import CHARACTERS, DEPTH, NODES, parse_yaml, read_yaml

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


FORMS = """\
same: 30
next:
    30
after_a_blank_line:

    30
after_a_remark:  # in m
    # of the wheels
    30
single_quoted:
    'a
    b'
double_quoted:
    "a
    b"
plain_lines:
    a
    b
anchored: &size
    30
tagged: !!float
    30
both: &both !!float  # in m

    30
alias: *size
literal: |
    a
folded:
    >
    a
nothing:
a_list:
    - 1
    -
      2
    - [3,
       4, {key:
       5}]
    - deeper:
        6
flow: {a: 1,
    b: 2, c:
    3}
? asked
:
    30
"a key":
    30
keys:
    here: 1
"""


PLACES = {
    ("same",): (1, 1),
    ("next",): (3, 5),
    ("after_a_blank_line",): (6, 5),
    ("after_a_remark",): (9, 5),
    ("single_quoted",): (11, 5),
    ("double_quoted",): (14, 5),
    ("plain_lines",): (17, 5),
    ("anchored",): (20, 5),
    ("tagged",): (22, 5),
    ("both",): (25, 5),
    ("alias",): (26, 1),
    ("literal",): (27, 1),
    ("folded",): (30, 5),
    ("nothing",): (32, 1),
    ("a_list",): (33, 1),
    ("a_list", 0): (34, 7),
    ("a_list", 1): (36, 7),
    ("a_list", 2, 0): (37, 8),
    ("a_list", 2, 1): (38, 8),
    ("a_list", 2, 2, "key"): (39, 8),
    ("a_list", 3, "deeper"): (41, 9),
    ("flow", "a"): (42, 8),
    ("flow", "b"): (43, 5),
    ("flow", "c"): (44, 5),
    ("asked",): (47, 5),
    ("a key",): (49, 5),
    ("keys",): (50, 1),
}
"""Lines and columns of values, by their paths."""


def test_a_value_in_a_line_after_its_key_has_its_own_place():
    source = parse_yaml(FORMS, "file")
    assert {path: source.place(path) for path in PLACES} == {path: (path, *PLACES[path]) for path in PLACES}
    # Windows' line ends, and a byte-order mark.
    crlf = parse_yaml("\ufeff" + FORMS.replace("\n", "\r\n"), "file")
    assert {path: crlf.place(path)[1] for path in PLACES} == {path: PLACES[path][0] for path in PLACES}


def test_a_key_that_is_wrong_itself_keeps_its_place():
    source = parse_yaml(FORMS, "file")
    assert source.place(("next",), of_key=True) == (("next",), 2, 1)
    assert source.issue(("next",), "unknown key", of_key=True).line == 2


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


def test_issues_name_file_line_and_key():
    source = parse_yaml(TEXT, "some.yaml")
    assert str(source.issue(("second", "list", 1, "key"), "is wrong")) == (
        "some.yaml:8: second.list.1.key: is wrong"
    )
    assert str(source.issue(("second",), "missing", missing="third")) == "some.yaml:4: second.third: missing"
    assert str(source.issue((), "is wrong")) == "some.yaml:2: is wrong"


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
        ("a: 1\nb:\n\tc: 2\n", 3, "indent with blanks, not with tabs"),
        ("a: 1\nb:2\nc: 3\n", 2, "expected `key: value`, a colon and a blank after each key"),
        ("a: 1\nb = 2\nc: 3\n", 2, "expected `key: value`, a colon and a blank after each key"),
        ("a: 1\nhello\n", 2, "expected `key: value`, a colon and a blank after each key"),
        ("a: 1\nb: @c\n", 2, "put text in quotes"),
        ("a: 1\nb: *\n", 2, "put text in quotes"),
        ("a: 1\nb: c: d\n", 2, "put text with a colon in quotes"),
        ("a: 1\nyes: 2\n", 2, "expected a name as a key, got 'yes', which is none in YAML"),
        ("a: 1\nb:\n  ~: 2\n", 3, "expected a name as a key, got '~', which is none in YAML"),
        ("a: 1\n---\na: 2\n", 2, "expected a single document in the stream, but found another"),
        ("a: 1\nb: {c: 1,\n  d: 2\ne: 3\n", 4, "(while parsing a flow mapping that begins in line 2)"),
        ("a: 1\nb: 2\na: 3\n", 3, "given twice (first in line 1)"),
    ],
)
def test_mistakes_are_named_by_line(text: str, line: int, message: str):
    with pytest.raises(StudyError) as caught:
        parse_yaml(text, "some.yaml")
    (issue,) = caught.value.issues
    assert (issue.file, issue.line) == ("some.yaml", line)
    assert message in issue.message


def test_every_repeated_key_is_named():
    text = "a: 1\na: 2\nlist:\n- {b: 1, b: 2}\n- c:\n    d: 1\n    d: 2\n    d: 3\n"
    with pytest.raises(StudyError) as caught:
        parse_yaml(text, "file")
    assert [(issue.line, issue.key) for issue in caught.value.issues] == [
        (2, "a"),
        (4, "list.0.b"),
        (7, "list.1.c.d"),
        (8, "list.1.c.d"),
    ]


@pytest.mark.parametrize(
    "number",
    [
        "1:30",
        "190:20:30.15",
        "010",
        "-010",
        "0x10",
        "0b11",
        "1_000",
        "1_0.5",
        "+1_0",
        "!!int 010",
        "!!float 1:30.5",
    ],
)
@pytest.mark.parametrize(
    ("text", "line", "key"),
    [("a: 1\nrobot: {track: NUMBER}\n", 2, "robot.track"), ("b:\n- 1\n- [0, NUMBER]\n", 3, "b.1.1")],
)
def test_numbers_that_are_not_what_they_look_like_are_refused(number: str, text: str, line: int, key: str):
    issue = issue_of(text.replace("NUMBER", number))
    assert (issue.line, issue.key) == (line, key)
    assert issue.message.startswith(f"expected a decimal number, got {number.split()[-1]!r}; ")


def test_such_numbers_are_no_keys_either():
    assert "expected a decimal number, got '010'" in issue_of("limits:\n  010: 1\n").message


def test_numbers_that_are_what_they_look_like_stay():
    text = "a: [0, -0, 10, +5, 1.5, 010.5, .5, 5., 1.0e+3, 1e3, '010', '1:30', 1:30 min, 09, 10 m]"
    found = [0, 0, 10, 5, 1.5, 10.5, 0.5, 5.0, 1000.0, "1e3", "010", "1:30", "1:30 min", "09", "10 m"]
    assert parse_yaml(text, "file").data == {"a": found}


def test_control_characters_are_not_yaml():
    with pytest.raises(StudyError, match="not valid YAML"):
        parse_yaml("a: \x00\n", "file")


def issue_of(text: str) -> FileIssue:
    with pytest.raises(StudyError) as caught:
        parse_yaml(text, "some.yaml")
    (issue,) = caught.value.issues
    assert "\n" not in str(issue)
    assert len(str(issue)) < 200
    return issue


def nested(anchors: str, times: int = 9) -> str:
    """Every anchor a list of the one before, many times."""
    lines = [f"{anchors[0]}: &{anchors[0]} [{', '.join('x' * times)}]"]
    for before, name in pairwise(anchors):
        lines.append(f"{name}: &{name} [{', '.join([f'*{before}'] * times)}]")
    return "\n".join(lines)


BOMB = nested("abcdefghij")


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("b: 1\na: &a [1, *a]", 2, "*a contains itself"),
        ("b: 1\na: &a {b: {c: *a}}", 2, "*a contains itself"),
        ("&a {*a : 1}", 1, "*a contains itself"),
        ("a: &a {<<: *a}", 1, "*a contains itself"),
        (BOMB, 6, f"more than {NODES} keys and values"),
        (BOMB.replace("[*a", "[{<<: *i}, *a"), 2, "not valid YAML: found undefined alias 'i'"),
        ("a: 1\nb: " + "[" * 100_000, 2, f"nested more than {DEPTH} levels deep"),
        ("a: " + "{a: " * 100_000, 1, f"nested more than {DEPTH} levels deep"),
        ("- " * 100_000, 1, f"nested more than {DEPTH} levels deep"),
        (
            "".join(" " * level + "a:\n" for level in range(99)),
            DEPTH,
            f"nested more than {DEPTH} levels deep",
        ),
        (
            "a: &a " + "[" * 30 + "]" * 30 + "\nb: &b " + "[" * 30 + "*a" + "]" * 30,
            2,
            f"nested more than {DEPTH} levels deep",
        ),
        ("a: 1\n? [b, c]\n: 2", 2, "expected a name as a key, got a list"),
        ("a: 1\n{b: c}: 2", 2, "expected a name as a key, got a list"),
        ("a: &a [b]\n*a : 2", 1, "expected a name as a key, got a list"),
        ("a:\n  b: !!int soon", 2, "expected a whole number, got 'soon'"),
        ("a: !!float soon", 1, "expected a number, got 'soon'"),
        ("a: !!bool soon", 1, "expected true or false, got 'soon'"),
        ("a: !!timestamp soon", 1, "expected a date, got 'soon'"),
        ("a: !!int", 1, "expected a whole number, got ''"),
        ("a: 1\nb: 2024-13-45", 2, "expected a date, got '2024-13-45'; put text in quotes"),
        ("a: 2023-02-29 25:00:00", 1, "expected a date, got '2023-02-29 25:00:00'"),
        ("a: 1\nb: " + "9" * 5000, 2, "expected a number of at most 100 characters, got 5000"),
        ("a: 0x" + "f" * 5000, 1, "expected a number of at most 100 characters, got 5002"),
        ("a: -0b" + "1" * 500, 1, "expected a number of at most 100 characters, got 503"),
        ("a: " + "1:" * 500 + "1.5", 1, "expected a number of at most 100 characters, got 1003"),
        ("a: !!int " + "9" * 5000, 1, "expected a number of at most 100 characters, got 5000"),
        ('a: 1\nb: "\\U99999999"', 2, "an escape or a version number out of range"),
        ("%YAML 1." + "9" * 5000 + "\n--- {}", 1, "an escape or a version number out of range"),
        ('a: "\\uD800"', 1, r"the character '\ud800' cannot stand in a study"),
        ('a: 1\n"\\e[2J": 2', 2, r"the character '\x1b' cannot stand in a study"),
        ('a: "b\\0"', 1, r"the character '\x00' cannot stand in a study"),
        ("a: 1\nb: \a", 2, r"not valid YAML: the character '\x07' cannot stand in it"),
        ("a: !!set [b]", 1, "not valid YAML: expected a mapping node"),
        ("a: !mine b", 1, "not valid YAML: could not determine a constructor"),
        ("x" * (CHARACTERS + 1), 0, f"longer than {CHARACTERS} characters"),
    ],
    ids=lambda value: value[:20] if isinstance(value, str) else None,
)
@pytest.mark.slow
def test_what_no_study_is_made_of_is_named_by_line(text: str, line: int, message: str):
    issue = issue_of(text)
    assert issue.line == line
    assert issue.message.startswith(message)


def test_what_is_written_out_counts_as_well(monkeypatch):
    monkeypatch.setattr("oed.study.yaml_source.NODES", 100)
    issue = issue_of("a:\n" + "- 1\n" * 1000)
    assert (issue.line, issue.message[:14]) == (99, "more than 100 ")


def test_aliases_of_bounded_size_are_read():
    source = parse_yaml("a: &a {x: 1, y: [2, 3]}\nb: {<<: *a, x: 4}\nc: [*a, *a]\n", "file")
    assert source.data["b"] == {"x": 4, "y": [2, 3]}
    assert source.data["c"] == [{"x": 1, "y": [2, 3]}] * 2
    # The key that counts, not the one it overrides; and what is merged stands where it was written.
    assert source.place(("b", "x")) == (("b", "x"), 2, 13)
    assert source.place(("b", "y")) == (("b", "y"), 1, 14)
    assert parse_yaml(nested("abcd"), "file").data["d"][8][8][8] == list("xxxxxxxxx")


def test_as_much_as_a_study_may_hold_is_read():
    assert parse_yaml("[" * (DEPTH - 1) + "1" + "]" * (DEPTH - 1), "file").data
    assert parse_yaml("9" * 100, "file").data == int("9" * 100)


FRAGMENTS = (
    "&a ", "*a ", "!!int ", "!!float ", "!!bool ", "!!timestamp ", "!!binary ", "!!set ", "!!omap ",
    "!!pairs ", "!!null ", "!!str ", "!!map ", "!!seq ", "!x ", "!<!foo> ", "%YAML 1.1\n---\n", "%TAG ! a",
    "[", "]", "{", "}", "? ", ": ", "- ", "|", "> ", "|9", '"', "'", "\\U99999999", "\\uD800", '"\\xZZ"',
    "2024-13-45", "1:99:3", ".inf", ".nan", "0x", "0b", "0o9", "08", "1_", "_", "~", "<<: *a", "<<: [*a, 3]",
    "=", "\t", "\x85", "\u2028", "\ufeff", "\a", "1e999", "9" * 200, "---", "...", "#", "@", "`", "%FF",
    "!%FF", "\n", "\n  ", "\n    ", "null: 1", "[a]: 1", "{a: 1}: 2", "a", "b: ", "1", ", ",
)  # fmt: skip


def issues_in(text: str) -> tuple[FileIssue, ...]:
    try:
        parse_yaml(text, "file")
    except StudyError as error:
        return error.issues
    return ()


@pytest.mark.slow
def test_any_text_is_data_or_issues():
    draw = random.Random(0)
    for trial in range(500):
        text = TEXT if trial % 2 else ""
        for _ in range(draw.randint(1, 10)):
            place = draw.randint(0, len(text))
            text = text[:place] + draw.choice(FRAGMENTS) + text[place:]
        issues = issues_in(text)
        assert all(issue.line > 0 and "\n" not in str(issue) for issue in issues), text


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

    @pytest.mark.parametrize("name", ["a\0b", "x" * 5000])
    def test_what_is_no_name_of_a_file(self, name: str):
        with pytest.raises(StudyError, match="cannot be read"):
            read_yaml(name)

    def test_a_file_without_end(self):
        with pytest.raises(StudyError, match="cannot be read: expected a file, got a device"):
            read_yaml("/dev/zero")

    def test_a_file_that_is_no_study(self, tmp_path: Path):
        file = tmp_path / "long.yaml"
        file.write_text("x" * (CHARACTERS + 1))
        with pytest.raises(StudyError, match="longer than"):
            read_yaml(file)
        os.truncate(file, 10**11)
        with pytest.raises(StudyError, match=r"expected at most 16 MB, got 1e\+05 MB"):
            read_yaml(file)

    def test_no_text(self, tmp_path: Path):
        file = tmp_path / "some.yaml"
        file.write_bytes(b"name: \xff\xfe")
        with pytest.raises(StudyError, match="cannot be read"):
            read_yaml(file)

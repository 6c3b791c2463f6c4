"""What a study is read from: plain data, and where each of its keys stands, so that an error can name it."""

from __future__ import annotations

import os
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from oed.foundation.errors import FileIssue, StudyError
from oed.foundation.files import text_of

KeyPath = tuple[str | int, ...]

CHARACTERS = 4_000_000
"""Length beyond which a text is no study."""
NODES = 100_000
"""Keys and values beyond which a text is no study, those that stand behind aliases counted each time."""
DEPTH = 50
"""Levels of nesting beyond which a text is no study, those behind aliases counted too."""
NUMBER = 100
"""Length beyond which a text is no number."""
_FORBIDDEN = re.compile(r"[^\t\n\x20-\x7e\xa0-\u2027\u202a-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What no text of a study has: control characters, which a terminal obeys, and halves of characters."""
_NO_DECIMALS = re.compile(r"[-+]?0[0-9]|.*[_:]|[-+]?0[bx]")
"""How numbers begin, as YAML has them, that are not what they look like: 010 is 8, 1:30 is 90."""
_PROPERTIES = re.compile(r"(?:[&!]\S*\s+|#.*\s+)+")
"""What may stand before a value: its anchor, its tag, and remarks after those."""
_KINDS = {"int": "a whole number", "float": "a number", "bool": "true or false", "timestamp": "a date"}
NO_KEY = "could not find expected ':'"
"""What PyYAML says of the line after one that has no key, or no blank after its colon."""
ADVICE = {
    "'\\t'": "indent with blanks, not with tabs",
    "cannot start any token": "put text in quotes",
    "expected alphabetic or numeric character": "put text in quotes",
    "mapping values are not allowed here": "put text with a colon in quotes, and close what brackets open",
}
"""What to do about some of what PyYAML says."""
FILES_SHOWN = 5
"""Studies of a folder that are named."""
_SHOWN = 60
"""Letters of a wrong value that are shown."""


@dataclass(frozen=True)
class Source(ABC):
    """What a study is read from.

    Attributes:
        file: its name, for errors.
        text: as it is written.
        data: what that says, plain.
    """

    file: str
    text: str
    data: Any

    @abstractmethod
    def place(self, path: Sequence[str | int], *, of_key: bool = False) -> tuple[KeyPath, int, int]:
        """(key path, line, column) of a path: of the key itself, or of the nearest parent.

        Parts of `path` that are no keys of the data (a union's labels) are passed over. Lines and columns
        count from 1; 0 where there are none.

        Args:
            path: of the key.
            of_key: whether the key itself is meant, even where its value, a text or number, begins in a line
                after it.
        """

    def issue(
        self, path: Sequence[str | int], message: str, missing: str = "", *, of_key: bool = False
    ) -> FileIssue:
        """An issue at `path`; `missing` is the name of a key that should stand there.

        Args:
            path: of the key.
            message: what is wrong.
            missing: name of a key that should stand there.
            of_key: whether it is the key that is wrong, not its value.
        """
        found, line, column = self.place(path, of_key=of_key)
        parts = [*found, missing] if missing else list(found)
        return FileIssue(self.file, line, column, ".".join(map(str, parts)), message)


@dataclass(frozen=True)
class PlainSource(Source):
    """Data that is part of something else: its keys have no lines of their own."""

    def place(self, path: Sequence[str | int], *, of_key: bool = False) -> tuple[KeyPath, int, int]:
        """The keys that there are."""
        value, found = self.data, list[str | int]()
        for part in path:
            if _has(value, part):
                value = value[part]
                found.append(part)
        return tuple(found), 0, 0


def plain_source(file: str, text: str, data: Any) -> PlainSource:
    """Data that is part of something else, as the source of a study.

    Args:
        file: name of the file, for errors.
        text: that the study was written as.
        data: what it says, plain.

    Raises:
        StudyError: texts with characters that no study has.
    """
    source = PlainSource(file, text, data)
    found = ((path, _character_issue(one)) for path, one in _texts(data, ()))
    issues = [source.issue(path, reason) for path, reason in found if reason]
    if issues:
        raise StudyError(issues)
    return source


def _texts(value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, str]]:
    # Keys are texts as well.
    if isinstance(value, str):
        yield path, value
    elif isinstance(value, Mapping):
        for key, one in value.items():
            yield path, key
            yield from _texts(one, (*path, key))
    elif isinstance(value, list):
        for place, one in enumerate(value):
            yield from _texts(one, (*path, place))


def _has(value: Any, part: str | int) -> bool:
    if isinstance(value, list):
        return isinstance(part, int) and part < len(value)
    return isinstance(value, Mapping) and part in value


@dataclass(frozen=True)
class YamlSource(Source):
    """A parsed YAML file; its nodes know their places."""

    root: yaml.Node | None

    def place(self, path: Sequence[str | int], *, of_key: bool = False) -> tuple[KeyPath, int, int]:
        """The key's own place; that of the last one where a key is given twice, as YAML has it."""
        node, found = self.root, []
        mark = node.start_mark if node is not None else None
        for part in path:
            step = _child(node, part)
            if step is not None:
                mark, node = step
                found.append(part)
        line, column = (mark.line, mark.column) if mark is not None else (0, 0)
        if isinstance(node, yaml.ScalarNode) and not of_key:
            # A value that an alias stands for begins before its key.
            line, column = max((line, column), self._own_place(node), key=lambda place: place[0])
        return tuple(found), line + 1, column + 1

    def _own_place(self, node: yaml.ScalarNode) -> tuple[int, int]:
        # Behind anchors, tags and remarks.
        begin = node.start_mark.index
        before = _PROPERTIES.match(self.text, begin)
        lines = self.text[begin : before.end() if before else begin].split("\n")
        column = node.start_mark.column if len(lines) == 1 else 0
        return node.start_mark.line + len(lines) - 1, column + len(lines[-1])


def _child(node: yaml.Node | None, part: str | int) -> tuple[yaml.Mark, yaml.Node] | None:
    if isinstance(node, yaml.MappingNode):
        # Last come the mapping's own keys, which override those merged into it.
        for key, value in reversed(node.value):
            if key.value == str(part):
                return key.start_mark, value
    if isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
        return node.value[part].start_mark, node.value[part]
    return None


class _Refused(yaml.MarkedYAMLError):
    """Valid YAML that no study is made of."""

    def __init__(self, problem: str, mark: Any) -> None:
        """What is wrong, and where."""
        super().__init__(problem=problem, problem_mark=mark)


class _Loader(yaml.SafeLoader):
    """Plain data of bounded depth and size without cycles; whatever is wrong is a `MarkedYAMLError`."""

    def __init__(self, text: str) -> None:
        """Nothing is composed yet."""
        super().__init__(text)
        self._composed: dict[yaml.Node, tuple[int, int]] = {}
        self._nodes = self._depth = self._deepest = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """The next node; how many nodes and levels it stands for is kept for its aliases."""
        event: yaml.Event = self.peek_event()  # type: ignore[no-untyped-call]
        nodes, deepest = self._nodes, self._deepest
        self._depth += 1
        self._deepest = self._depth
        if isinstance(event, yaml.AliasEvent):
            node = super().compose_node(parent, index)
            self._repeat(node, event)
        else:
            self._nodes += 1
            self._require_bounded(event)
            node = super().compose_node(parent, index)
            assert node is not None
            self._composed[node] = self._nodes - nodes, self._deepest - self._depth
        self._deepest = max(deepest, self._deepest)
        self._depth -= 1
        return node

    def _repeat(self, node: yaml.Node | None, event: yaml.AliasEvent) -> None:
        # An alias counts as all that it stands for.
        if node not in self._composed:
            raise _Refused(f"*{event.anchor} contains itself", event.start_mark)
        nodes, levels = self._composed[node]
        self._nodes += nodes
        self._deepest = self._depth + levels
        self._require_bounded(event)

    def _require_bounded(self, event: yaml.Event) -> None:
        text = ""
        if self._deepest > DEPTH:
            text = f"nested more than {DEPTH} levels deep"
        elif self._nodes > NODES:
            text = f"more than {NODES} keys and values, those behind aliases counted each time"
        if text:
            raise _Refused(text, event.start_mark)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """What a node stands for; its text checked before."""
        text = _text_issue(node) if isinstance(node, yaml.ScalarNode) else ""
        if text:
            raise _Refused(text, node.start_mark)
        try:
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            kind = _KINDS.get(_kind(node), f"what !!{_kind(node)} is")
            text = f"expected {kind}, got {_shown(node.value)}; put text in quotes"
            raise _Refused(text, node.start_mark) from None


def _kind(node: yaml.Node) -> str:
    return str(node.tag).removeprefix("tag:yaml.org,2002:")


def _text_issue(node: yaml.ScalarNode) -> str:
    if _kind(node) in ("int", "float") and len(node.value) > NUMBER:
        return f"expected a number of at most {NUMBER} characters, got {len(node.value)}"
    return _character_issue(node.value)


def _character_issue(text: str) -> str:
    found = _FORBIDDEN.search(text)
    return "" if found is None else f"the character {found.group()!a} cannot stand in a study"


def _is_odd_number(node: yaml.ScalarNode) -> bool:
    kind = _kind(node)
    if len(node.value) > NUMBER:
        # Refused for that.
        return False
    # "010.5" is what it looks like.
    whole = kind == "int" and _NO_DECIMALS.match(node.value) is not None
    return whole or (kind == "float" and any(mark in node.value for mark in "_:"))


def _shown(value: object) -> str:
    text = ascii(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def read_yaml(file: str | Path) -> YamlSource:
    """Read a YAML file.

    Raises:
        StudyError: no such file, not text, not YAML, a key given twice, or out of all bounds.
    """
    if os.path.isdir(file):
        inside = ", ".join(sorted(one.name for one in Path(file).glob("*.yaml"))[:FILES_SHOWN])
        hint = f"; studies in it: {inside}" if inside else "; `oed init` makes a study"
        raise StudyError.about(file, f"expected a file, got a folder{hint}")
    # No character has more than four bytes.
    return parse_yaml(text_of(file, StudyError, most=4 * CHARACTERS), str(file))


def parse_yaml(text: str, name: str) -> YamlSource:
    """Parse YAML text; `name` stands for the file in errors.

    Raises:
        StudyError: not YAML, a key given twice, or out of all bounds.
    """
    if len(text) > CHARACTERS:
        raise StudyError.about(name, f"longer than {CHARACTERS} characters: no study")
    try:
        root, issues, data = _parsed(text, name)
    except yaml.MarkedYAMLError as error:
        said, mark = str(error.problem), error.problem_mark
        if not isinstance(error, _Refused):
            said, mark = _yaml_issue(error)
            said = f"not valid YAML: {said}"
        line, column = (mark.line + 1, mark.column + 1) if mark else (0, 0)
        raise StudyError([FileIssue(name, line, column, "", said)]) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        reason = f"not valid YAML: the character {text[error.position]!a} cannot stand in it"
        raise StudyError([FileIssue(name, line, 0, "", reason)]) from None
    if issues:
        raise StudyError(issues)
    return YamlSource(name, text, data, root)


def _yaml_issue(error: yaml.MarkedYAMLError) -> tuple[str, yaml.Mark | None]:
    # PyYAML's words, with what to do, and where: what is wrong, or where that begins.
    problem, begun, met = str(error.problem), error.context_mark, error.problem_mark
    if problem == NO_KEY:
        return "expected `key: value`, a colon and a blank after each key", begun
    advice = next((what for said, what in ADVICE.items() if said in problem), "")
    if advice:
        return f"{problem}; {advice}", met
    if problem.startswith("but "):
        return f"{error.context}, {problem}", met
    if begun is None or met is None or begun.line == met.line:
        return problem, met
    return f"{problem} ({error.context} that begins in line {begun.line + 1})", met


def _parsed(text: str, name: str) -> tuple[yaml.Node | None, list[FileIssue], Any]:
    # Read once: nodes, which know their lines, and what they stand for.
    loader = _Loader(text)
    try:
        root = loader.get_single_node()
        issues = list(_key_issues(root, name, ()))
        return root, issues, None if root is None or issues else loader.construct_document(root)
    except (OverflowError, ValueError):
        # Of the scanner, which says no more.
        raise _Refused("an escape or a version number out of range", loader.get_mark()) from None


def _key_reason(key: yaml.Node, seen: Mapping[str, int]) -> str:
    if not isinstance(key, yaml.ScalarNode):
        return "expected a name as a key, got a list or keys and values"
    if _kind(key) in ("bool", "null"):
        return f"expected a name as a key, got {_shown(key.value)}, which is none in YAML; put it in quotes"
    return f"given twice (first in line {seen[key.value]})" if key.value in seen else ""


def _key_issues(node: yaml.Node | None, name: str, path: KeyPath) -> Iterator[FileIssue]:
    # Keys that are no plain text, and those given twice; numbers that are not what they look like.
    if isinstance(node, yaml.ScalarNode) and _is_odd_number(node):
        text = f"expected a decimal number, got {_shown(node.value)}; write it out, or put text in quotes"
        yield FileIssue(
            name, node.start_mark.line + 1, node.start_mark.column + 1, ".".join(map(str, path)), text
        )
    if isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            yield from _key_issues(item, name, (*path, index))
    if isinstance(node, yaml.MappingNode):
        seen: dict[str, int] = {}
        for key, value in node.value:
            plain = isinstance(key, yaml.ScalarNode)
            here = (*path, str(key.value)) if plain else path
            text, line = _key_reason(key, seen), key.start_mark.line + 1
            if text:
                yield FileIssue(name, line, key.start_mark.column + 1, ".".join(map(str, here)), text)
            if plain:
                seen.setdefault(key.value, line)
                yield from _key_issues(key, name, here)
            yield from _key_issues(value, name, here)

"""YAML whose every value remembers where it stands, so that an error can name the line."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from oed.errors import FileFlaw, StudyError

KeyPath = tuple[str | int, ...]


@dataclass(frozen=True)
class YamlSource:
    """A parsed YAML file: its plain data, and its nodes for places."""

    file: str
    text: str
    data: Any
    root: yaml.Node | None

    def place(self, path: Sequence[str | int]) -> tuple[KeyPath, int, int]:
        """(key path, line, column) of a path, both from 1: of the key itself, or of the nearest parent.

        Parts of `path` that are no keys of the file (a union's labels) are passed over.
        """
        node, found = self.root, []
        mark = node.start_mark if node is not None else None
        for part in path:
            step = _child(node, part)
            if step is not None:
                mark, node = step
                found.append(part)
        return tuple(found), *((mark.line + 1, mark.column + 1) if mark is not None else (1, 1))

    def flaw(self, path: Sequence[str | int], message: str, missing: str = "") -> FileFlaw:
        """A flaw at `path`; `missing` is the name of a key that should stand there."""
        found, line, column = self.place(path)
        parts = [*found, missing] if missing else list(found)
        return FileFlaw(self.file, line, column, ".".join(map(str, parts)), message)


def _child(node: yaml.Node | None, part: str | int) -> tuple[yaml.Mark, yaml.Node] | None:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == str(part):
                return key.start_mark, value
    if isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
        return node.value[part].start_mark, node.value[part]
    return None


def read_yaml(file: str | Path) -> YamlSource:
    """Read a YAML file.

    Raises:
        StudyError: no such file, not text, not YAML, or a key given twice.
    """
    name = str(file)
    try:
        text = Path(file).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise StudyError([FileFlaw(name, 0, 0, "", "no such file")]) from None
    except IsADirectoryError:
        raise StudyError([FileFlaw(name, 0, 0, "", "expected a file, got a folder")]) from None
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError([FileFlaw(name, 0, 0, "", f"cannot be read: {error}")]) from None
    return parse_yaml(text, name)


def parse_yaml(text: str, name: str) -> YamlSource:
    """Parse YAML text; `name` stands for the file in errors.

    Raises:
        StudyError: not YAML, or a key given twice.
    """
    try:
        # Read once: nodes, which know their lines, and what they stand for.
        loader = yaml.SafeLoader(text)
        root = loader.get_single_node()
        flaws = _repeated_keys(root, name, ())
        data = None if root is None else loader.construct_document(root)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (0, 0)
        raise StudyError([FileFlaw(name, line, column, "", f"not valid YAML: {error.problem}")]) from None
    except yaml.YAMLError as error:
        raise StudyError([FileFlaw(name, 0, 0, "", f"not valid YAML: {error}")]) from None
    if flaws:
        raise StudyError(flaws)
    return YamlSource(name, text, data, root)


def _repeated_keys(node: yaml.Node | None, name: str, path: KeyPath) -> list[FileFlaw]:
    flaws: list[FileFlaw] = []
    if isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            flaws += _repeated_keys(item, name, (*path, index))
    if isinstance(node, yaml.MappingNode):
        seen: dict[Hashable, int] = {}
        for key, value in node.value:
            here = (*path, str(key.value))
            line = key.start_mark.line + 1
            if key.value in seen:
                text = f"given twice (first in line {seen[key.value]})"
                flaws.append(FileFlaw(name, line, key.start_mark.column + 1, ".".join(map(str, here)), text))
            seen.setdefault(key.value, line)
            flaws += _repeated_keys(value, name, here)
    return flaws

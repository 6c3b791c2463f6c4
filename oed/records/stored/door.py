"""The one way in for saved JSON, every issue named by file and key; and the way out, its text."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final, NoReturn, Self, TypeVar

from pydantic import PrivateAttr, ValidationError
from pydantic_core import ErrorDetails

from oed.foundation.arguments import DIGITS
from oed.foundation.errors import FileIssue, ProblemError, RecordError
from oed.foundation.extras import package_version
from oed.foundation.files import text_of
from oed.foundation.own.part import UNMADE
from oed.foundation.shown import written
from oed.foundation.wording import sentence
from oed.records.stored.parts import Stored
from oed.study.study import AnyStudyFile, kind_of
from oed.study.study_errors import explain
from oed.study.yaml_source import PlainSource

FORMAT: Final = 1
"""Of all files."""
STUDIES = (".yaml", ".yml")
"""What files of studies end in."""
SHOWN = 12
"""Issues of a file that are listed; what is damaged throughout is not listed line by line."""

Kind = TypeVar("Kind", bound=Stored)


class SavedFile(Stored):
    """A whole file that the package writes.

    `file` is where it was read from, None of one that was made here: what a file names is data, and code that
    it names is run only for those who trust it.
    """

    _file: Path | None = PrivateAttr(default=None)

    @property
    def file(self) -> Path | None:
        """Where it was read from, None of one that was made here."""
        return self._file

    @property
    def data(self) -> dict[str, Any]:
        """What the file holds, as plain data."""
        return self.plain()

    def at(self, file: Path) -> Self:
        """What was read from a file."""
        found = self.model_copy()
        found._file = file
        return found

    def to_json(self) -> str:
        """The text of the file, every list of numbers on a line of its own.

        Raises:
            ValueError: numbers that JSON has not.
        """
        return _laid_out(self.plain(), "") + "\n"


def read_file(path: Path, what: str, command: str, needed: str, hint: str = "") -> dict[str, Any]:
    """The JSON object in one of the files that the package writes.

    Args:
        path: the file.
        what: it holds, "a record".
        command: makes such files.
        needed: a key that every one of them has.
        hint: what else to say where there is no such file.

    Raises:
        RecordError: as `read_object` does.
    """
    name = what.split()[-1]
    study = f"expected {what}, got a study: `{command} {path}` makes one; give the folder that it writes"
    expected, again = f"expected {what} of format {FORMAT}", f"make it again with `{command}`"
    data = read_object(path, f"no {name} there; make one with `{command}`{hint}", expected, study, again)
    came = data.get("format")
    if came is None:
        raise RecordError.about(path, f"{expected}, got keys and values without `format`; {again}")
    if isinstance(came, int) and came > FORMAT:
        newer = f"{what} of format {written(came)}, which a newer oed has written"
        own = package_version("oed")
        raise RecordError.about(path, f"{newer}; this one ({own}) reads format {FORMAT}: update oed")
    if came != FORMAT:
        raise RecordError.about(path, f"{expected}, got format {written(came)}; {again}")
    if needed not in data:
        less = f"{what} of format {FORMAT} without the key `{needed}`"
        why = "the file is damaged, or was changed by hand"
        raise RecordError.about(path, f"{less}: {why}; restore it, or {again}")
    return data


def read_object(path: Path, absent: str, expected: str, study: str = "", then: str = "") -> dict[str, Any]:
    """The JSON object in a file.

    Args:
        path: the file.
        absent: what to say where there is none.
        expected: what to say of JSON that is something else.
        study: what to say of a study; by default that it is not JSON.
        then: what to do about JSON that is something else.

    Raises:
        RecordError: no such file, not text, not JSON, numbers that JSON has not, something else.
    """
    try:
        text = text_of(path, RecordError, absent=absent)
        data = json.loads(text, parse_constant=_refuse, parse_int=_whole)
    except json.JSONDecodeError as error:
        if study and path.suffix in STUDIES and not text.lstrip().startswith("{"):
            raise RecordError.about(path, study) from None
        raise RecordError(
            [FileIssue(str(path), error.lineno, error.colno, "", f"cannot be read: not JSON: {error.msg}")]
        ) from None
    except RecursionError:
        raise RecordError.about(path, "cannot be read: nested too deeply") from None
    except ValueError as error:
        raise RecordError.about(path, f"cannot be read: {str(error).partition(';')[0]}") from None
    if not isinstance(data, dict):
        came = "a list" if isinstance(data, list) else written(data)
        raise RecordError.about(path, "; ".join(filter(None, [f"{expected}, got {came}", then])))
    return data


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no number of JSON")


def _whole(text: str) -> int:
    if len(text) > DIGITS:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)


def checked(kind: type[Kind], data: Mapping[str, Any], path: Path) -> Kind:
    """Data as what it is to be.

    Args:
        kind: what it is to be.
        data: as the file has it.
        path: of the file.

    Raises:
        RecordError: names the file and the key of everything that is missing or something else.
    """
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        raise RecordError(_issues(error.errors(include_url=False), path)) from None
    except RecursionError:
        raise RecordError.about(path, "cannot be read: nested too deeply") from None


def _issues(details: list[ErrorDetails], path: Path) -> list[FileIssue]:
    issues = [FileIssue(str(path), 0, 0, ".".join(map(str, one["loc"])), sentence(one)) for one in details]
    rest = len(issues) - SHOWN
    return (
        issues
        if rest <= 0
        else [*issues[:SHOWN], FileIssue(str(path), 0, 0, "", f"and {rest} more like that")]
    )


def read_echo(data: Any, file: Path, *, designs: bool = True) -> AnyStudyFile:
    """A saved study; no robot of somebody's code is made of it.

    Args:
        data: as it was saved.
        file: that it was saved in.
        designs: whether drives were designed by it.

    Raises:
        RecordError: names the file and the study's key of every mistake.
    """
    source, kind = PlainSource(str(file), "", data), kind_of(data)
    try:
        found = kind.model_validate(data, context=UNMADE)
    except ValidationError as error:
        raise in_record(explain(error, kind, source)) from None
    except ProblemError as error:
        raise in_record([source.issue(issue.key, issue.message) for issue in error.issues]) from None
    if designs and not found.designs:
        raise in_record([source.issue((), "missing", "trajectory")])
    return found


def in_record(issues: Sequence[FileIssue]) -> RecordError:
    """Issues of a study as those of the record that holds it."""
    return RecordError(
        [FileIssue(issue.file, 0, 0, f"study.{issue.key}".rstrip("."), issue.message) for issue in issues]
    )


def _laid_out(value: Any, indent: str) -> str:
    # As json.dumps(indent=1) would, but for lists of plain values.
    inner = indent + " "
    if isinstance(value, list | tuple) and _PLAIN.issuperset(map(type, value)):
        return _ENCODER.encode(value)
    if isinstance(value, Mapping) and value and _PLAIN.issuperset(map(type, value.values())):
        # Records of thousands of readings are written by the encoder in C.
        return f"{{\n{inner}{_flat_encoder(inner).encode(value)[1:-1]}\n{indent}}}"
    if isinstance(value, Mapping) and value:
        lines = [f"{inner}{_ENCODER.encode(key)}: {_laid_out(entry, inner)}" for key, entry in value.items()]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}"
    if isinstance(value, list | tuple) and any(isinstance(entry, Mapping | list | tuple) for entry in value):
        return "[\n" + ",\n".join(f"{inner}{_laid_out(entry, inner)}" for entry in value) + f"\n{indent}]"
    return _ENCODER.encode(value)


_ENCODER = json.JSONEncoder(allow_nan=False)
_PLAIN = frozenset((float, int, str, bool, type(None)))


@cache
def _flat_encoder(indent: str) -> json.JSONEncoder:
    # Writes each entry of a mapping on a line of its own.
    return json.JSONEncoder(allow_nan=False, separators=(f",\n{indent}", ": "))

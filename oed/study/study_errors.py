"""Validation errors of a study file in words: what was expected, what came, what exists, and where."""

from __future__ import annotations

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from oed.foundation.component import Component
from oed.foundation.errors import FileIssue
from oed.foundation.wording import KIND, few_unknown, sentence, telling, untagged
from oed.study.offered import as_studies_have
from oed.study.yaml_source import Source

MOST_EXPLAINED = 200
"""Mistakes that are explained; where there are more, the file is hardly a study."""


def explain(error: ValidationError, root: type[Component], source: Source) -> list[FileIssue]:
    """One issue per place in the file, in the order of the lines.

    Where a value fits none of several forms, the reasons are joined.

    Args:
        error: of the study's classes.
        root: the class of the whole.
        source: where the keys stand.
    """
    reasons: dict[tuple[int, int, str], list[str]] = {}
    details = few_unknown(error.errors(include_url=False))
    for detail, more in details[:MOST_EXPLAINED]:
        place = _place(detail, source)
        texts = reasons.setdefault((place.line, place.column, place.key), [])
        of_robots = getattr(root, "domain", "") == "robots"
        text = sentence(detail, root, more) + (_offered(detail) if of_robots else "")
        if text not in texts:
            texts.append(text)
    # An issue deeper down says more than "none of the forms fits" about the whole.
    left = [
        _place(detail, source, f"and {len(details) - MOST_EXPLAINED} more mistakes")
        for detail, _ in details[MOST_EXPLAINED : MOST_EXPLAINED + 1]
    ]
    above = {
        ".".join(parts[:depth])
        for *_, key in reasons
        for parts in [key.split(".")]
        for depth in range(1, len(parts))
    }
    return [
        FileIssue(source.file, line, column, key, "; or ".join(telling(texts)))
        for (line, column, key), texts in sorted(reasons.items())
        if key not in above
    ] + left


def _offered(detail: ErrorDetails) -> str:
    # What a sensor's kind that studies have not is called elsewhere.
    wrong = detail["type"] == "union_tag_invalid" and "measurement" in detail["loc"]
    return as_studies_have(str(detail["ctx"]["tag"])) if wrong else ""


def _place(detail: ErrorDetails, source: Source, message: str = "") -> FileIssue:
    path, missing = untagged(detail["loc"], source.data), detail["type"] == "missing"
    if detail["type"] == "union_tag_invalid":
        # The mistyped value's own line: that of `kind`, or of `form`.
        tag, given = detail["ctx"]["tag"], detail["input"]
        path = (*path, *[key for key in (KIND, "form") if given.get(key) == tag][:1])
    if missing:
        return source.issue(path[:-1], message, missing=str(path[-1]))
    return source.issue(path, message, of_key=detail["type"] == "extra_forbidden")

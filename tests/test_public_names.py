"""What public functions and classes take, give and raise is public: whoever annotates or catches needs it."""

from __future__ import annotations

import ast
import builtins
import inspect
import re
from collections.abc import Iterator
from typing import Any

import pytest

import oed

INNER = {
    "Array": "a NumPy array of numbers",
    "Draft": "what `oed` itself gives `run` to write into, for pages that go with a record",
}
"""Names in signatures of public functions that nobody outside has to write, and why."""
ERRORS = {"OedError", "UserMistake", "Failure", "FileIssue", "FileError", "Issue"}


def methods() -> Iterator[tuple[str, Any]]:
    """Public functions, and of public classes the public methods that stand in this package."""
    for name in dir(oed):
        thing = getattr(oed, name)
        if not inspect.isclass(thing):
            if inspect.isroutine(thing):
                yield name, thing
            continue
        for inner, one in inspect.getmembers(thing, inspect.isroutine):
            own = str(getattr(one, "__module__", "")).startswith("oed.")
            if own and (inner == "__init__" or not inner.startswith("_")):
                yield f"{name}.{inner}", one


def raised(thing: object) -> set[str]:
    """Errors that a docstring names."""
    found = re.search(r"^Raises:\n((?: +.*\n?|\n)*)", inspect.getdoc(thing) or "", flags=re.MULTILINE)
    return set(re.findall(r"^ {4}(\w+):", found[1], flags=re.MULTILINE)) if found else set()


def annotated(function: Any) -> set[str]:
    """Names of this package in a function's annotations."""
    own = inspect.unwrap(function)
    trees = [ast.parse(text, mode="eval") for text in own.__annotations__.values()]
    names = {node.id for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Name)}
    # What the standard library and NumPy have is written as everywhere.
    return {name for name in names if _home(own, name).split(".")[0] == "oed"}


def _home(function: Any, name: str) -> str:
    if hasattr(builtins, name):
        return "builtins"
    thing = function.__globals__.get(name)
    if inspect.ismodule(thing):
        return str(thing.__name__)
    home = str(getattr(thing, "__module__", "oed"))
    # An alias of types says where types come from, not where it stands itself.
    alias = not inspect.isclass(thing) and name not in ("Mapping", "Sequence", "Callable", "Any", "Literal")
    return "oed" if alias else home


@pytest.mark.slow
def test_what_is_raised_is_public():
    missing = {
        f"{name}: {error}"
        for name, thing in methods()
        for error in raised(thing)
        if not hasattr(oed, error) and not hasattr(builtins, error)
    }
    assert not missing, sorted(missing)


def test_what_functions_take_and_give_is_public():
    functions = [(name, one) for name, one in methods() if "." not in name]
    assert len(functions) > 20
    found = {(name, one) for name, function in functions for one in annotated(function)}
    missing = {f"{name}: {one}" for name, one in found if not hasattr(oed, one) and one not in INNER}
    assert not missing, sorted(missing)
    # What is listed as none of the users' is met.
    assert {one for _, one in found if not hasattr(oed, one)} == INNER.keys()


@pytest.mark.parametrize("name", sorted(ERRORS))
def test_errors_and_what_they_hold_are_public(name: str):
    assert inspect.isclass(getattr(oed, name))
    hints = getattr(getattr(oed, name), "__annotations__", {})
    assert all(hasattr(oed, one) for hint in hints.values() for one in re.findall(r"\b[A-Z]\w+", str(hint)))


def test_part_errors_can_be_caught():
    with pytest.raises(oed.PartError):
        oed.Ipopt(starts=-1)
    with pytest.raises(oed.WrongKind):
        oed.solve("study.yaml")
    with pytest.raises(oed.RecordError) as caught:
        oed.load_record("none there")
    assert isinstance(caught.value.issues[0], oed.FileIssue)

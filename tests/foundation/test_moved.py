"""Modules by the names that they once had."""

from __future__ import annotations

import importlib
import pickle
from itertools import chain
from pathlib import Path

import pytest

import oed
from oed.bounds import Certificate
from oed.foundation.moved import ATTRIBUTES, NAMES, PLACES, Renamed


@pytest.mark.parametrize("name", ["evaluation", "limits", "limits.workspace", "solvers.ipopt"])
def test_an_old_name_says_the_new_one(name: str):
    first = name.partition(".")[0]
    with pytest.raises(ModuleNotFoundError, match=f"oed.{first} is now oed.{PLACES[first]}; public names"):
        importlib.import_module(f"oed.{name}")


def test_every_new_place_is_there():
    for place in PLACES.values():
        importlib.import_module(f"oed.{place}")


def test_no_other_name_is_answered():
    with pytest.raises(ModuleNotFoundError, match=r"No module named 'oed\.nonsense'"):
        importlib.import_module("oed.nonsense")


def test_every_attribute_has_a_new_name():
    for name, renamed in ATTRIBUTES.items():
        kinds = [kind for kind in Renamed.__subclasses__() if kind.__name__ == name]
        for kind in kinds:
            for old, new in renamed.items():
                fields = (
                    getattr(kind, name, ())
                    for name in ("__dataclass_fields__", "model_fields", "__annotations__")
                )
                assert new in {*vars(kind), *chain(*fields)}, f"{name}.{old}"


def test_an_attribute_by_its_old_name():
    certificate = Certificate(1.0, "", ())
    with pytest.raises(AttributeError, match="no attribute 'caps': it is now 'bounds'"):
        certificate.caps  # noqa: B018
    with pytest.raises(AttributeError, match=r"no attribute 'nonsense'$"):
        certificate.nonsense  # noqa: B018
    assert pickle.loads(pickle.dumps(certificate)) == certificate


def test_what_is_wrong_with_a_study_by_its_old_name():
    error = oed.StudyError.about("study.yaml", "no study")
    with pytest.raises(
        AttributeError, match="'StudyError' object has no attribute 'flaws': it is now 'issues'"
    ):
        error.flaws  # noqa: B018
    assert len(error.issues) == 1


def test_a_method_of_the_users_own_by_its_old_name():
    """A limit and a system, of which nobody would call it any more."""
    for base in (oed.Limit, oed.System):
        with pytest.raises(
            TypeError, match=r"Own\.flaws is now called issues: rename it, or nobody calls it"
        ):
            type("Own", (base,), {"flaws": lambda *_: [], "__module__": __name__, "__qualname__": "Own"})


@pytest.mark.parametrize(("old", "new"), NAMES.items())
def test_a_public_name_by_its_old_one(old: str, new: str):
    # `from oed import` swallows what an AttributeError says.
    with pytest.warns(DeprecationWarning, match=f"oed.{old} is now oed.{new}; the old name ends with 2.0"):
        assert getattr(oed, old) is getattr(oed, new)
    with pytest.warns(DeprecationWarning, match=f"oed.{new};") as heard:
        exec(f"from oed import {old}", {})
    assert {Path(one.filename).name for one in heard} == {"<string>"}
    assert new in dir(oed)
    assert old not in dir(oed)

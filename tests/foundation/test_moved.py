"""Modules by the names that they once had."""

from __future__ import annotations

import importlib

import pytest

from oed.foundation.moved import PLACES


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

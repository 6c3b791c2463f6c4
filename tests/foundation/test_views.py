"""The registry by which objects find their cards, tables and figures."""

import sys
from pathlib import Path

import pytest

from oed.foundation import views


class Shape:
    """An object with views."""


class Square(Shape):
    """An object of a class that inherits views."""


@pytest.fixture(autouse=True)
def registry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(views, "_modules", {})
    monkeypatch.setattr(views, "_makers", {})


def test_view_of_a_base_class_serves_classes_that_inherit_from_it():
    views.makes("card", Shape)(lambda shape: f"card of a {type(shape).__name__}")
    assert views.make("card", Square()) == "card of a Square"


def test_view_of_the_class_itself_comes_first():
    views.makes("card", Shape)(lambda _: "shape")
    views.makes("card", Square)(lambda _: "square")
    assert views.make("card", Square()) == "square"


def test_further_arguments_are_handed_on():
    views.makes("table", Shape)(lambda _, *names: names)
    assert views.make("table", Shape(), "a", "b") == ("a", "b")


def test_module_is_imported_when_its_first_view_is_wanted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    code = "from oed.foundation.views import makes\nmakes('figure', complex)(abs)\n"
    (tmp_path / "drawing_of_numbers.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    views.register("drawing_of_numbers", "figure")
    assert "drawing_of_numbers" not in sys.modules
    assert views.make("figure", 3 + 4j) == 5.0


@pytest.mark.parametrize("view", ["card", "table", "figure"])
def test_view_that_nobody_makes_is_refused(view):
    views.makes("card", Square)(str)
    with pytest.raises(TypeError, match=f"no {view} of a Shape"):
        views.make(view, Shape())

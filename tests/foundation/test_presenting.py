"""Cards in text and HTML, completion without names of pydantic, tables of numbers with pandas or without."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from oed import E, Ipopt, UserMistake
from oed.foundation.presenting import UNIDENTIFIED, Card, Presented, brief, dataframe, parameter_rows

CARD = Card(
    "Solution a<b", (("objective", "3"), ("path", "2 m")), ("parameter", "value"), (("track", "<180> mm"),)
)


def test_a_card_says_title_and_facts_in_its_short_form_and_the_table_in_its_text():
    assert CARD.short == "Solution a<b\n  objective  3\n  path       2 m"
    assert CARD.text == CARD.short + "\n  parameter  value\n  track      <180> mm"


def test_html_holds_all_of_it_escaped():
    assert "<strong>Solution a&lt;b</strong>" in CARD.html
    assert "&lt;180&gt; mm" in CARD.html
    assert "<180>" not in CARD.html
    assert "\x1b" not in Card("\x1b[2J").html


def test_long_tables_are_cut_and_say_so():
    card = Card("T", (), ("n",), tuple((str(one),) for one in range(100)))
    assert card.text.endswith("and 70 more")
    assert "<p>and 70 more</p>" in card.html


def test_parameters_are_rounded_to_their_errors_in_their_usual_units():
    rows = parameter_rows(
        ("track", "bias", "slip", "own"),
        {"track": 0.18, "bias": 0.1, "slip": 0.3},
        {"track": 1.4e-4, "bias": np.inf},
        {"track": "m", "bias": "rad"},
    )
    assert rows[0] == ("track", "180.00 mm", "0.14 mm")
    assert rows[1][2] == UNIDENTIFIED
    assert rows[2] == ("slip", "0.30000", "–")
    assert rows[3] == ("own", "–", "–")


def test_large_values_are_said_by_their_size():
    assert brief(np.zeros((200, 2))) == "<array (200, 2)>"
    assert brief([0] * 99) == "<99 entries>"
    assert brief(0.5) == "0.5"


@pytest.mark.parametrize("part", [E(), Ipopt()])
def test_completion_lists_what_is_the_parts_own(part):
    names = dir(part)
    assert not [one for one in names if one.startswith(("model_", "__pydantic"))]
    assert not {"copy", "dict", "json", "schema", "parse_obj", "construct"} & set(names)
    assert {"kind", "as_data"} <= set(names)


def test_without_pandas_a_table_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UserMistake, match="pip install pandas"):
        dataframe({"t": [0.0]})


def test_a_table_names_its_units(monkeypatch):
    fake = SimpleNamespace(DataFrame=lambda columns: SimpleNamespace(columns=columns, attrs={}))
    monkeypatch.setitem(sys.modules, "pandas", fake)
    frame = dataframe({"t": [0.0], "name": ["a"]}, {"t": "s", "name": ""})
    assert frame.columns == {"t": [0.0], "name": ["a"]}
    assert frame.attrs == {"units": {"t": "s"}}


def test_an_object_too_broken_to_describe_itself_is_named_all_the_same():
    class Broken(Presented):
        def _card(self):
            raise ValueError("broken")

    assert repr(Broken()) == "<Broken>"
    with pytest.raises(ValueError, match="broken"):
        Broken().summary()
